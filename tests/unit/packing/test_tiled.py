"""Periodic packings repeated beside themselves: grains, container, contacts, forces, and what refuses."""

import itertools
import json
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import CallError, InputError, TooLargeError
from voxgran.cli import main
from voxgran.contacts.forces import chain_ends
from voxgran.report.facts import details


def bed(shape, count=24, **given):
    """Grains at rest in a box that is periodic across gravity."""
    return vg.pack(shape, vg.Box((3.5, 4, 9), periodic="xy"), "gravity", count=count, **given)


def cell(tilt=(1.5, 0.5, 1.9)):
    """Spheres under a stress in a periodic cell."""
    loose = vg.pack(vg.shapes.sphere(), vg.Box((3.6, 4, 4.4), periodic="xyz", tilt=tilt), "jam")
    return vg.compress(loose, friction=0.3)


def net_forces(packing):
    """Net force on each grain, in weights of a median grain, with its weight where there is gravity; without loops."""
    forces, inner, net = packing.forces, packing.forces.j >= 0, np.zeros((packing.count, 3))
    np.add.at(net, forces.i, -forces.force)
    np.add.at(net, forces.j[inner], forces.force[inner])
    weight = packing.masses / np.median(packing.masses)
    return net if packing.gravity is None else net + weight[:, None] * np.array(packing.gravity)


def test_copies_of_a_bed_carry_its_forces_and_its_proof():
    one = bed(vg.shapes.sphere(), sizes=vg.sizes.uniform(0.8, 1.2))
    large = one.tiled((2, 3, 1))
    assert large.container == vg.Box((7, 12, 9), periodic="xy")
    assert large.count == 6 * one.count
    assert large.solid_fraction == pytest.approx(one.solid_fraction, rel=1e-12)
    assert large.verify().ok
    assert large.forces.count == 6 * one.forces.count
    assert large.forces.share_at_rest == one.forces.share_at_rest
    np.testing.assert_allclose(net_forces(large), np.tile(net_forces(one), (6, 1)), atol=1e-12)
    assert vg.equilibrium(large).share_at_rest == vg.equilibrium(one).share_at_rest == 1.0
    assert large.provenance["tiled"] == {"repeats": [2, 3, 1], "count": one.count}
    assert large.tiled((2, 1, 1)).provenance["tiled"] == {"repeats": [4, 3, 1], "count": one.count}
    assert large.stop_reason == "settled"


@pytest.mark.parametrize("tilt", [(0, 0, 0), (1.5, 0.5, 1.9)])
def test_partners_of_contacts_are_where_they_touch(tilt):
    """Each force acts between two grains of which neither is far from its point, also where the larger cell leans
    the other way.
    """
    one = cell(tilt)
    large = one.tiled((2, 3, 2))
    here, there = chain_ends(large, large.forces)
    apart = large.median_diameter + large.forces.gap
    np.testing.assert_allclose(there - here, apart[:, None] * large.forces.normal, atol=1e-6)
    gap = 1e-3
    assert large.contacts(gap).count == 12 * one.contacts(gap).count
    np.testing.assert_allclose(net_forces(large), np.tile(net_forces(one), (12, 1)), atol=1e-12)
    assert large.verify().ok
    assert vg.equilibrium(large).balanced == vg.equilibrium(one).balanced == 1
    assert large.container.volume == pytest.approx(12 * one.container.volume, rel=1e-12)


def test_a_tilted_cell_is_repeated_along_its_edges():
    """The copies lie where sums of the edges bring them, up to periods of the larger cell."""
    cell = vg.Box((4, 5, 6), periodic="xyz", tilt=(1.9, -1.0, 2.4))
    one = vg.Packing.of(vg.shapes.sphere(), cell, position=[(1, 2, 3), (3, 4.5, 5)])
    repeats = (1, 2, 3)
    large = one.tiled(repeats)
    edges = np.linalg.solve((cell.vectors * np.array(repeats)[:, None]).T, large.container.vectors.T)
    np.testing.assert_allclose(edges, np.rint(edges), atol=1e-12)
    assert round(abs(np.linalg.det(edges))) == 1
    wanted = [one.position + np.array(cell_) @ cell.vectors for cell_ in itertools.product(*map(range, repeats))]
    turns = np.linalg.solve(large.container.vectors.T, (large.position - np.concatenate(wanted)).T)
    np.testing.assert_allclose(turns, np.rint(turns), atol=1e-12)


@pytest.mark.parametrize("kind", ["rock", "clump", "hull"])
def test_grains_of_all_kinds(kind):
    if kind == "clump":
        shape = vg.fit_clump(vg.shapes.box(lengths=(1, 1, 1.6)), max_spheres=4).to_shape()
    elif kind == "rock":
        shape = vg.make_shape("solid_union", seed=2)
    else:
        shape = vg.make_shape("convex_polyhedron", points=12, seed=2)
    box = vg.Box((5, 5, 5), periodic="xy")
    one = vg.pack(shape, box, "rsa", count=8, sizes=vg.sizes.uniform(0.8, 1.2))
    large = one.tiled((2, 2, 1))
    assert large.verify().ok
    assert large.forces is None
    np.testing.assert_array_equal(large.orientation, np.tile(one.orientation, (4, 1)))
    np.testing.assert_array_equal(large.volumes, np.tile(one.volumes, 4))


def test_a_packing_in_the_plane_with_fixed_grains_and_a_list():
    box = vg.Rectangle((5, 8), "x")
    stones = vg.Packing.of(vg.shapes.disk(), box, position=[(2, 1, 0)])
    one = vg.pack(container=box, method="gravity", grains={"diameter": [1.0, 0.8, 0.9] * 4}, obstacles=stones)
    large = one.tiled(3)
    assert large.container.lengths == (15, 8)
    assert large.fixed.sum() == 3
    np.testing.assert_array_equal(large.grain_id, np.tile(one.grain_id, 3))
    assert large.verify().ok
    assert large.solid_fraction == pytest.approx(one.solid_fraction, rel=1e-12)


def test_files_decks_and_a_start_take_it(tmp_path):
    one = bed(vg.shapes.sphere())
    large = one.tiled((2, 2, 1))
    large.save(tmp_path / "bed.vtp")
    again = vg.load(tmp_path / "bed.vtp")
    assert again == large
    np.testing.assert_array_equal(again.forces.j, large.forces.j)
    assert again.provenance["tiled"]["repeats"] == [2, 2, 1]
    assert vg.write_deck(large, tmp_path / "run", "lammps").files
    more = vg.pack(vg.shapes.sphere(), large.container, "gravity", count=8, start=large)
    assert more.count == large.count + 8
    assert more.verify().ok
    copy = replace(large, forces=None).tiled(1)
    assert copy == large
    assert copy.container is large.container


def test_the_prompt_tiles_and_the_report_says_so(tmp_path, capsys):
    bed(vg.shapes.sphere()).save(tmp_path / "bed.vtp")
    words = ["tile", str(tmp_path / "bed.vtp"), "--repeats", "2,1,1", "-o", str(tmp_path / "large.vtp")]
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["grains"] == 48
    assert main(words) == 2
    large = vg.load(tmp_path / "large.vtp")
    assert large.verify().ok
    assert any(fact.label == "tiled" and "count" in fact.value for fact in details(large))


def test_the_record_tells_copies_that_are_alike():
    """Of copies that have moved, or of which grains are left out, the record begins anew; a start keeps its own."""
    one = bed(vg.shapes.sphere())
    large = one.tiled(2)
    assert large.tiled(2).provenance["tiled"] == {"repeats": [4, 4, 1], "count": one.count}
    moved = replace(large, position=large.position + [0, 0, 1e-4] * (np.arange(large.count) == 30)[:, None])
    assert moved.tiled(2).provenance["tiled"] == {"repeats": [2, 2, 1], "count": large.count}
    assert large[::2].tiled((3, 1, 1)).provenance["tiled"] == {"repeats": [3, 1, 1], "count": large.count // 2}
    tilted = cell().tiled(2)
    assert tilted.tiled((1, 2, 1)).provenance["tiled"]["repeats"] == [2, 4, 2]
    more = vg.pack(vg.shapes.sphere(), large.container, "deposition", count=4, start=large)
    assert more.provenance["asked"]["start"] == {
        "count": large.count, "method": "gravity", "tiled": {"repeats": [2, 2, 1], "count": one.count},
    }  # fmt: skip


def test_copies_beyond_the_memory_and_walls_all_around_refuse():
    one = vg.Packing.of(vg.shapes.sphere(), vg.Box((8, 8, 8)), position=np.mgrid[:7, :7, :7].reshape(3, -1).T + 1.0)
    with pytest.raises(InputError, match="repeats is 2: the box is not periodic along x"):
        one.tiled(2)
    assert one.tiled(1) == one
    with pytest.raises(TooLargeError, match="343000000: these grains need at least"):
        replace(one, container=vg.Box((8, 8, 8), periodic="xy")).tiled(1000)
    with pytest.raises(CallError, match=r"^Packing.tiled takes 1 argument .* write packing.tiled\(\(4, 4, 1\)\)$"):
        one.tiled(2, 2, 1)


@pytest.mark.parametrize(
    ("repeats", "told"),
    [
        ((2, 2, 2), "not periodic along z"),
        ((2, 2), "3 whole numbers"),
        ((2, 0, 1), "at least 1"),
        (1.5, "whole numbers"),
        ("abc", "whole numbers"),
        ((2, 2.5, 1), "whole number"),
        ([], "whole numbers"),
        (None, "whole numbers"),
        ((3, [2], 1), "whole number"),
        ((10**5, 10**5, 1), "at most 1000000"),
    ],
)
def test_what_refuses(repeats, told):
    one = vg.Packing.of(vg.shapes.sphere(), vg.Box((3, 3, 3), periodic="xy"), position=[(1, 1, 1)])
    with pytest.raises(InputError, match=told):
        one.tiled(repeats)


@pytest.mark.parametrize("method", ["rsa", "gravity"])
def test_the_memory_of_copies_is_known_within_a_third(method, monkeypatch):
    one = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 8), periodic="xy"), method, count=60, seed=1)
    one.tiled((2, 2, 1))
    tracemalloc.start()
    many = one.tiled((20, 20, 1)).count
    needed = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    told = []
    monkeypatch.setattr("voxgran.packing.start.refuse_too_many", lambda count, each: told.append(count * each))
    one.tiled((20, 20, 1))
    assert many == 24_000
    assert told[0] == pytest.approx(needed, rel=0.3)
