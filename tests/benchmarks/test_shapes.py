import csv

import pytest

from benchmarks.grains import shapes
from benchmarks.grains.shapes import FINER, row_of
from voxgran.shapes.family import shape_families


def test_finer_meshes_are_those_of_families():
    assert set(FINER) <= set(shape_families())


@pytest.mark.parametrize(("family", "most"), [("torus", 0.02), ("noise_star", 0.02), ("box", 0.0)])
def test_errors_are_small_and_those_of_exact_shapes_are_zero(family, most, monkeypatch):
    monkeypatch.setattr(shapes, "COUNT", 3)
    monkeypatch.setattr(shapes, "COMPARED", 1)
    row = row_of(family)
    assert row.milliseconds > 0
    assert 0 <= row.error <= most
    assert (row.error > 0) == (most > 0)
    assert (row.faces > 0) == (family != "box")


@pytest.mark.slow
def test_rows_and_figure_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(shapes, "COUNT", 2)
    monkeypatch.setattr(shapes, "COMPARED", 1)
    monkeypatch.setattr(shapes, "default_families", lambda: ("sphere", "disk", "convex_polyhedron"))
    table, figure = shapes.run(tmp_path)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [row["family"] for row in rows] == ["sphere", "disk", "convex_polyhedron"]
    assert [row["dimension"] for row in rows] == ["3", "2", "3"]
    assert all(float(row["milliseconds"]) > 0 for row in rows)
    assert "<svg" in figure.read_text()
