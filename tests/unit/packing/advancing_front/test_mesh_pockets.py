"""Spheres that touch the wall of a closed mesh: against flat walls, and by exact distances."""

import numpy as np
import pytest
from kit import slow

import voxgran as vg

SPHERE = vg.make_shape("sphere")
ROCK = vg.make_shape("solid_union", seed=7, solids=4)

pytestmark = pytest.mark.filterwarnings("ignore:.*grains were placed before")


def as_mesh(box):
    """The same room with walls that are triangles."""
    return vg.ClosedMesh(vg.Shape.from_mesh(*box.mesh()))


def at_walls(packing):
    """How far each sphere reaches beyond the wall, by the distance of its center."""
    return packing.container.signed_distance(packing.position) + packing.bounding_radii


def pack(container, **keywords):
    return vg.pack(SPHERE, container, method="advancing_front", mode="dense", order="lowest", **keywords)


def test_a_box_of_triangles_is_filled_as_a_box_is():
    # 330 and 332.5 spheres on the average, each with a deviation of 2.5: means of eight err by 1.2
    box = vg.Box((7, 7, 7))
    flat, mesh = ([pack(container, seed=seed) for seed in range(8)] for container in (box, as_mesh(box)))
    counts = [np.mean([packing.count for packing in several]) for several in (flat, mesh)]
    assert counts[1] == pytest.approx(counts[0], rel=0.025)
    touching = [np.mean([(np.abs(at_walls(packing)) < 1e-9).sum() for packing in several]) for several in (flat, mesh)]
    assert touching[1] == pytest.approx(touching[0], rel=0.1)
    assert max(at_walls(packing).max() for packing in mesh) <= 1e-9
    assert all(vg.verify(packing).ok for packing in mesh)


@pytest.mark.parametrize("order", [slow("nearest"), "lowest"])
def test_pockets_at_a_rough_wall_are_filled(order):
    rock = vg.ClosedMesh(ROCK.scaled(11.0))
    packing = vg.pack(
        SPHERE, rock, method="advancing_front", mode="dense", order=order, sizes=vg.sizes.uniform(0.5, 1.5), seed=1
    )
    beyond = at_walls(packing)
    assert beyond.max() <= 1e-9
    assert (np.abs(beyond) < 1e-9).sum() > {"nearest": 20, "lowest": 100}[order]
    assert vg.verify(packing).ok
    # each touches two spheres and the wall, or three spheres; the first three have nobody to touch
    radius, there = packing.bounding_radii, packing.position
    gap = np.linalg.norm(there[:, None] - there, axis=2) - radius[:, None] - radius
    np.fill_diagonal(gap, np.inf)
    touched = (np.abs(gap) < 1e-9).sum(axis=1) + (np.abs(beyond) < 1e-9)
    assert (touched >= 3).mean() > 0.99


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_sizes_of_a_hundred_to_one_in_any_unit(unit):
    sizes = vg.sizes.discrete([1.0 * unit, 0.1 * unit, 0.01 * unit], [0.05, 0.35, 0.6])
    packing = pack(vg.ClosedMesh(ROCK.scaled(4.0 * unit)), count=300, sizes=sizes)
    assert packing.count > 100
    assert at_walls(packing).max() <= 1e-9 * unit
    assert vg.verify(packing).ok


def test_a_narrow_mesh_is_filled_by_a_loose_front_too():
    slab = as_mesh(vg.Box((5, 5, 1.0000001)))
    packing = vg.pack(SPHERE, slab, method="advancing_front")
    assert packing.count >= 12
    assert at_walls(packing).max() <= 1e-9
    assert vg.verify(packing).ok
