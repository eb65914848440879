"""Settling: rows of beds and of other programs by one ruler, and the overlap of the fall against its substeps."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.settling import settle

#: a program that leaves all grains where they are
STAYS = """
import sys
import numpy as np
with np.load(sys.argv[1]) as given:
    np.savez(sys.argv[2], position=given["position"], orientation=given["orientation"])
print("seconds", 1.5)
"""


@pytest.fixture(scope="module")
def rows():
    cases = tuple(replace(settle.CASES[k], width=4.0) for k in (0, 7))
    return settle.measure_beds(cases, size=0.06)


def test_beds_are_judged_by_verify_and_equilibrium(rows):
    assert [row.name for row in rows] == ["1,000 spheres", "300 polyhedra between walls"]
    assert [row.grains for row in rows] == [60, 20]
    assert all(row.free and row.overlap == 0.0 for row in rows)
    assert all(row.rests >= 0.9 and row.contacts > 2.0 and row.seconds > 0.0 for row in rows)


@pytest.mark.slow
def test_rows_and_figure_are_written(tmp_path, monkeypatch, rows):
    accuracy = [(0.1, 2, 1.0, 0.58, 1e-2, 0.99), (0.1, 4, 1.5, 0.58, 0.0, 1.0)]
    monkeypatch.setattr(settle, "measure_beds", lambda: rows)
    monkeypatch.setattr(settle, "measure_peers", list)
    monkeypatch.setattr(settle, "measure_accuracy", lambda: accuracy)
    monkeypatch.setattr(settle, "measure_iterations", lambda: [(300, 30, 4, 0.2, 0.58, 0.001, 20, 0.01, 0.99)])
    files = settle.run(tmp_path)
    assert {path.name for path in files} == {"settle.csv", "settle_accuracy.csv", "settle_iterations.csv", "settle.svg"}
    with (tmp_path / "settle.csv").open(newline="") as table:
        written = list(csv.DictReader(table))
    assert [float(row["share_at_rest"]) for row in written] == pytest.approx([row.rests for row in rows], abs=1e-4)
    assert len((tmp_path / "settle_accuracy.csv").read_text().splitlines()) == 3


def test_more_substeps_leave_less_overlap():
    found = settle.measure_accuracy((0.1,), (2, 8), count=60)
    assert [row[:2] for row in found] == [(0.1, 2), (0.1, 8)]
    assert found[1][4] < 0.5 * found[0][4]
    assert min(row[5] for row in found) > 0.9


@pytest.mark.slow
def test_iterations_of_steps_are_compared_with_a_fall_that_goes_on():
    found = settle.measure_iterations(((120, 4.0, 2),), (30,))
    assert [row[:3] for row in found] == [(120, 30, 4), (120, None, 4), (120, None, 16)]
    for _, _, _, seconds, bulk, error, steps, moving, rests in found:
        assert seconds > 0.0
        assert 0.5 < bulk < 0.68
        assert 0.0 < error < 0.05
        assert steps >= 1
        assert moving < 0.3
        assert rests > 0.95
    # a fall that goes on leaves less to do
    assert found[2][6] < found[0][6]


def test_other_programs_are_judged_alike_or_left_out(tmp_path):
    start = settle.falling_grains(replace(settle.CASES[0], width=4.0), 20)
    script = tmp_path / "settle_stays.py"
    assert settle.peer_packing(script, start, 0.5) is None
    script.write_text(STAYS)
    packing, seconds = settle.peer_packing(script, start, 0.5)
    assert seconds == 1.5
    np.testing.assert_allclose(packing.position, start.position, atol=1e-12)
    row = settle.judged("20 spheres", "stays", 0.5, packing, seconds)
    # grains that float do not rest
    assert row.free
    assert row.rests == 0.0
    script.write_text("raise SystemExit(1)")
    assert settle.peer_packing(script, start, 0.5) is None
