"""Compression: rows of specimens by one ruler, with published values only where the grains are the same."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.settling import compression
from benchmarks.settling.settle import peer_packing

#: a program that shrinks the box and the places of the grains by a factor
SHRINKS = """
import sys
import numpy as np
with np.load(sys.argv[1]) as given:
    kept = {"orientation": given["orientation"]}
    np.savez(sys.argv[2], position=0.9 * given["position"], lengths=0.9 * given["lengths"], **kept)
print(1.5)
"""


def rows_of(size):
    cases = (*(replace(compression.CASES[k], peer=False) for k in (2, 5, 12, 11)),)
    return compression.measure(cases, size=size)


@pytest.mark.slow
def test_specimens_are_judged_by_the_balance_of_their_forces():
    rows = rows_of(0.06)
    assert [row.grains for row in rows] == [60, 60, 60, 60]
    # along z only, the stress across is not asked for
    assert all(row.stress_error < 0.01 and row.deepest_overlap == 0.0 for row in rows)
    assert all(row.coordination_by_forces > 3.5 for row in rows)
    assert rows[0].share_in_balance >= 0.95


@pytest.mark.slow
def test_published_values_stand_beside_the_same_grains_only():
    assert [row.published_solid_fraction for row in rows_of(0.02)] == [0.593, "", "", 0.652]


def test_a_peer_returns_the_box_that_it_has_compressed(tmp_path):
    script = tmp_path / "shrinks.py"
    script.write_text(SHRINKS)
    start = compression.loose_grains(compression.CASES[0], 20)
    specimen, seconds = peer_packing(script, start, 0.5)
    assert seconds == 1.5
    np.testing.assert_allclose(specimen.container.volume, 0.9**3 * start.container.volume)
    row = compression.judged(compression.CASES[0], "shrinks", specimen, seconds)
    # grains that float are no specimen
    assert row.stress_error > 0.5


@pytest.mark.slow
def test_rows_and_figure_are_written(tmp_path, monkeypatch, rows):
    monkeypatch.setattr(compression, "measure", lambda: rows)
    begun, ended = compression.starts(count=40, seeds=2), compression.ends({30: (0.5,)}, (0.5,), (1.0,))
    assert [row.solid_fraction > 0.5 and row.seeds == 2 for row in begun] == [True] * len(compression.STARTS)
    for row in ended:
        # a cell, and a box with walls
        assert row.compressed + row.yielded + row.steps == row.runs == 2
        assert row.confirmed == "" or row.confirmed <= row.compressed
        assert row.beyond_limit == "" or row.beyond_limit <= row.yielded
    monkeypatch.setattr(compression, "starts", lambda: begun)
    monkeypatch.setattr(compression, "ends", lambda: ended)
    files = compression.run(tmp_path)
    assert {path.suffix for path in files} == {".csv", ".svg"}
    assert {path.stem for path in files} == {"compression", "compression_starts", "compression_ends"}
    with (tmp_path / "compression.csv").open(newline="") as table:
        written = list(csv.DictReader(table))
    assert [float(row["solid_fraction"]) for row in written] == pytest.approx(
        [r.solid_fraction for r in rows], abs=1e-4
    )
