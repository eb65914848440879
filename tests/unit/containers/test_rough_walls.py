"""Containers whose walls are displaced by random fields."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError

SPACES = [
    vg.Box((2, 2, 2), origin=(1, 0, 0)),
    vg.Cylinder(radius=1, height=2, origin=(0, 3, 0)),
    vg.Sphere(1.2),
    vg.ClosedMesh(vg.make_shape("convex_polyhedron", diameter=2.5)),
]
FLAT = [vg.Rectangle((4, 3)), vg.Disk(2.0, origin=(1, 1)), vg.Polygon([(0, 0), (6, 0), (6, 4), (3, 2), (0, 4)])]


@pytest.mark.parametrize("container", SPACES, ids=lambda one: one.kind)
def test_walls_are_displaced_in_both_directions(container):
    rough = vg.rough_walls(container, rms=0.02, correlation_length=0.5, seed=1)
    assert isinstance(rough, vg.ClosedMesh)
    assert vg.diagnose(rough.shape).ok
    distance = container.signed_distance(rough.mesh()[0])
    assert distance.min() < -0.02 < 0.02 < distance.max()
    assert np.sqrt((distance**2).mean()) == pytest.approx(0.02, rel=0.25)
    assert np.abs(distance).max() < 0.12
    assert rough.volume == pytest.approx(container.volume, rel=0.01)
    assert rough.shape.record["roughness_rms"] == pytest.approx(0.02, rel=1e-9)
    again = vg.make_container(rough.to_mapping())
    assert again.volume == rough.volume


@pytest.mark.parametrize("container", FLAT, ids=lambda one: one.kind)
def test_walls_in_the_plane(container):
    rough = vg.rough_walls(container, rms=0.02, correlation_length=0.5, seed=1)
    assert isinstance(rough, vg.Polygon)
    corners = np.column_stack([rough.corners, np.zeros(len(rough.corners))])
    distance = container.signed_distance(corners)
    assert distance.min() < -0.02 < 0.02 < distance.max()
    assert np.abs(distance).max() < 0.1
    assert rough.volume == pytest.approx(container.volume, rel=0.01)


def test_grains_are_packed_between_rough_walls():
    rough = vg.rough_walls(vg.Box((3, 3, 3)), rms=0.05, correlation_length=0.6, seed=4)
    packing = vg.pack(vg.make_shape("sphere"), rough, method="expand", solid_fraction=0.3, seed=1)
    assert packing.solid_fraction == pytest.approx(0.3, rel=0.02)
    assert packing.verify().ok


@pytest.mark.parametrize(
    ("container", "message"),
    [
        (vg.Box((2, 2, 2), periodic="xz"), "periodic along x, z: rough walls close it"),
        (vg.Polygon([(0, 0), (4, 0), (4, 4), (0, 4)], holes=[[(1, 1), (2, 1), (2, 2)]]), "container has 1 holes"),
        (vg.make_shape("sphere"), "a Shape is no container"),
    ],
)
def test_what_has_no_walls_all_around_is_refused(container, message):
    with pytest.raises(InputError, match=message):
        vg.rough_walls(container)


def test_walls_that_would_meet_are_refused():
    with pytest.raises(InputError, match="give at most"):
        vg.rough_walls(vg.Box((1, 1, 1)), rms=0.6)
