"""Distances of convex bodies, proven by planes that separate them, at both accuracies that the rooms above ask for."""

import math

import numpy as np
import pytest
from kit import slow

from voxgran._base.kernels import bare_kernel, kernel
from voxgran.geometry.gjk import Accuracy, new_simplex, search_distance
from voxgran.geometry.support import BOX, CONE, CYLINDER, ELLIPSOID, POINT, TRIANGLE, support

PAIRS = 1000
FAST, EXACT = Accuracy(1e-11, 1e-14, 64, 4), Accuracy(0.0, 1e-15, 500, 20)


@bare_kernel
def support_of_row(row, at, x, y, z):
    """Return the support point of a row, as the search asks for it."""
    px, py, pz = support(row, 0.0, x, y, z)
    return px, py, pz, at


@kernel
def fast_distance(one, two, x, y, z, limit, simplex):
    """Return the distance of two rows, as beds are searched."""
    start = (x, y, z)
    return search_distance(support_of_row, one, two, start, start, limit, FAST, None, simplex, 0)


@kernel
def exact_distance(one, two, x, y, z, limit, simplex):
    """Return the distance of two rows, as packings are verified."""
    start = (x, y, z)
    return search_distance(support_of_row, one, two, start, start, limit, EXACT, 1, simplex, 0)


def rows(kinds, rng):
    """Return rows of random solids; a tenth of them lies along the axes and a fifth is thin."""
    kind = rng.choice(kinds, PAIRS)
    size = rng.uniform(0.2, 1.5, (PAIRS, 3))
    size[rng.random(PAIRS) < 0.2, 1] *= 0.05
    turn = np.linalg.qr(rng.normal(size=(PAIRS, 3, 3)))[0]
    turn[rng.random(PAIRS) < 0.1] = np.eye(3)
    row = np.column_stack([kind, size, turn.reshape(PAIRS, 9)])
    row[kind == TRIANGLE, 1:4] = 0.0
    row[kind == POINT, 1:] = 0.0
    return row


def pairs():
    """Return two rows each and the place of the second, from deep overlaps to far apart."""
    rng = np.random.default_rng(11)
    way = rng.normal(size=(PAIRS, 3))
    way *= (rng.uniform(0.05, 3.0, PAIRS) / np.linalg.norm(way, axis=1))[:, None]
    way[rng.random(PAIRS) < 0.1, :2] = 0.0
    solids = [POINT, ELLIPSOID, BOX, CYLINDER, CONE]
    return rows(solids, rng), rows([*solids, TRIANGLE], rng), way


def gap_along(one, two, place, normal):
    """Return the distance of the support planes of two rows along a unit normal: no more than that of the solids."""
    reach = np.dot(support.plain(one, 0.0, *normal), normal)
    return np.dot(np.add(support.plain(two, 0.0, *-normal), place), normal) - reach


@pytest.mark.parametrize(("search", "close"), [(fast_distance, 2e-5), slow(exact_distance, 1e-7)])
def test_a_distance_is_that_of_two_planes_which_separate_the_solids(search, close):
    simplex, apart = new_simplex(), 0
    for one, two, place in zip(*pairs(), strict=True):
        distance = search(one, two, *place, 1e150, simplex)
        if distance <= 1e-9:
            continue
        apart += 1
        step, point = simplex.near[:3], simplex.near[3:]
        assert math.isclose(np.linalg.norm(step), distance, rel_tol=1e-12)
        # the two planes through the nearest points bound the distance from below
        assert gap_along(one, two, place, step / distance) == pytest.approx(distance, rel=1e-13, abs=close)
        # and the nearest points lie on the solids, whose sections along the normal they are
        assert np.dot(point, step) <= np.dot(support.plain(one, 0.0, *step), step) + 1e-12
    assert apart > PAIRS // 4


def test_both_accuracies_agree():
    fast, exact = new_simplex(), new_simplex()
    for one, two, place in zip(*pairs(), strict=True):
        distance = exact_distance(one, two, *place, 1e150, exact)
        other = fast_distance(one, two, *place, 1e150, fast)
        assert max(other, 0.0) == pytest.approx(max(distance, 0.0), abs=1e-6)


def test_solids_that_nearly_touch_are_apart():
    simplex, near, tried = new_simplex(), 1e-6, 0
    for one, two, place in zip(*pairs(), strict=True):
        distance = exact_distance(one, two, *place, 1e150, simplex)
        if distance <= 1e-3:
            continue
        step = simplex.near[:3] / distance
        beyond = distance - gap_along(one, two, place, step)
        # the nearest points are now that near, and the planes still separate the solids
        distance = exact_distance(one, two, *(place - (distance - near) * step), 1e150, simplex)
        tried += 1
        assert near - beyond - 1e-10 <= distance <= near + 1e-10
    assert tried > PAIRS // 4


def test_a_search_ends_with_a_lower_bound_above_the_limit():
    box = np.array([BOX, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    simplex, place = new_simplex(), np.array([3.0, 0.4, 0.0])
    bound = fast_distance(box, box, *place, 0.5, simplex)
    assert 0.5 < bound <= 2.0
    normal = simplex.near[:3] / np.linalg.norm(simplex.near[:3])
    assert gap_along(box, box, place, normal) == pytest.approx(bound, rel=1e-12)
