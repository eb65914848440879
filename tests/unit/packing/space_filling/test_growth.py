"""Spheres that grow from nuclei until they touch, against a plain twin over all pairs."""

import itertools

import numpy as np
import pytest

import voxgran as vg

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")


def grown(container, **options):
    """Return a packing that is proven to be free of overlap."""
    shape = DISK if container.dimension == 2 else SPHERE
    packing = vg.pack(shape, container, method="growth", **options)
    assert vg.verify(packing).ok
    return packing


def grown_by_all_pairs(points, container):
    """Return the radii of spheres that grow from points at equal rates: the next contact among all pairs, in turn."""
    d = container.dimension
    span = (container.bounds[1] - container.bounds[0])[:d]
    step = points[:, None, :d] - points[None, :, :d]
    step -= np.where(container.periodic[:d], np.round(step / span) * span, 0.0)
    apart = np.linalg.norm(step, axis=2)
    np.fill_diagonal(apart, np.inf)
    room = np.minimum(
        -np.asarray(container.signed_distance(points)), np.where(container.periodic[:d], span / 2, np.inf).min()
    )
    radius, growing = np.zeros(len(points)), np.ones(len(points), dtype=bool)
    while growing.any():
        both = np.where(growing[:, None] & growing, apart / 2, np.inf)
        one = np.where(growing[:, None] & ~growing, apart - radius, np.inf)
        time = np.minimum(np.minimum(both, one).min(axis=1), np.where(growing, room, np.inf))
        now = np.argmin(time)
        radius[now], growing[now] = time[now], False
        other = np.argmin(both[now])
        if both[now, other] == time[now]:
            radius[other], growing[other] = time[now], False
    return radius


@pytest.mark.parametrize(
    "container",
    [
        vg.Box((4, 5, 6), periodic="xy"),
        vg.Box((4, 4, 4), periodic="xyz"),
        vg.Rectangle((5, 4)),
        vg.Rectangle((5, 4), periodic="xy"),
        vg.Cylinder(2, 4),
        vg.Polygon([(0, 0), (4, 0), (4, 2), (2, 2), (2, 4), (0, 4)]),
    ],
    ids=str,
)
def test_radii_are_those_of_all_pairs(container):
    packing = grown(container, count=150)
    assert packing.diameter / 2 == pytest.approx(grown_by_all_pairs(packing.position, container), abs=1e-12)


@pytest.mark.parametrize(("arrival", "slowest"), [("together", 0.1), ("continuous", 1.0), ("continuous", 0.3)])
@pytest.mark.parametrize("container", [vg.Box((4, 4, 4)), vg.Rectangle((6, 6), periodic="x")], ids=str)
def test_every_sphere_touches_another_or_a_wall(container, arrival, slowest):
    packing = grown(container, count=800, arrival=arrival, slowest=slowest)
    contacts = packing.contacts(1e-9)
    touched = np.zeros(packing.count, dtype=bool)
    touched[contacts.i] = touched[contacts.j] = True
    at_wall = -np.asarray(container.signed_distance(packing.position)) - packing.diameter / 2 < 1e-9
    assert (touched | at_wall).all()
    assert contacts.gap.min() > -1e-13


def test_slow_and_fast_growth():
    box = vg.Box((5, 5, 5), periodic="xyz")
    # nuclei that are all there; those that arrive while others grow give more, the faster these grow
    together = [grown(box, count=20_000, seed=seed).solid_fraction for seed in range(3)]
    assert np.mean(together) == pytest.approx(0.186, abs=0.003)
    fractions = [grown(box, count=5000, arrival="continuous", speed=speed).solid_fraction for speed in (1.0, 5.0, 50.0)]
    assert 0.186 < fractions[0] < fractions[1] < fractions[2]


def test_growth_that_is_faster_than_all_arrivals_is_random_apollonian():
    # each sphere has stopped when the next nucleus arrives: it has the largest radius that fits
    square = vg.Rectangle((5, 5), periodic="xy")
    packing = grown(square, count=300, arrival="continuous", speed=1e7)
    x, r = packing.position[:, :2], packing.diameter / 2
    step = x[:, None] - x
    apart = np.linalg.norm(step - np.round(step / 5) * 5, axis=2) - r
    for n in range(1, 300):
        assert r[n] == pytest.approx(min(apart[n, :n].min(), 2.5), abs=1e-9)


@pytest.mark.parametrize("options", [{}, {"arrival": "continuous", "slowest": 0.3}])
def test_the_solid_fraction_is_met_exactly(options):
    packing = grown(vg.Box((4, 4, 4)), count=3000, solid_fraction=0.12, **options)
    assert packing.stop_reason == "solid_fraction"
    assert packing.solid_fraction == pytest.approx(0.12, abs=1e-12)


@pytest.mark.slow
def test_a_solid_fraction_beyond_reach_is_missed_with_a_warning():
    with pytest.warns(UserWarning, match=r"the solid fraction is 0\.3\d* instead of 0\.9"):
        packing = grown(vg.Rectangle((4, 4)), solid_fraction=0.9)
    assert packing.stop_reason == "full"


def test_rates_of_growth_lie_in_their_range():
    # without contacts radii are rates times the time
    box = vg.Box((4, 4, 4), periodic="xyz")
    fast, slow = [grown(box, count=4000, solid_fraction=1e-9, slowest=s).diameter for s in (1.0, 0.25)]
    assert np.ptp(fast) == pytest.approx(0.0, abs=1e-12)
    share = slow / slow.max()
    assert 0.25 <= share.min() < 0.26
    assert share.mean() == pytest.approx(0.625, abs=0.02)


def test_grains_of_a_start_do_not_grow():
    box = vg.Box((4, 4, 4))
    start = grown(box, count=50)
    packing = grown(box, count=200, start=start)
    assert packing.count == 250
    assert packing.diameter[:50] == pytest.approx(start.diameter, rel=1e-14)
    assert packing.position[:50] == pytest.approx(start.position, rel=1e-14)


def test_many_reaches_are_doubled_in_an_almost_empty_box():
    for container, count in itertools.product([vg.Box((1, 1, 100)), vg.Rectangle((100, 1), periodic="x")], [1, 2, 3]):
        packing = grown(container, count=count)
        assert packing.diameter / 2 == pytest.approx(grown_by_all_pairs(packing.position, container), abs=1e-10)
