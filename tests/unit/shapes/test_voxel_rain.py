"""Rain of cubes: the kernel against a plain twin, exact laws of columns, growth exponents."""

import math

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.shapes.families.random.voxel_rain import VoxelRain, _fall, base_of, rained


def fall_plainly(column, heights, shape, rule, ties):
    """Return level and column of each cube and the heights, as the kernel writes them, cube by cube."""
    heights, levels, columns = heights.reshape(shape).copy(), [], []
    for own, tie in zip(column.tolist(), ties.tolist(), strict=True):
        x, y = divmod(own, shape[1])
        near = [(x, y - 1), (x, y + 1), (x - 1, y), (x + 1, y)]
        near = [(i, j) for i, j in near if 0 <= i < shape[0] and 0 <= j < shape[1] and heights[i, j] >= 0]
        if rule == "ballistic":
            top = max([heights[x, y] + 1, *(heights[place] for place in near)])
        elif rule == "relaxed":
            lowest = min([heights[x, y], *(heights[place] for place in near)])
            if lowest < heights[x, y]:
                equal = [place for place in near if heights[place] == lowest]
                x, y = equal[int(tie * len(equal))]
        if rule != "ballistic":
            top = heights[x, y] + 1
        heights[x, y] = top
        levels.append(top - 1)
        columns.append(x * shape[1] + y)
    return np.array(levels), np.array(columns), heights.ravel()


@pytest.mark.parametrize("rule", ["ballistic", "random", "relaxed"])
@pytest.mark.parametrize("base", ["rectangle", "ellipse"])
def test_cubes_fall_as_those_of_a_plain_twin(rule, base):
    mask = base_of(VoxelRain(width=(6, 9), base=base))
    generator = stream(3, rule)
    column = np.flatnonzero(mask)[generator.integers(int(mask.sum()), size=800)]
    ties, heights = generator.random(800), np.where(mask, 0, -1).ravel()
    levels, columns, expected = fall_plainly(column, heights, mask.shape, rule, ties)
    level = np.empty(800, dtype=np.int64)
    _fall(column, level, heights, 9, ["ballistic", "random", "relaxed"].index(rule), ties)
    assert (level == levels).all()
    assert (column == columns).all()
    assert (heights == expected).all()


@pytest.mark.parametrize("rule", ["ballistic", "random", "relaxed"])
def test_the_record_holds_heights_and_counts(rule):
    shape = vg.make_shape(
        "voxel_rain", seed=4, cubes=150, width=(7, 5), base="ellipse", deposition=rule, plate=2, edge=1.0
    )
    heights, counts, base = (
        shape.record["heights"],
        shape.record["counts"],
        base_of(VoxelRain(width=(7, 5), base="ellipse")),
    )
    assert heights.shape == (7, 5)
    assert (heights[~base] == -1).all()
    assert (counts[~base] == -1).all()
    assert counts[base].sum() == 150
    assert (heights >= counts).all()
    assert (heights == counts).all() == (rule != "ballistic")
    assert shape.volume == pytest.approx(150 + 2 * base.sum(), rel=1e-12)
    assert np.ptp(shape.bounds[:, 2]) == pytest.approx(2 + heights.max(), rel=1e-12)
    if rule == "relaxed":
        # a cube never stays beside a lower column of the base
        steps = np.concatenate([np.diff(np.where(base, heights, 10**6), axis=k).ravel() for k in (0, 1)])
        assert np.abs(steps[np.abs(steps) < 10**5]).max() <= 2


def test_two_columns_differ_by_a_geometric_law():
    # of two columns the higher one gains a level or both become equal: 1/3, and 1/3 2^(1-k) for a difference of k
    base = np.zeros((6000, 1), dtype=bool)
    base[0::3] = base[1::3] = True
    _, _, heights = rained(base, 80_000, "ballistic", stream(1, "pairs"))
    pairs = heights[base.ravel()].reshape(-1, 2)
    difference = np.minimum(np.abs(pairs[:, 0] - pairs[:, 1]), 6)
    expected = 2000 * np.array([1 / 3, *(2.0 ** (1 - k) / 3 for k in range(1, 6)), 2.0**-4 / 3])
    observed = np.bincount(difference, minlength=7)
    assert ((observed - expected) ** 2 / expected).sum() < 6 + 4 * math.sqrt(12)
    # the higher of the two rises by 2/3 of a level a cube
    assert pairs.max(axis=1).mean() == pytest.approx(2 / 3 * 40, rel=0.02)


def test_counts_of_columns_are_those_of_independent_cubes():
    base = np.ones((100, 100), dtype=bool)
    column, _, heights = rained(base, 200_000, "random", stream(2, "counts"))
    counts = np.bincount(column, minlength=10_000)
    assert (counts == heights).all()
    # the variance over the columns is the time, in cubes a column: the width grows as its root
    assert counts.var() == pytest.approx(20.0 * (1 - 1e-4), rel=4 * math.sqrt(2 / 1e4))
    neighbours = np.corrcoef(heights.reshape(100, 100)[:-1].ravel(), heights.reshape(100, 100)[1:].ravel())[0, 1]
    assert abs(neighbours) < 4 / 100


def exponent(shape, times, rule, *, bins, seeds):
    """Return the growth exponent of the width of highest heights in bins, and its standard error."""
    found = []
    for seed in range(seeds):
        generator, heights, widths, now = stream(seed, "growth"), np.zeros(math.prod(shape), dtype=np.int64), [], 0
        for time in times:
            many = (time - now) * len(heights)
            column, now = generator.integers(len(heights), size=many), time
            _fall(column, np.empty(many, dtype=np.int64), heights, shape[1], rule, generator.random(many))
            top = heights.reshape(shape[0], shape[1] // bins, bins).max(axis=2)
            if shape[0] > 1:
                top = top.reshape(shape[0] // bins, bins, -1).max(axis=1)[4:-4]
            widths.append(top[:, 16:-16].std())
        found.append(math.log(widths[1] / widths[0]) / math.log(times[1] / times[0]))
    return np.mean(found), np.std(found, ddof=1) / math.sqrt(seeds)


def test_heights_roughen_with_the_exponents_of_their_classes():
    # in 1 + 1 dimensions exactly 1/2 (random), 1/4 (Edwards-Wilkinson) and 1/3 (Kardar-Parisi-Zhang); bins take away
    # the intrinsic width of ballistic deposition (Alves, Oliveira & Ferreira 2014, arXiv:1409.2460)
    line = (1, 1 << 14)
    assert exponent(line, (8, 32), 1, bins=1, seeds=4)[0] == pytest.approx(0.5, abs=0.03)
    relaxed, error = exponent(line, (8, 64), 2, bins=1, seeds=4)
    assert relaxed == pytest.approx(0.25, abs=0.03)
    assert error < 0.01
    ballistic, error = exponent(line, (16, 96), 0, bins=4, seeds=5)
    assert ballistic == pytest.approx(1 / 3, abs=0.04)
    assert error < 0.013


@pytest.mark.slow
def test_ballistic_heights_roughen_as_published_in_space():
    # 0.229 +- 0.005 (Aarao Reis 2004, doi:10.1103/PhysRevE.69.021610)
    found, error = exponent((512, 512), (8, 32), 0, bins=2, seeds=5)
    assert error < 0.01
    assert found == pytest.approx(0.229, abs=0.03)
