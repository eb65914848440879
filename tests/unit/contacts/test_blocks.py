"""Contacts found by several threads: the same rows, and the same memory of pairs, however little room there was."""

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.compiling.threads import using_threads
from voxgran.contacts.manifolds import blocks
from voxgran.contacts.manifolds.rows import ContactRows
from voxgran.packing.settling_run import normalized_assembly
from voxgran.settling.bed import Bed

#: made when they are asked for, since the kernels that fit a clump are compiled then
KINDS = {
    "spheres": lambda: [vg.make_shape("sphere")],
    "solids": lambda: [vg.make_shape(name) for name in ("platonic", "ellipsoid", "cylinder", "cone", "box")],
    "clumps": lambda: [vg.fit_clump(rock(), max_spheres=8).to_shape(), vg.make_shape("box")],
    "meshes": lambda: [rock(), vg.make_shape("sphere")],
    "outlines": lambda: [vg.make_shape("polygon", seed=2), vg.make_shape("disk")],
}


def rock():
    return vg.make_shape("solid_union", seed=1)


@pytest.fixture(scope="module", params=KINDS)
def assembly(request):
    flat = request.param == "outlines"
    box = vg.Rectangle((6, 10), periodic="x") if flat else vg.Box((3, 3, 8), periodic="x")
    loose = vg.pack(KINDS[request.param](), box, "rsa", count=30, sizes=vg.sizes.uniform(0.6, 1.0), seed=4)
    return normalized_assembly(loose)[0]


def searched(assembly, *, exact, threads, room):
    """Return the contacts and the memory of pairs after searches between which grains move, also into each other."""
    generator = np.random.Generator(np.random.Philox(5))
    bed = Bed(assembly, np.array([0.0, -1.0, 0.0] if assembly.dimension == 2 else [0.0, 0.0, -1.0]), exact=exact)
    if room is not None:
        bed.rows = ContactRows(*(array[:room].copy() for array in bed.rows))
    found = []
    with using_threads(threads):
        for far in (0.02, 0.05, 0.3, 0.02):
            motion = far * generator.normal(size=(bed.count + 1, 6))
            if assembly.dimension == 2:
                motion[:, 2:5] = 0.0
            bed.move(motion, 1.0, carry=exact)
            bed.find(0.2, 1e-3, reuse=1e-3)
            bed.rows.row[: bed.m, 10] = 1.0 + np.arange(bed.m)
            found += [bed.rows.row[: bed.m].copy(), bed.rows.i[: bed.m].copy(), bed.rows.j[: bed.m].copy()]
    return [*found, *bed.pairs]


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("room", [slow(None), 7])
def test_threads_find_the_same_contacts(assembly, exact, room, monkeypatch):
    monkeypatch.setattr(blocks, "LEAST_PAIRS", 1)
    one = searched(assembly, exact=exact, threads=1, room=room)
    # of spheres nothing is remembered but the pairs
    assert min(len(array) for array in one[:17]) > 10
    for threads in (2, 3):
        for array, other in zip(one, searched(assembly, exact=exact, threads=threads, room=room), strict=True):
            np.testing.assert_array_equal(other, array)


def test_few_pairs_are_not_divided(monkeypatch):
    asked = []
    monkeypatch.setattr(blocks, "at_once", lambda jobs: asked.append(len(jobs)) or [job() for job in jobs])
    rocks = vg.pack([rock()], vg.Box((3, 3, 3)), "rsa", count=4, seed=1)
    with using_threads(8):
        Bed(normalized_assembly(rocks)[0], np.array([0.0, 0.0, -1.0])).find(0.2, 0.0)
    assert not asked
