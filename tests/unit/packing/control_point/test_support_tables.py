"""Reaches and planes between grains against hulls, fields and points."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.geometry.rotation import rotation_matrices
from voxgran.packing.control_point.distance_fields import distances, make_fields, make_reaches, plane_of
from voxgran.packing.control_point.separating_planes import find_plane, write_span
from voxgran.points.control import sample_controls
from voxgran.shapes.spheres import Spheres

CLUMP = Spheres(np.array([[0.0, 0, 0], [0.6, 0, 0], [0.1, 0.5, 0.1]]), np.array([0.5, 0.4, 0.3]))
SHAPES = {
    "clump": vg.Shape.of(CLUMP, name="clump"),
    "box": vg.make_shape("box", lengths=(1.0, 0.8, 0.6)),
    "octahedron": vg.make_shape("platonic", solid="octahedron"),
    "ellipsoid": vg.make_shape("ellipsoid", aspect=(1.2, 1.0, 0.8)),
    "cylinder": vg.make_shape("cylinder"),
    "cone": vg.make_shape("cone"),
    "rod": vg.make_shape("spherocylinder"),
    "union": vg.make_shape("solid_union", seed=3),
    "polygon": vg.make_shape("polygon", seed=1),
}


def known(name, spacing=0.25):
    shape = SHAPES[name].scaled(1 / SHAPES[name].diameter)
    points = np.asarray(sample_controls(shape, spacing=spacing))
    fields = make_fields([shape], [points], cell=spacing / 3)
    return shape, points, fields, make_reaches([shape], [points], fields)


def directions(shape, many, seed=0):
    ways = np.random.Generator(np.random.Philox(seed)).normal(size=(many, 3))
    # along axes and in planes between octants too
    ways[::7, 0], ways[::11, 1:] = 0.0, 0.0
    if shape.dimension == 2:
        ways[:, 2] = 0.0
    ways = ways[np.linalg.norm(ways, axis=1) > 0]
    return ways / np.linalg.norm(ways, axis=1)[:, None]


def reached(reaches, ways):
    return np.array([np.dot(plane_of(reaches.values, 0, *way), way) for way in ways])


@pytest.mark.parametrize("name", SHAPES)
def test_no_point_lies_beyond_the_reach_and_it_is_tight(name):
    shape, points, _, reaches = known(name)
    ways = directions(shape, 2000)
    told = reached(reaches, ways)
    true = (ways @ np.concatenate([shape.vertices, points]).T).max(axis=1)
    assert (told >= true).all()
    # fields of cylinders and cones tell less than distances off their edges
    assert (told - true).mean() < (0.1 if name in ("cylinder", "cone") else 0.005)


@pytest.mark.parametrize("name", SHAPES)
def test_beyond_a_plane_a_field_tells_the_distance_from_it(name):
    """Random places near the surface: what the field tells is no less than the way beyond any plane."""
    shape, _, fields, reaches = known(name)
    ways = directions(shape, 400)
    places = (2 * np.random.Generator(np.random.Philox(1)).random((20_000, 3)) - 1) * 0.9
    if shape.dimension == 2:
        places[:, 2] = 0.0
    told = distances(fields, 0, places)
    for low in (-0.03, 0.0, 0.02):
        assert low <= reaches.limit[0]
        wide = low * reaches.stretch[0] if low > 0 else low
        beyond = (ways @ places[told < low].T).max(axis=1) - reached(reaches, ways)
        assert (beyond <= wide).all()


@pytest.mark.parametrize("name", ["box", "union", "ellipsoid"])
def test_planes_never_part_what_points_say_is_near(name):
    """300 pairs: where a plane is found, no point of either is nearer than `low`; most free boxes are told apart."""
    _, points, fields, reaches = known(name)
    generator, low, found, free = np.random.Generator(np.random.Philox(2)), 0.01, 0, 0
    wide = low * reaches.stretch[0]
    for _ in range(300):
        turns = generator.normal(size=(2, 4))
        turns /= np.linalg.norm(turns, axis=1)[:, None]
        one, other = rotation_matrices(turns)
        offset, size = generator.normal(size=3), 0.7
        offset *= (0.5 + 0.7 * generator.random()) / np.linalg.norm(offset)
        there = distances(fields, 0, (size * points @ one.T + offset) @ other).min()
        back = size * distances(fields, 0, (points @ other.T - offset) @ one / size).min()
        way = np.array([*(offset / np.linalg.norm(offset)), 0.0, 0.0, 0.0, -np.inf])
        apart = find_plane(reaches.values, (0, size, one), (0, 1.0, turns[1]), tuple(offset), wide, way, 6)
        if apart:
            assert min(there, back) >= low
            best, spans = way[3:6], np.stack([points @ other.T, size * points @ one.T + offset])
            assert (spans[1] @ best).min() - (spans[0] @ best).max() >= wide
            assert way[6] > wide
        free += min(there, back) > low
        found += apart
    assert found > (0.8 if name != "union" else 0.5) * free > 50


def test_span_holds_the_grain():
    shape, points, _, reaches = known("union")
    for turn in rotation_matrices(directions(shape, 20)[:, [0, 1, 2, 0]] / 1.5):
        matrix, _ = np.linalg.qr(turn)
        span = np.zeros(6)
        write_span(reaches.values, 0, 1.7, matrix, span)
        placed = 1.7 * points @ matrix.T
        assert (span[::2] <= placed.min(axis=0)).all()
        assert (span[1::2] >= placed.max(axis=0)).all()
        assert np.abs(span[1::2] - placed.max(axis=0)).max() < 0.1
