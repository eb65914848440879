"""The solid fraction that the one-dimensional theory of Farr & Groot 2009 expects."""

import heapq

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.packing.jamming.expected import GAP, reachable


def rods_one_by_one(diameters, share, count, generator):
    """Return the fraction by the rule of the paper, told plainly: rods by random lines, the longest gap is filled."""
    # lines meet spheres by their cross sections
    chosen = generator.choice(diameters, size=count, p=diameters**2 / (diameters**2).sum())
    rods = np.sort(chosen * np.sqrt(generator.random(count)))[::-1]
    gaps = [-share * rods[0]]
    for rod in rods[1:]:
        widest = -heapq.heappop(gaps)
        heapq.heappush(gaps, -share * rod)
        heapq.heappush(gaps, -max(share * rod, widest - (1 + share) * rod))
    return rods.sum() / (rods.sum() - sum(gaps))


def test_equal_spheres_have_the_value_of_the_paper():
    assert vg.expected_solid_fraction(vg.sizes.fixed(3.0)) == pytest.approx(0.6435, abs=2e-4)


def test_two_sizes_of_a_large_ratio_come_to_the_fraction_of_filled_gaps():
    # spheres in the gaps of spheres: 1 - (1 - 0.6435)^2 = 0.873, at a volume share of the small ones of 0.263
    huge = 1000.0
    sizes = vg.sizes.discrete([1.0, huge], [0.263, 0.737], basis="volume")
    assert vg.expected_solid_fraction(sizes) == pytest.approx(1 - (1 - 0.6435) ** 2, abs=0.02)


@pytest.mark.parametrize("sigma", [0.2, 0.6])
def test_the_rule_is_that_of_a_plain_program(sigma):
    generator = np.random.default_rng(1)
    diameters = generator.lognormal(0.0, sigma, 20_000)
    plain = np.mean([rods_one_by_one(diameters, GAP[3], 20_000, generator) for _ in range(3)])
    assert reachable(diameters, 3) == pytest.approx(plain, abs=2e-3)
    assert vg.expected_solid_fraction(vg.sizes.lognormal(5.0, sigma)) == pytest.approx(plain, abs=6e-3)


def test_a_wider_gradation_packs_denser_and_units_do_not_matter():
    found = [vg.expected_solid_fraction(vg.sizes.lognormal(1.0, sigma)) for sigma in (0.01, 0.2, 0.4, 0.6, 0.8)]
    assert (np.diff(found) > 0.002).all()
    again = vg.expected_solid_fraction(vg.sizes.lognormal(1e-3, 0.4))
    assert again == pytest.approx(found[2], abs=1e-9)


def test_disks_of_two_sizes_have_their_published_value():
    two = vg.sizes.discrete([1.0, 1.4], [1, 1])
    # O'Hern et al. 2003
    assert vg.expected_solid_fraction(two, dimension=2) == pytest.approx(0.842, abs=1e-3)


def test_wrong_calls_are_refused():
    with pytest.raises(
        InputError, match=r"sizes is 0.5: it must be a size distribution; for one size give sizes.fixed"
    ):
        vg.expected_solid_fraction(0.5)
    with pytest.raises(InputError, match="dimension is 4"):
        vg.expected_solid_fraction(vg.sizes.fixed(), dimension=4)
