"""Threads: the same bits by any number of them, none for small work, and a number that calls and environments set."""

from functools import cache

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.compiling.threads import in_blocks, thread_count, using_threads
from voxgran._base.errors import InputError
from voxgran._base.kernels import kernel
from voxgran._base.machine import processor_count

BLOB = np.random.default_rng(3).random((70, 64, 66)) > 0.002


@kernel
def square(values, squares, blocks, first, stop):
    for k in range(first, stop):
        squares[k] = values[k] ** 2
        blocks[k] = first


def squares_of(values, *, least=1):
    """Return the squares and the first row of the block in which each was computed."""
    squares, blocks = np.zeros(len(values)), np.zeros(len(values), dtype=np.int64)
    in_blocks(square, len(values), values, squares, blocks, least=least)
    return squares, blocks


@pytest.mark.parametrize(("threads", "least", "starts"), [(1, 1, [0]), (2, 1, [0, 5]), (4, 3, [0, 3, 6]), (9, 20, [0])])
def test_rows_are_shared_among_threads(threads, least, starts):
    values = np.arange(10.0)
    with using_threads(threads):
        squares, blocks = squares_of(values, least=least)
    np.testing.assert_array_equal(squares, values**2)
    assert np.unique(blocks).tolist() == starts


def test_no_rows_and_more_threads_than_rows():
    with using_threads(4):
        assert squares_of(np.zeros(0))[0].size == 0
        assert np.unique(squares_of(np.ones(2))[1]).tolist() == [0, 1]


def test_without_a_call_that_asks_for_threads_one_does_all():
    assert thread_count() == 1
    assert np.unique(squares_of(np.ones(1000))[1]).tolist() == [0]


def test_a_call_within_a_call_takes_its_threads(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with using_threads(3):
        with using_threads(None):
            assert thread_count() == 3
        with using_threads(2):
            assert thread_count() == 2
    with using_threads(None):
        assert thread_count() == processor_count()


@pytest.mark.parametrize(("text", "count"), [("1", 1), ("0", 1), ("99", None), ("two", None), ("", None)])
def test_the_environment_limits_threads(monkeypatch, text, count):
    monkeypatch.setenv("OMP_NUM_THREADS", text)
    with using_threads(None):
        assert thread_count() == (count or processor_count())


def test_an_error_of_a_thread_is_raised_and_ends_its_team():
    with pytest.raises(IndexError), using_threads(2):
        in_blocks(_broken, 10)
    assert thread_count() == 1


def _broken(first, stop):
    raise IndexError(first, stop)


def rotated(shape):
    """Return a shape turned out of all symmetries."""
    return shape.rotated(np.array([0.9, 0.3, -0.2, 0.24]) / np.linalg.norm([0.9, 0.3, -0.2, 0.24]))


@cache
def random_bed(family, count, length, **parameters):
    """Return a bed in which some grains overlap."""
    shapes = vg.make_shape(family, **parameters)
    bed = vg.pack(shapes, vg.Box((length,) * 3, periodic="xy"), "rsa", count=count, seed=4)
    return vg.Packing.of(
        bed.shapes,
        bed.container,
        position=bed.position,
        scale=1.1 * bed.scale,
        shape_id=bed.shape_id,
        orientation=bed.orientation,
    )


def ellipsoids():
    return random_bed("ellipsoid", 500, 10, aspect=(1, 1, 2))


def polyhedra():
    return random_bed("polyhedron", 80, 5.7, solid="cube", seed=1)


def findings(verification):
    """Return the depths of the overlaps that were found, of which there are some."""
    assert verification.overlapping_pairs > 3
    return np.array(
        [verification.overlapping_pairs, verification.deepest, *(pair.depth for pair in verification.pairs)]
    )


def loose():
    """Return solids of several kinds that do not touch."""
    shapes = [vg.make_shape(name) for name in ("platonic", "ellipsoid", "cylinder")]
    return vg.pack(shapes, vg.Box((4, 4, 8), periodic="xy"), "rsa", count=60, seed=2)


def poses(packing):
    """Return the places and orientations of the grains."""
    return packing.position, packing.orientation


@cache
def settled(threads=1):
    """Return the solids at rest, by so many threads."""
    return vg.settle(loose(), gravity="-z", threads=threads)


CALLS = {
    "voxelize": lambda threads: vg.voxelize(rotated(vg.shapes.torus()), voxel_size=0.005, threads=threads).mask,
    "distance_transform": lambda threads: vg.distance_transform(BLOB, periodic="x", threads=threads),
    "local_thickness": lambda threads: vg.local_thickness(BLOB, threads=threads),
    "local_thickness, periodic": lambda threads: vg.local_thickness(BLOB, periodic="xyz", threads=threads),
    "opening": lambda threads: vg.opening(BLOB, 1.5, threads=threads),
    "verify, convex": lambda threads: findings(vg.verify(ellipsoids(), threads=threads)),
    "verify, meshes": lambda threads: findings(vg.verify(polyhedra(), threads=threads)),
    "pack, meshes at rest": lambda threads: np.hstack(
        poses(vg.pack(vg.shapes.torus(), vg.Box((3, 3, 6)), "gravity", count=15, rest=0.5, threads=threads))
    ),
    "settle, convex solids": lambda threads: np.hstack(poses(settled(threads))),
    "equilibrium": lambda threads: vg.equilibrium(settled(), threads=threads).force.values,
    "measure": lambda threads: vg.measure(polyhedra(), ["contacts"], threads=threads)["/contacts"].gap.values,
}


@pytest.mark.parametrize("threads", [slow(2), 3])
# a bed of meshes finds contacts and forces as those of convex solids do
@pytest.mark.parametrize("name", [slow(name) if name == "pack, meshes at rest" else name for name in CALLS])
def test_any_number_of_threads_gives_the_same_bits(name, threads):
    np.testing.assert_array_equal(CALLS[name](threads), CALLS[name](1))


@pytest.mark.parametrize("threads", [0, -1, 1.5, "two"])
def test_numbers_of_threads_that_are_refused(threads):
    with pytest.raises(InputError, match="threads"):
        vg.verify(ellipsoids(), threads=threads)
    with pytest.raises(InputError, match="threads"):
        vg.pack(vg.shapes.sphere(), vg.Box((3, 3, 3)), "rsa", count=3, threads=threads)
    with pytest.raises(InputError, match="threads"):
        vg.settle(loose(), gravity="-z", threads=threads)
