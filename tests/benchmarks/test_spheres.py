import csv

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from benchmarks.packing import spheres
from benchmarks.packing.spheres import CASES, Case, Row, measure, room_for, values_of


def test_every_method_that_packs_spheres_has_a_case():
    # methods on voxels and control points, and compression have benchmarks of their own; other shapes fill cells
    others = {"compress", "digital", "digital_fill", "digital_rsa", "control_point", "voronoi_fill"}
    assert {case.method for case in CASES} == set(vg.packing_methods()) - others


@pytest.mark.parametrize(
    "case",
    [
        slow(case) if case.method == "multilayer" and case.dimension == 3 else case
        for case in CASES
        if not case.bed and case.method != "rsa"
    ],
    ids=str,
)
def test_every_case_packs_about_as_many_spheres_as_are_asked_for(case):
    row = measure(case, 60, repeats=1)
    assert row.apart
    assert row.grains >= 30
    assert case.expected is None or abs(row.error) < 0.1


@pytest.mark.parametrize("dimension", [2, 3])
def test_saturated_spheres_differ_little_from_the_published_value(dimension):
    case = next(case for case in CASES if case.method == "rsa" and case.dimension == dimension)
    row = measure(case, 500, repeats=1)
    assert abs(row.grains - 500) < 50
    assert row.apart
    assert abs(row.error) < 0.02
    assert (np.diff(row.coordination) >= 0).all()


def test_containers_hold_the_grains_at_the_solid_fraction_of_the_case():
    case = Case(method="rsa", dimension=2, room=0.5, sizes=vg.sizes.discrete([1.0, 2.0], [1, 1]))
    assert np.isclose(room_for(case, 100).volume, 100 * np.pi / 4 * (1 + 4) / 2 / 0.5)
    assert np.isclose(room_for(Case(method="rsa", room=0.5, bed=True), 100).volume, 100 * np.pi / 6 / 0.5)


@pytest.mark.slow
def test_rows_and_figure_are_written(tmp_path, monkeypatch):
    few = tuple(Case(method="advancing_front", dimension=d, options={"mode": "dense"}, room=0.6) for d in (2, 3))
    monkeypatch.setattr(spheres, "CASES", few)
    monkeypatch.setattr(spheres, "COUNTS", (60,))
    monkeypatch.setattr(spheres, "LEVELS", (0.5,))
    monkeypatch.setattr(spheres, "COLUMNS", 2)
    table, layers, figure = spheres.run(tmp_path)
    slopes = [float(row["slope"]) for row in csv.DictReader(layers.read_text().splitlines())]
    assert slopes == sorted(slopes)
    assert slopes[0] < -0.03 < 0.03 < slopes[-1]
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [row["dimension"] for row in rows] == ["2", "3"]
    assert {row["apart"] for row in rows} == {"yes"}
    assert rows[0]["method"] == "advancing_front (mode=dense)"
    assert rows[0]["error"] == ""
    assert "<svg" in figure.read_text()


def test_the_error_is_the_difference_to_what_is_expected():
    row = Row(Case(method="rsa", room=0.4, expected=0.4), 3, 1.0, 0.375, (0.0, 1.0, 2.0), True)
    assert values_of(row) == (3, "rsa", 3, 1.0, 0.375, 0.4, pytest.approx(-0.025), "", 0.0, 1.0, 2.0, "yes")
