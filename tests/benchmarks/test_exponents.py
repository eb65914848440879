import csv

import numpy as np
import pytest

from benchmarks.packing import exponents
from benchmarks.packing.exponents import exponent_of, gasket_row, random_rows


def test_an_exponent_is_that_of_a_power_law():
    curvature = np.arange(1, 100_001) ** (1 / 1.7)
    assert exponent_of(curvature, 50.0, 800.0) == pytest.approx(1.7, abs=1e-3)


def test_growth_and_random_points_have_one_exponent_with_many_disks(monkeypatch):
    # a claim of the survey in Sajjadi & Khalili 2015; Dodds & Weitz 2002: 1.564
    monkeypatch.setattr(exponents, "COUNTS", (1_000, 3_000, 10_000, 30_000))
    monkeypatch.setattr(exponents, "SEEDS", 2)
    growth, points = (random_rows(method, 2) for method in ("growth", "random_apollonian"))
    assert abs(growth[0].exponent - points[0].exponent) > 0.02
    assert growth[-1].exponent == pytest.approx(points[-1].exponent, abs=0.015)
    assert points[-1].exponent == pytest.approx(1.564, abs=0.012)


@pytest.mark.slow
def test_rotation_lowers_the_exponent_of_squares_below_that_of_disks(monkeypatch):
    # Delaney, Hutzler & Aste 2008: grains that are rotated fill more
    monkeypatch.setattr(exponents, "COUNTS", (1_000, 10_000))
    monkeypatch.setattr(exponents, "SEEDS", 2)
    straight, rotated = (random_rows(method, 2)[0].exponent for method in exponents.SQUARES)
    assert straight == pytest.approx(1.633, abs=0.02)
    assert rotated == pytest.approx(1.533, abs=0.02)


def test_gaskets_have_the_published_exponent():
    row = gasket_row(2)
    assert row.exponent == pytest.approx(row.published, rel=3e-3)


@pytest.mark.slow
def test_rows_and_figure_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(exponents, "COUNTS", (100, 300))
    monkeypatch.setattr(exponents, "SEEDS", 2)
    monkeypatch.setattr(exponents, "CURVATURES", {2: 100.0, 3: 20.0})
    table, figure = exponents.run(tmp_path)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    squares = ["random_apollonian, squares", "random_apollonian, rotated squares"]
    plane, space = (
        ["growth", "random_apollonian", *squares, "apollonian"],
        ["growth", "random_apollonian", "apollonian"],
    )
    assert [row["method"] for row in rows] == plane + space
    assert "<svg" in figure.read_text()
