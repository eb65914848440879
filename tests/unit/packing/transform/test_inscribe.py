"""Shapes in the spheres of a packing."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError

SPHERE = vg.make_shape("sphere")
BOX = vg.Box((6, 6, 6))
BALLS = vg.pack(SPHERE, BOX, method="rsa", count=60, sizes=vg.sizes.uniform(0.6, 1.2))
HULLS = [vg.make_shape("convex_polyhedron", seed=seed, points=12) for seed in range(60)]


def reach_of(grains, spheres):
    """How far the corners of each grain reach from the center of its sphere, in radii of that sphere."""
    found = [
        np.linalg.norm(grains.world_vertices(k) - spheres.position[k], axis=1).max() / spheres.bounding_radii[k]
        for k in range(grains.count)
    ]
    return np.array(found)


def test_each_sphere_gets_its_own_hull_as_large_as_it_fits():
    grains = vg.inscribe(BALLS, HULLS, shape_id=range(60))
    assert grains.shape_id.tolist() == list(range(60))
    assert reach_of(grains, BALLS).max() <= 1 + 1e-12
    assert reach_of(grains, BALLS).min() > 1 - 1e-9
    assert vg.verify(grains).ok
    assert grains.provenance["inscribed"]["solid_fraction_of_spheres"] == BALLS.solid_fraction
    # a smallest sphere holds its center between the corners that touch it: some lie on either side of each plane
    corners = grains.world_vertices(0) - BALLS.position[0]
    touching = corners[np.linalg.norm(corners, axis=1) > (1 - 0.03) * BALLS.bounding_radii[0]]
    for way in np.random.Generator(np.random.Philox(1)).normal(size=(200, 3)):
        assert (touching @ way).min() < 0.1 * BALLS.bounding_radii[0] * np.linalg.norm(way)


def test_shapes_and_turns_are_drawn_by_the_seed():
    one, same, other = (vg.inscribe(BALLS, HULLS[:3], weights=[1, 2, 0], seed=seed) for seed in (1, 1, 2))
    assert (one.orientation == same.orientation).all()
    assert (one.position == same.position).all()
    assert (one.orientation != other.orientation).any()
    assert set(one.shape_id.tolist()) == {0, 1}


@pytest.mark.parametrize("name", ["ellipsoid", "cone", "spherocylinder", "solid_union", "sphere"])
def test_curved_shapes_lie_within_their_spheres(name):
    shape = vg.make_shape(name)
    grains = vg.inscribe(BALLS, shape)
    assert reach_of(grains, BALLS).max() <= 1 + 1e-12
    assert vg.verify(grains).ok
    if name == "sphere":
        assert grains.position == pytest.approx(BALLS.position)
        assert grains.scale == pytest.approx(BALLS.scale)


def test_disks_get_polygons():
    disks = vg.pack(vg.make_shape("disk"), vg.Rectangle((6, 6)), method="advancing_front", mode="dense")
    kites = vg.inscribe(disks, vg.make_shape("polygon", corners=5))
    assert vg.verify(kites).ok
    assert not kites.orientation[:, 1:3].any()
    with pytest.raises(InputError, match="dimension 3: the packing has 2"):
        vg.inscribe(disks, SPHERE)


def test_wrong_input_is_refused():
    with pytest.raises(InputError, match="shapes is empty"):
        vg.inscribe(BALLS, [])
    with pytest.raises(InputError, match="weights"):
        vg.inscribe(BALLS, HULLS[:2], weights=[0, 0])
    with pytest.raises(InputError, match="shape_id"):
        vg.inscribe(BALLS, HULLS[:2], shape_id=[0, 1])
    with pytest.raises(InputError, match="shape_id"):
        vg.inscribe(BALLS, HULLS[:2], shape_id=[5] * 60)
    for shapes in (None, [None], "box"):
        with pytest.raises(InputError, match=r"shapes.* is .*: it must be a Shape"):
            vg.inscribe(BALLS, shapes)
    with pytest.raises(InputError, match="packing is None: it must be a Packing"):
        vg.inscribe(None, HULLS)


@pytest.mark.parametrize(
    ("shape_id", "words"),
    [
        ("a", "must be an array of numbers of shape"),
        ([[0], [0, 1]], "must be an array of numbers of shape"),
        ([np.nan] * 60, "nan at index"),
        ([0.7] * 60, "0.7 at index 0: every value must be a whole number"),
        ([0] * 59 + [-1], "-1 at index 59"),
        ([0] * 59 + [2], "2 at index 59.* below 2"),
        ([1e300] * 60, "1e.300 at index 0"),
        (np.zeros((1, 60), dtype=int), r"shape \(1, 60\): it must have shape \(60,\)"),
        (np.zeros((1, 60)), r"shape \(1, 60\): it must have shape \(60,\)"),
        (0, "shape"),
    ],
    ids=str,
)
def test_only_indices_tell_which_shape_a_grain_has(shape_id, words):
    with pytest.raises(InputError, match=f"shape_id.*{words}"):
        vg.inscribe(BALLS, HULLS[:2], shape_id=shape_id)
    with pytest.raises(InputError, match=f"shape_id.*{words}"):
        vg.Packing.of([SPHERE] * 2, BOX, position=BALLS.position, shape_id=shape_id)


def test_whole_numbers_of_any_type_are_indices():
    for kind in (np.uint8, np.int32, np.int64, np.float64, list):
        mine = [0, 1] * 30 if kind is list else np.array([0, 1] * 30, dtype=kind)
        assert vg.inscribe(BALLS, HULLS[:2], shape_id=mine).shape_id.tolist() == [0, 1] * 30
        assert isinstance(mine, list) or mine.flags.writeable
