"""Sponges: dimension by box counting, volumes and areas in closed form, what falls apart."""

import math

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.shapes.families.random.sierpinski_sponge import SierpinskiSponge, divided
from voxgran.shapes.repairing.diagnose import diagnose

REGULAR = [
    ("menger", 3, None, 20),
    ("menger", 4, None, 32),
    ("menger", 5, 3, 44),
    ("menger", 5, 1, 125 - 3 * 4 - 1),
    ("sierpinski", 3, None, 26),
    ("sierpinski", 4, 2, 56),
    ("carpet", 3, None, 24),
    ("carpet", 5, 3, 80),
]


def cells_of(parameters, seed=0):
    """Return the places of all cells of a sponge, pieces that fall off included."""
    generator, cells = stream(seed, "cells"), np.zeros((1, 3), dtype=np.int64)
    for _ in range(parameters.levels):
        cells = divided(cells, parameters, generator)
    return cells


@pytest.mark.parametrize(("kind", "divisions", "hole", "stay"), REGULAR)
def test_regular_sponges_have_their_dimension(kind, divisions, hole, stay):
    given = {"kind": kind, "divisions": divisions, "hole": hole}
    shape = vg.make_shape("sierpinski_sponge", levels=2, edge=1.0, **given)
    assert shape.record["dimension"] == pytest.approx(math.log(stay) / math.log(divisions), rel=1e-14)
    assert shape.record["cubes"] == shape.record["whole_cubes"] == stay**2
    assert shape.volume == pytest.approx(stay**2, rel=1e-12)
    assert shape == vg.make_shape("sierpinski_sponge", levels=2, edge=1.0, seed=5, **given)
    # a level less is the same with cubes of other size
    assert vg.make_shape("sierpinski_sponge", levels=1, edge=divisions, **given).volume == pytest.approx(
        shape.volume * divisions**3 / stay, rel=1e-12
    )


@pytest.mark.parametrize("removed", [1, 7, 12])
def test_box_counting_gives_the_dimension_exactly(removed):
    parameters = SierpinskiSponge(removed=removed, levels=3)
    cells = cells_of(parameters, seed=removed)
    counts = [len(np.unique(cells // 3**k, axis=0)) for k in range(4)]
    slope = np.polyfit(np.log([27, 9, 3, 1]), np.log(counts), 1)[0]
    assert counts == [(27 - removed) ** (3 - k) for k in range(4)]
    assert slope == pytest.approx(math.log(27 - removed) / math.log(3), rel=1e-12)


def test_cells_are_removed_at_any_place():
    removed = np.zeros(27)
    for seed in range(400):
        stays = np.zeros((3, 3, 3), dtype=bool)
        stays[tuple(cells_of(SierpinskiSponge(levels=1), seed=seed).T)] = True
        removed += ~stays.ravel()
    # 7 of 27 without replacement: the variance of a cell is p q, and the sum of all is fixed
    p = 7 / 27
    assert removed.sum() == 7 * 400
    assert (((removed - 400 * p) ** 2).sum() / (400 * p * (1 - p)) * 26 / 27) < 26 + 4 * math.sqrt(52)


def test_cells_that_stay_by_chance_have_mean_and_variance_of_a_branching_process():
    p, many = 0.6, 600
    mean = 27 * p
    counts = [len(cells_of(SierpinskiSponge(kept=p), seed=seed)) for seed in range(many)]
    variance = 27 * p * (1 - p) * mean * (mean**2 - 1) / (mean - 1)
    assert np.mean(counts) == pytest.approx(mean**2, abs=4 * math.sqrt(variance / many))
    assert np.var(counts) == pytest.approx(variance, rel=4 * math.sqrt(2 / many))


@pytest.mark.parametrize("levels", [0, 1, 2, 3])
def test_menger_sponges_have_their_volume_and_area(levels):
    shape = vg.make_shape("sierpinski_sponge", kind="menger", levels=levels, edge=3.0**-levels)
    assert shape.volume == pytest.approx((20 / 27) ** levels, rel=1e-12)
    assert shape.surface_area == pytest.approx(2 * (20 / 9) ** levels + 4 * (8 / 9) ** levels, rel=1e-12)


def test_other_sponges_have_their_volume_area_and_cavities():
    shape = vg.make_shape("sierpinski_sponge", kind="sierpinski", levels=2, edge=1 / 9)
    assert shape.volume == pytest.approx((26 / 27) ** 2, rel=1e-12)
    assert shape.surface_area == pytest.approx(6 + 6 / 9 + 26 * 6 / 81, rel=1e-12)
    assert diagnose(shape).cavities == 27
    shape = vg.make_shape("sierpinski_sponge", kind="carpet", levels=2, edge=1 / 9)
    assert shape.volume == pytest.approx((8 / 9) ** 2, rel=1e-12)
    assert shape.surface_area == pytest.approx(2 * (8 / 9) ** 2 + 4 + 4 / 3 + 8 * 4 / 9, rel=1e-12)


def test_what_falls_apart_is_one_piece_or_refused():
    shape = vg.make_shape("sierpinski_sponge", removed=15, seed=1, edge=1.0)
    assert shape.record["cubes"] < shape.record["whole_cubes"] == 12**2
    assert shape.volume == pytest.approx(shape.record["cubes"], rel=1e-12)
    with pytest.raises(InputError, match=r"several pieces, the largest of \d+ of its 144 cubes.*piece='largest'"):
        vg.make_shape("sierpinski_sponge", removed=15, seed=1, piece="whole")
    whole = vg.make_shape("sierpinski_sponge", removed=1, seed=1, piece="whole", edge=1.0)
    assert whole.record["cubes"] == whole.record["whole_cubes"] == 26**2
    with pytest.raises(InputError, match="by chance no cell is left"):
        vg.make_shape("sierpinski_sponge", kept=1e-6)
