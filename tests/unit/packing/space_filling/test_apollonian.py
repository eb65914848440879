"""Exact gaskets, against Descartes, a search by brute force and the published exponents."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.packing.space_filling.gaskets import in_sphere, in_strip, in_triangle

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
TRIANGLE = np.array([(0.0, 0.0), (1.0, 0.0), (0.3, 0.9)])


def rows_of(gasket):
    return np.concatenate(list(gasket))


def exponent_of(curvature):
    """Return the exponent of the number of spheres up to a curvature, over the upper half of its logarithm."""
    curvature = np.sort(curvature)
    at = np.geomspace(curvature[-1] ** 0.5, curvature[-1], 60)
    return np.polyfit(np.log(at), np.log(np.searchsorted(curvature, at, side="right")), 1)[0]


@pytest.mark.parametrize(
    "gasket", [lambda most: in_sphere(2, most), in_strip, lambda most: in_triangle(TRIANGLE, most)], ids=["2", "=", "3"]
)
def test_the_exponent_in_the_plane_is_the_published_one(gasket):
    # McMullen 1998: 1.305686729
    assert exponent_of(rows_of(gasket(20_000.0))[:, 0]) == pytest.approx(1.305686729, rel=3e-3)


@pytest.mark.slow
def test_the_exponent_in_space_is_the_published_one():
    # Borkovec, De Paris & Peikert 1994: 2.4739465
    curvature = np.sort(rows_of(in_sphere(3, 400.0))[:, 0])
    at = np.geomspace(400**0.6, 400, 60)
    found = np.polyfit(np.log(at), np.log(np.searchsorted(curvature, at, side="right")), 1)[0]
    assert found == pytest.approx(2.4739465, rel=3e-3)


def test_areas_of_gaskets_fill_the_region():
    for rows, area in ((rows_of(in_sphere(2, 3e4)), np.pi), (rows_of(in_strip(3e4)), 1.0)):
        assert np.pi * (rows[:, 0] ** -2.0).sum() == pytest.approx(area, rel=2e-3)
    area = 0.5 * 0.9
    assert np.pi * (rows_of(in_triangle(TRIANGLE, 3e4))[:, 0] ** -2.0).sum() == pytest.approx(area, rel=2e-3)


def test_curvatures_of_a_symmetric_gasket_follow_descartes():
    # outer circle -1, three equal ones k: the sum's square is twice the sum of squares
    rows = rows_of(in_sphere(2, 30.0))
    k = 1 + 2 / np.sqrt(3)
    first = np.sort(rows[:, 0])[:4]
    assert first[:3] == pytest.approx(k, rel=1e-14)
    four = np.array([-1, *first[:3]])
    assert four.sum() ** 2 == pytest.approx(2 * (four**2).sum(), rel=1e-13)
    # the middle one, and those in the three outer gaps
    assert np.abs(rows[:, 0] - (6 * k + 1)).min() < 1e-12
    assert (np.abs(rows[:, 0] - (3 * k - 2)) < 1e-12).sum() == 3


def test_all_spheres_up_to_a_curvature_are_found():
    # all fives that exchanges lead to, up to a curvature that is far larger, by plain sets
    def name(row):
        return tuple(np.round(row, 5) + 0.0)

    most = 15.0
    first = np.array([*rows_of(in_sphere(3, 3.0))[:4], [-1.0, 0, 0, 0, 1.0]])
    fives, stack = {frozenset(map(name, first))}, [first]
    while stack:
        five = stack.pop()
        for old in range(5):
            child = five.copy()
            child[old] = five.sum(axis=0) - 2 * five[old]
            names = frozenset(map(name, child))
            if child[old, 0] <= 2.5 * most and names not in fives:
                fives.add(names)
                stack.append(child)
    wanted = sorted(row[0] for row in frozenset().union(*fives) if 0 < row[0] <= most)
    assert np.sort(rows_of(in_sphere(3, most))[:, 0]) == pytest.approx(np.array(wanted), abs=1e-4)


CONTAINERS = [
    (vg.Disk(3), DISK),
    (vg.Sphere(2), SPHERE),
    (vg.Rectangle((6, 2), periodic="x"), DISK),
    (vg.Rectangle((2, 4), periodic="y", origin=(1, 1)), DISK),
    (vg.Polygon([(5, 1), (9, 1.5), (6, 4)]), DISK),
]


@pytest.mark.parametrize(("container", "shape"), CONTAINERS, ids=lambda value: getattr(value, "kind", ""))
def test_gaskets_are_valid_and_their_grains_touch(container, shape):
    packing = vg.pack(shape, container, method="apollonian", count=800)
    assert packing.count == 800
    assert packing.stop_reason == "count"
    proof = vg.verify(packing, tolerance=1e-9)
    assert proof.ok, proof.summary()
    contacts = packing.contacts(1e-9)
    touched = np.bincount(np.concatenate([contacts.i, contacts.j]), minlength=800)
    at_wall = -np.asarray(container.signed_distance(packing.position)) - packing.diameter / 2 < 1e-9
    # each touches d + 1 that are larger, walls among them, but one toward a corner of a triangle, which has two walls
    assert (touched + at_wall >= (2 if container.kind == "polygon" else container.dimension)).all()
    assert (np.diff(packing.diameter) <= 1e-6).all()


def test_the_largest_that_fits_is_in_every_gap():
    packing = vg.pack(DISK, vg.Disk(1.0), method="apollonian", smallest=0.02)
    angle, radius = np.random.default_rng(0).random((2, 20_000)) * [[2 * np.pi], [1]]
    points = (
        np.sqrt(radius)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        + packing.container.bounds.mean(0)[:2]
    )
    room = (np.linalg.norm(points[:, None] - packing.position[:, :2], axis=2) - packing.diameter / 2).min(axis=1)
    assert np.minimum(room, 1 - np.sqrt(radius)).max() < 0.01


def test_count_solid_fraction_and_smallest_end_it():
    sphere = vg.Sphere(2)
    packing = vg.pack(SPHERE, sphere, method="apollonian", solid_fraction=0.8)
    assert packing.stop_reason == "solid_fraction"
    assert 0.8 <= packing.solid_fraction < 0.8 + np.pi / 6 * packing.diameter[-1] ** 3 / sphere.volume
    packing = vg.pack(SPHERE, sphere, method="apollonian", smallest=0.2)
    assert packing.stop_reason == "full"
    assert packing.diameter.min() >= 0.2 * (1 - 1e-12)
    assert vg.pack(SPHERE, sphere, method="apollonian").count == 10_000


def test_the_seed_turns_the_gasket():
    one, other = (vg.pack(DISK, vg.Disk(2), method="apollonian", count=50, seed=seed) for seed in (0, 1))
    assert one.diameter == pytest.approx(other.diameter, rel=1e-12)
    near = cKDTree(one.position).query(other.position)[0]
    assert near.max() > 0.1


@pytest.mark.parametrize(
    ("container", "words"),
    [
        (vg.Rectangle((4, 4)), "exact gaskets are in a disk"),
        (vg.Polygon([(0, 0), (1, 0), (1, 1), (0, 1)]), "exact gaskets are in a disk"),
        (vg.Rectangle((5, 2), periodic="x"), "2.5 times the other one"),
    ],
)
def test_containers_without_a_gasket_are_refused(container, words):
    with pytest.raises(InputError, match=words):
        vg.pack(DISK, container, method="apollonian", count=5)


@pytest.mark.slow
def test_more_grains_than_are_placed_are_refused():
    with pytest.raises(InputError, match="give a larger diameter, or the count"):
        vg.pack(DISK, vg.Disk(1.0), method="apollonian", smallest=2e-5)
