"""Spheres near a box by their order along the axes, against a test of all spheres."""

import itertools

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.measures.window import MOST, Ordered, Solids, images, near_box, power_planes
from voxgran.packing.model import Packing
from voxgran.shapes.family import make_shape

LENGTHS = np.array([4.0, 5.0, 6.0])


def spheres(count=400, spread=1.0):
    """Return centers, some beyond the faces on all axes, and radii."""
    generator = stream(0, "slabs")
    return generator.uniform(-spread, LENGTHS + spread, size=(count, 3)), generator.uniform(0.05, 0.4, size=count)


@pytest.mark.parametrize("periodic", ["", "x", "xyz"])
@pytest.mark.parametrize("offset", [0.0, -1e6, 7.3])
def test_none_that_reaches_into_a_slab_is_left_out(periodic, offset):
    centers, radii = spheres()
    centers = centers + offset
    box = Box(LENGTHS, origin=(offset,) * 3, periodic=periodic)
    ordered = [Ordered.of(centers, box, axis) for axis in range(3)]
    selected = 0
    for axis in range(3):
        for start, width in [(-0.2, 0.3), (0.0, 0.5), (2.0, 0.0), (3.7, 0.6), (5.9, 0.3), (1.0, 2.5), (-9.0, 0.2)]:
            lower, upper = np.full(3, -np.inf), np.full(3, np.inf)
            lower[axis], upper[axis] = offset + start, offset + start + width
            exact = np.unique(images(centers, radii, lower, upper, box)[0])
            near = near_box(ordered, radii.max(), lower, upper)
            if near is None:
                continue
            selected += 1
            assert np.array_equal(near, np.unique(near))
            assert np.isin(exact, near).all()
            assert len(near) < MOST * len(radii)
            # no others than those within the largest radius
            place = centers[near, axis] - offset
            far = np.abs(place - start - width / 2)
            if box.periodic[axis]:
                far = np.abs((place - start - width / 2 + LENGTHS[axis] / 2) % LENGTHS[axis] - LENGTHS[axis] / 2)
            assert far.max(initial=0.0) <= width / 2 + radii.max() + 1e-5
    assert selected >= 12


def test_the_axis_with_fewest_spheres_is_taken():
    centers, radii = spheres()
    ordered = [Ordered.of(centers, Box(LENGTHS), axis) for axis in range(3)]
    lower, upper = np.array([0.0, 0.0, 2.0]), np.array([4.0, 1.0, 2.1])
    along = near_box(ordered, radii.max(), np.array([-np.inf, -np.inf, 2.0]), np.array([np.inf, np.inf, 2.1]))
    assert np.array_equal(near_box(ordered, radii.max(), lower, upper), along)
    assert near_box(ordered, radii.max(), np.zeros(3), LENGTHS) is None
    assert near_box(ordered, radii.max(), np.full(3, -np.inf), np.full(3, np.inf)) is None


@pytest.mark.parametrize("periodic", ["", "z", "xyz"])
def test_slices_of_overlapping_spheres_add_up_to_the_whole(periodic):
    centers, radii = spheres(spread=0.0)
    packing = Packing.of([make_shape("sphere")], Box(LENGTHS, periodic=periodic), position=centers, scale=2 * radii)
    solids = Solids(packing)
    ends = np.linspace(0.0, 6.0, 41)
    lower, upper = np.full(3, -np.inf), np.full(3, np.inf)
    parts = []
    for low, high in itertools.pairwise(ends):
        lower[2], upper[2] = low, high
        parts.append(solids.volume(lower, upper))
    whole = np.full(3, -np.inf), np.full(3, np.inf)
    lower[2], upper[2] = 0.0, 6.0
    assert sum(parts) == pytest.approx(solids.volume(lower, upper), rel=1e-13)
    if "z" in periodic:
        assert sum(parts) == pytest.approx(solids.volume(*whole), rel=1e-13)


def test_planes_from_known_contacts_are_those_of_a_search():
    centers, radii = spheres(spread=0.0)
    centers[7], radii[7] = centers[3], radii[3]
    box = Box(LENGTHS, periodic="xy")
    packing = Packing.of([make_shape("sphere")], box, position=centers, scale=2 * radii)
    packing.contacts(0.0)
    packing.contacts(0.1)
    searched = power_planes(centers, packing.scale / 2, box)
    for found, wanted in zip(Solids(packing).spheres[2], searched, strict=True):
        assert np.array_equal(found, wanted)
