"""Random points that get the largest sphere that fits."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.distance import cdist

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
L_SHAPE = vg.Polygon([(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)])


def filled(container, **options):
    """Return a packing that is proven to be free of overlap."""
    shape = DISK if container.dimension == 2 else SPHERE
    packing = vg.pack(shape, container, method="random_apollonian", **options)
    assert vg.verify(packing).ok
    return packing


def gaps(packing):
    """Return the gap of each grain to all earlier ones and to the walls, by all images (a plain twin)."""
    container, d = packing.container, packing.dimension
    x, r = packing.position, packing.diameter / 2
    span = (container.bounds[1] - container.bounds[0])[:d]
    step = x[:, None, :d] - x[None, :, :d]
    step -= np.where(container.periodic[:d], np.round(step / span) * span, 0.0)
    apart = np.linalg.norm(step, axis=2) - r[:, None] - r
    apart[np.triu_indices(len(x))] = np.inf
    walls = -np.asarray(container.signed_distance(x)) - r
    images = np.where(container.periodic[:d], span / 2, np.inf).min() - r
    return apart.min(axis=1), walls, images


CONTAINERS = [
    vg.Box((4, 5, 6), periodic="xy"),
    vg.Box((4, 4, 4)),
    vg.Rectangle((5, 4), periodic="x"),
    vg.Cylinder(2, 4),
    vg.Sphere(3),
    vg.Disk(3),
    L_SHAPE,
    vg.ClosedMesh(vg.make_shape("solid_union", seed=1).scaled(5.0)),
]


@pytest.mark.parametrize("container", CONTAINERS, ids=lambda c: c.kind)
def test_each_sphere_touches_an_earlier_one_or_a_wall(container):
    others, walls, images = gaps(filled(container, count=150, largest=20.0))
    nearest = np.minimum(np.minimum(others, walls), images)
    assert np.abs(nearest).max() < 1e-12


@pytest.mark.parametrize("container", CONTAINERS[:3], ids=lambda c: c.kind)
def test_shifted_spheres_touch_two_others(container):
    packing = filled(container, count=150, shift=1)
    others, walls, images = gaps(packing)
    largest = 0.25 * np.ptp(container.bounds, axis=0)[: packing.dimension].min()
    free = packing.diameter < largest * (1 - 1e-9)
    assert np.abs(np.minimum(np.minimum(others, walls), images))[free].max() < 1e-8
    contacts = packing.contacts(1e-7)
    touched = np.bincount(np.concatenate([contacts.i, contacts.j]), minlength=packing.count)
    (low, high), radius = container.bounds, packing.diameter[:, None] / 2
    at_wall = (packing.position - low < radius + 1e-7).astype(int) + (high - packing.position < radius + 1e-7)
    touched += at_wall[:, : packing.dimension][:, np.logical_not(container.periodic[: packing.dimension])].sum(axis=1)
    assert (touched[free] >= 2).all()


def test_spheres_that_shift_fill_more():
    box = vg.Box((5, 5, 5), periodic="xyz")
    fractions = [filled(box, count=1000, largest=1.25, shift=k).solid_fraction for k in (0, 1, 3)]
    assert fractions[0] + 0.05 < fractions[1] < fractions[2]


def test_shrunk_spheres_keep_a_gap_of_their_share():
    packing = filled(vg.Box((4, 4, 4)), count=200, shrink=0.25, largest=4.0)
    others, walls, images = gaps(packing)
    nearest = np.minimum(np.minimum(others, walls), images)
    assert nearest == pytest.approx(packing.diameter / 2 / 3, rel=1e-9)


def test_the_solid_fraction_is_met_exactly():
    for container in (vg.Box((4, 4, 4)), L_SHAPE):
        packing = filled(container, solid_fraction=0.55)
        assert packing.stop_reason == "solid_fraction"
        assert packing.solid_fraction == pytest.approx(0.55, abs=1e-12)


def test_diameters_stay_in_their_limits():
    packing = filled(vg.Box((4, 4, 4)), smallest=0.2, largest=1.0)
    assert packing.stop_reason == "full"
    assert packing.diameter.min() >= 0.2
    assert packing.diameter.max() == pytest.approx(1.0, rel=1e-12)
    # no point that is free has room for a sphere that is much larger than the smallest
    points = np.random.default_rng(0).random((4000, 3)) * 4
    room = (cdist(points, packing.position) - packing.diameter / 2).min(axis=1)
    room = np.minimum(room, np.minimum(points, 4 - points).min(axis=1))
    assert (room > 0.1).mean() < 2e-3
    with pytest.raises(InputError, match="smallest is 2 and largest is 1"):
        vg.pack(SPHERE, vg.Box((4, 4, 4)), method="random_apollonian", smallest=2.0, largest=1.0)


def test_a_largest_diameter_alone_packs_smaller_ones_too():
    packing = filled(vg.Rectangle((0.3, 0.3)), largest=0.06)
    assert packing.count > 100
    assert 0.006 <= packing.diameter.min() < packing.diameter.max() <= 0.06


@pytest.mark.parametrize("container", [vg.Box((4, 5, 6), periodic="xyz"), vg.Rectangle((4, 5), periodic="xy"), L_SHAPE])
@pytest.mark.parametrize("shift", [0, 1])
def test_the_largest_diameter_is_by_default_a_quarter_of_the_shortest_edge(container, shift):
    diameter = filled(container, count=40, shift=shift).diameter
    assert diameter.max() == pytest.approx(1.0, rel=1e-12)


def test_a_smallest_diameter_above_the_default_of_the_largest_is_refused():
    options = {"container": vg.Box((4, 4, 4)), "method": "random_apollonian", "smallest": 1.2}
    with pytest.raises(InputError, match=r"smallest is 1\.2, and largest is by default 1, a quarter .*; give largest"):
        vg.pack(SPHERE, **options)
    assert vg.pack(SPHERE, largest=3.0, **options).diameter.min() >= 1.2


def test_an_empty_packing_is_told():
    options = {"method": "random_apollonian", "smallest": 100.0, "largest": 200.0}
    with pytest.warns(PackingWarning, match="no grain is packed"):
        assert not vg.pack(SPHERE, vg.Box((4, 4, 4)), **options).count


def dimension_of(diameter, first=50):
    """Return the exponent of the number of larger spheres, by maximum likelihood.

    The distribution is complete above the largest of the spheres that came in the last half.
    """
    low = diameter[len(diameter) // 2 :].max()
    ranked = np.sort(diameter)[::-1]
    high, used = ranked[first], ranked[first : np.searchsorted(-ranked, -low)]
    mean, width = np.log(used / low).mean(), np.log(high / low)
    return brentq(lambda a: 1 / a - width / np.expm1(a * width) - mean, 0.1, 10)


@pytest.mark.slow
@pytest.mark.parametrize(("container", "published"), [(vg.Rectangle((9, 9), periodic="xy"), 1.564)])
def test_the_exponent_of_disks_is_the_published_one(container, published):
    # Dodds & Weitz 2002: 2.564 of the density of sizes
    found = [dimension_of(filled(container, count=60_000, seed=seed).diameter) for seed in range(4)]
    assert np.mean(found) == pytest.approx(published, abs=0.03)


@pytest.mark.slow
def test_the_exponent_of_spheres_is_the_published_one():
    # Dodds & Weitz 2002: 3.733 of the density of sizes
    box = vg.Box((9, 9, 9), periodic="xyz")
    found = [dimension_of(filled(box, count=300_000, seed=seed).diameter) for seed in range(4)]
    assert np.mean(found) == pytest.approx(2.733, abs=0.06)
