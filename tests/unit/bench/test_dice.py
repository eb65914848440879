"""Dice by control points: a small bed, and the values that beds are compared with."""

import tomllib
from pathlib import Path

import pytest

from voxgran.bench.tradeoffs import dice


@pytest.mark.slow
def test_beds_of_dice_lie_without_overlap():
    """Poured cubes and shaken ones, which sink but do not come to rest in so few sweeps."""
    rows = dice.measure_dice(("cube",), count=110, seeds=(1,), sweeps=100, shaking=10, settling=15)
    assert [row[:3] for row in rows] == [("cube", False, 1), ("cube", True, 1)]
    assert all(row[3] > 0 and row[5] == 0 for row in rows)
    assert all(0.3 < row[4] < 0.7 for row in rows)


def test_files_are_written_beside_the_published_values(tmp_path, monkeypatch):
    found = [(name, shaken, 1, 2.0, 0.5 + 0.1 * shaken, 0) for name in dice.MEASURED for shaken in (False, True)]
    monkeypatch.setattr(dice, "measure_dice", lambda: found)
    table, figure = dice.run(tmp_path)
    lines = table.read_text().splitlines()
    assert len(lines) == 11
    assert lines[2].startswith("tetrahedron,true,1,2.0,0.6000,0.64,0,")
    assert figure.read_text().startswith("<?xml")
    known = tomllib.loads((Path(__file__).parents[2] / "reference" / "references.toml").read_text())["dice"]
    assert list(zip(known["loose"]["values"], known["shaken"]["values"], strict=True)) == list(dice.MEASURED.values())
