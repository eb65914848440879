"""What a shape answers itself: points inside, distances, bounds, voxels and pictures."""

import pickle

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.shapes.family import sized
from voxgran.shapes.mesh import Triangles

SOLIDS = ["sphere", "ellipsoid", "box", "cylinder", "cone", "platonic", "solid_union"]


@pytest.mark.parametrize("family", [*SOLIDS, "disk", "polygon"])
def test_bounds_hold_the_shape_and_touch_it(family):
    shape = vg.make_shape(family)
    lower, upper = shape.bounds
    assert (lower <= shape.vertices.min(axis=0) + 1e-12).all()
    assert (upper >= shape.vertices.max(axis=0) - 1e-12).all()
    assert shape.vertices.min(axis=0) - lower == pytest.approx(0, abs=2 * shape.tessellation_error + 1e-12)
    assert (shape.centroid == 0).all()


@pytest.mark.parametrize("family", SOLIDS)
def test_signs_and_distances_agree_with_the_solid(family):
    shape = vg.make_shape(family)
    points = np.random.Generator(np.random.Philox(1)).uniform(-0.8, 0.8, (400, 3))
    inside, distance = shape.contains(points), shape.signed_distance(points)
    assert ((distance <= 0) == inside).all()
    volume = 1.6**3 * inside.mean()
    assert volume == pytest.approx(shape.volume, rel=0.5)
    assert distance[~inside].max() < 1.6
    on_surface = shape.signed_distance(shape.vertices)
    assert np.abs(on_surface).max() <= shape.tessellation_error + 1e-12


def test_distances_of_spheres_boxes_and_disks_are_exact():
    points = np.array([[0.0, 0, 0], [2, 0, 0], [0, 0.2, 0]])
    assert vg.make_shape("sphere").signed_distance(points) == pytest.approx([-0.5, 1.5, -0.3])
    assert vg.make_shape("disk").signed_distance(points) == pytest.approx([-0.5, 1.5, -0.3])
    edge = vg.make_shape("box").bounds[1, 0]
    assert vg.make_shape("box").signed_distance([[2 * edge, 2 * edge, 0]]) == pytest.approx(np.sqrt(2) * edge)
    square = vg.make_shape("polygon", vertices=[(0, 0), (1, 0), (1, 1), (0, 1)])
    assert square.signed_distance([[0, 0, 0], [1, 0, 0]]) == pytest.approx([-0.5, 0.5])
    assert list(square.contains([[0, 0, 0], [1, 0, 0]])) == [True, False]


def test_open_surfaces_and_wrong_points_are_refused():
    with pytest.raises(InputError, match=r"open surface.*contact 'kdtree'"):
        vg.make_shape("sheet").contains([[0, 0, 0]])
    with pytest.raises(InputError, match="open surface"):
        vg.make_shape("sheet").signed_distance([[0, 0, 0]])
    with pytest.raises(InputError, match="points"):
        vg.make_shape("sphere").contains([0, 0])


def test_it_gives_voxels_and_a_picture(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    shape = vg.make_shape("cone")
    assert shape.voxelize(0.1).volume == vg.voxelize(shape, voxel_size=0.1).volume
    picture = np.asarray(shape.plot())
    assert picture.shape == (900, 900, 3)
    assert len(np.unique(picture)) > 20


def test_a_shape_keeps_its_record():
    record = {"dimension": 2.7268, "heights": np.arange(4), "seeds": [1, 2]}
    shape = vg.Shape.of(vg.make_shape("box").geometry, name="box", unit="m", record=record)
    record["heights"][0] = 9
    assert shape == vg.make_shape("box")
    assert hash(shape) == hash(vg.make_shape("box"))
    quarter = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    for kept in (
        shape,
        shape.rotated(quarter),
        shape.scaled(2.0),
        shape.to_unit("mm"),
        pickle.loads(pickle.dumps(shape)),
    ):
        assert len(kept.record) == 3
        assert list(kept.record) == ["dimension", "heights", "seeds"]
        assert kept.record["heights"].tolist() == [0, 1, 2, 3]
        assert kept.record["seeds"] == (1, 2)
        assert not kept.record["heights"].flags.writeable
    assert sized(shape.geometry, 2.0, name="box", record=record).record["dimension"] == 2.7268
    assert not vg.make_shape("box").record
    assert "dimension=2.7268" in repr(shape.record)


@pytest.mark.parametrize("family", ["box", "convex_polyhedron", "polygon", "sheet"])
def test_what_a_shape_remembers_cannot_be_changed(family):
    shape = vg.make_shape(family)
    one = shape.geometry
    for name in ("centroid", "inertia", "areas", "matrix", "area_inertia"):
        if name in dir(one) and (family, name) != ("sheet", "inertia"):
            kept = getattr(one, name)
            assert kept is not getattr(one, name) or not kept.flags.writeable, name
    if isinstance(one, Triangles):
        again = pickle.loads(pickle.dumps(one))
        assert not again.vertices.flags.writeable
        # what was cached stays behind
        assert list(vars(again)) == ["points", "corners"]
        assert type(again) is type(one)


@pytest.mark.parametrize("record", [{1: 2.0}, {"a": object()}, {"a": np.array(["b"])}])
def test_a_record_holds_plain_values_and_arrays(record):
    with pytest.raises(InputError, match="record"):
        vg.Shape.of(vg.make_shape("box").geometry, name="box", record=record)


@pytest.mark.parametrize("factor", [1e-9, 1.0, 1e9])
def test_the_offset_is_scaled_with_the_shape(factor):
    shape = vg.Shape.from_mesh(*vg.Box((1, 2, 3), origin=(4, 5, 6)).mesh(), unit="m")
    vertices = shape.vertices + shape.offset
    other = vg.Shape.from_mesh(vertices * factor, shape.faces)
    np.testing.assert_allclose(shape.scaled(factor).offset, other.offset, rtol=1e-14)
    np.testing.assert_allclose(shape.scaled(factor).offset, factor * np.array([4.5, 6.0, 7.5]), rtol=1e-14)
    np.testing.assert_allclose(shape.to_unit("mm").offset, [4500.0, 6000.0, 7500.0], rtol=1e-14)
