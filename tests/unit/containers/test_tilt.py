"""Tilted periodic cells: their lattice, wrapping, and what is proved in them."""

import itertools
import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.containers.model import periods_of, within_periods
from voxgran.containers.stretch import stretched
from voxgran.geometry.periods import face_distances, nearest_turns, shortest_period, turns_of, upright_turns

TILTS = [(1.2, -0.9, 1.6), (2.0, 2.0, -2.5), (0.0, 0.0, 1.0), (0.3, 0.0, 0.0)]
#: edges of the primitive cells of densest packings of unit spheres, and the number of spheres that they hold
FCC = np.sqrt(0.5) * np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
HCP = np.array([[1.0, 0.0, 0.0], [0.5, math.sqrt(0.75), 0.0], [0.0, 0.0, math.sqrt(8 / 3)]])


def box_of(edges):
    """Return the box of the same lattice, turned, whose first edge is along x."""
    vectors = np.linalg.cholesky(edges @ edges.T)
    return vg.Box(np.diag(vectors), "xyz", tilt=vectors[np.tril_indices(3, -1)])


def lattice_points(periods, most):
    return np.array(list(itertools.product(range(-most, most + 1), repeat=3))) @ periods


@pytest.mark.parametrize("tilt", TILTS)
def test_what_is_wrapped_is_the_same_point_of_the_lattice_in_the_cell(tilt):
    box = vg.Box((4, 4, 5), "xyz", tilt=tilt, origin=(1, -2, 0.5))
    points = stream(0, "points").normal(size=(200, 3)) * 9
    inside, periods = within_periods(points, box), periods_of(box)
    shares = (inside - box.origin) @ np.linalg.inv(box.vectors)
    assert shares.min() > -1e-12
    assert shares.max() < 1 + 1e-12
    turns = (points - inside) @ np.linalg.inv(box.vectors)
    assert turns == pytest.approx(np.rint(turns), abs=1e-12)
    assert not turns_of(inside, np.array(box.origin), periods).any()
    upright = points - upright_turns(points, np.array(box.origin), periods) @ periods
    assert (upright >= box.bounds[0] - 1e-12).all()
    assert (upright <= box.bounds[1] + 1e-12).all()


@pytest.mark.parametrize("tilt", TILTS)
def test_the_nearest_image_and_the_shortest_period_are_those_of_all_images(tilt):
    periods = periods_of(vg.Box((4, 4, 5), "xyz", tilt=tilt))
    away = stream(1, "points").uniform(-6, 6, size=(50, 3))
    every = lattice_points(periods, 5)
    nearest = np.linalg.norm(away[:, None] - every, axis=2).min(axis=1)
    assert np.linalg.norm(away - nearest_turns(away, periods) @ periods, axis=1) == pytest.approx(nearest, rel=1e-12)
    lengths = np.linalg.norm(every, axis=1)
    assert shortest_period(periods) == pytest.approx(lengths[lengths > 0].min(), rel=1e-12)
    volume = np.linalg.det(periods)
    faces = [np.linalg.norm(np.cross(periods[a], periods[b])) for a, b in ((1, 2), (2, 0), (0, 1))]
    assert face_distances(periods) == pytest.approx(volume / np.array(faces), rel=1e-12)


@pytest.mark.parametrize(
    ("lengths", "tilt"),
    [((10, 10, 1), (5, 5, 5)), ((10, 10, 1), (3.3, 5, -4.9)), ((10, 2, 0.7), (5, 4, 1)), ((12, 1, 12), (6, 0, 0.5))],
)
def test_the_nearest_image_in_flat_cells_is_that_of_all_images(lengths, tilt):
    # cells across the nearest face and beside it do not hold the nearest image there
    periods = periods_of(vg.Box(lengths, "xyz", tilt=tilt))
    away = stream(2, "points").uniform(-9, 9, size=(60, 3))
    every = lattice_points(periods, 30)
    nearest = cKDTree(every).query(away)[0]
    turns = nearest_turns(away, periods)
    assert np.linalg.norm(away - turns @ periods, axis=1) == pytest.approx(nearest, rel=1e-9)
    assert turns.dtype == np.int64
    flat = periods_of(vg.Rectangle(lengths[:2], "xy", tilt=tilt[0]))
    turns = nearest_turns(away * (1, 1, 0), flat)
    nearest = cKDTree(lattice_points(flat, 30)).query(away * (1, 1, 0))[0]
    assert np.linalg.norm(away * (1, 1, 0) - turns @ flat, axis=1) == pytest.approx(nearest, rel=1e-9)


def test_tilts_are_brought_within_half_a_length():
    assert vg.Box((4, 5, 6), "xyz", tilt=(8, -4, 10)) == vg.Box((4, 5, 6), "xyz")
    box = vg.Box((4, 5, 6), "xyz", tilt=(3, 1, 4))
    assert box.tilt == (-1, -2, -1)
    # the same lattice: the edges as given are sums of the edges that it has
    given = np.array([[4.0, 0, 0], [3, 5, 0], [1, 4, 6]])
    counts = given @ np.linalg.inv(box.vectors)
    assert counts == pytest.approx(np.rint(counts), abs=1e-12)
    assert vg.Rectangle((4, 5), "xy", tilt=-3).tilt == (1,)
    assert box.scaled(0.1).tilt == pytest.approx((-0.1, -0.2, -0.1))
    assert vg.make_container(box.to_mapping()) == box
    assert "tilt" not in vg.Box((4, 5, 6), "xyz").to_mapping()
    assert stretched(box, (2, 3, 4)).tilt == (-2, -4, -3)
    assert box.volume == 120
    vertices, faces = box.mesh()
    corners = vertices[faces] - vertices.mean(axis=0)
    assert np.linalg.det(corners).sum() / 6 == pytest.approx(120)


@pytest.mark.parametrize(
    ("periodic", "tilt", "words"),
    [
        ("xy", (0, 0, 1), "tilt yz is 1: the box must be periodic along y and z"),
        ("yz", (1, 0, 0), "tilt xy is 1: the box must be periodic along x and y"),
        ("", (0, 1, 0), "tilt xz is 1"),
        ("xyz", (1, 0), "tilt"),
        ("xyz", (1, 0, math.nan), "tilt"),
        ("xyz", "xy", "tilt"),
    ],
)
def test_bad_tilts_are_refused(periodic, tilt, words):
    with pytest.raises(InputError, match=words) as caught:
        vg.Box((4, 5, 6), periodic, tilt=tilt)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="tilt xy is 1: the rectangle must be periodic along x and y"):
        vg.Rectangle((4, 5), "x", tilt=1)
    with pytest.raises(InputError, match="leave the tilt out"):
        vg.Box((4, 5, 6), "xyz", tilt=(1, 0, 0)).with_periodic("yz")


@pytest.mark.parametrize(("edges", "places"), [(FCC, [[0, 0, 0]]), (HCP, [[0, 0, 0], [1 / 3, 1 / 3, 1 / 2]])])
def test_densest_packings_in_their_primitive_cells(edges, places):
    box = box_of(edges)
    position = np.array(places) @ box.vectors
    packing = vg.Packing.of(vg.make_shape("sphere"), box, position=position)
    assert packing.solid_fraction == pytest.approx(math.pi / math.sqrt(18), rel=1e-12)
    found = packing.contacts(1e-9)
    assert found.count == 6 * len(places)
    assert np.abs(found.gap).max() < 1e-12
    assert packing.verify().ok
    # one part in a million more, and each contact is an overlap
    wide = vg.Packing.of(vg.make_shape("sphere"), box, position=position, scale=np.full(len(places), 1 + 1e-6))
    assert wide.verify().overlapping_pairs == 6 * len(places)
    assert wide.verify().deepest == pytest.approx(1e-6, rel=1e-3)


def test_a_grain_that_overlaps_an_image_across_each_tilted_face_is_found():
    box = vg.Box((6, 6, 6), "xyz", tilt=(2, -1, 2.5))
    for edge in box.vectors:
        # beside the first sphere, moved by an edge
        place = np.array([[3.0, 3.0, 3.0], np.add([3.95, 3.0, 3.0], edge)])
        found = vg.verify(vg.Packing.of(vg.make_shape("sphere"), box, position=place))
        assert (found.overlapping_pairs, found.deepest) == (1, pytest.approx(0.05))
        as_upright = vg.Packing.of(vg.make_shape("sphere"), vg.Box((6, 6, 6), "xyz"), position=place)
        assert as_upright.verify().ok or (edge == box.vectors[0]).all()


def test_the_same_lattice_by_other_edges_gives_the_same_contacts():
    # a cell twice as long along x, and the same with a tilt of one of its periods
    upright = vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 4), "xyz"), "jam", count=60, seed=1)
    lengths = np.array(upright.container.lengths)
    double = np.concatenate([upright.position, upright.position + np.eye(3)[0] * lengths[0]])
    shapes, scale = upright.shapes, np.tile(upright.scale, 2)
    boxes = [vg.Box(lengths * [2, 1, 1], "xyz", tilt=(t * lengths[0], 0, 0)) for t in (0, 1)]
    one, two = (vg.Packing.of(shapes, box, position=double, scale=scale) for box in boxes)
    gap = 0.01
    assert two.contacts(gap).count == one.contacts(gap).count == 2 * upright.contacts(gap).count
    assert np.sort(two.contacts(gap).gap) == pytest.approx(np.sort(one.contacts(gap).gap), abs=1e-12)
    names = ["density", "coordination", "rdf", "fabric"]
    first, second = one.measure(names), two.measure(names)
    for name in ("mean_coordination_number", "bulk_solid_fraction", "contact_anisotropy"):
        assert float(second[name]) == pytest.approx(float(first[name]), rel=1e-12)
    assert two.container.tilt[0] == pytest.approx(lengths[0])
    g, h = (tree["/profiles"].radial_distribution.values for tree in (first, second))
    assert len(g) > 10
    # the window reaches as far in both
    assert h[: len(g)] == pytest.approx(g[: len(h)], abs=1e-9)
