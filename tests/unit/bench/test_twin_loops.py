import csv

import pytest

from voxgran.bench.tradeoffs import twin_loops


@pytest.mark.slow
@pytest.mark.parametrize("case", twin_loops.CASES)
def test_a_closed_loop_ends_where_it_began(case):
    rows = twin_loops.rows_of(case)
    assert {row.measure for row in rows if row.limit is not None} == {
        "solid_fraction",
        "coordination_number",
        "D50",
        "mean_radial_peak",
        "tortuosity",
    }
    assert not [row for row in rows if row.limit is not None and abs(row.difference) > row.limit]


def test_rows_and_figure_are_written(tmp_path, monkeypatch):
    def rows_of(case):
        return [
            twin_loops.Row(case, name, 2.0, 2.1, 0.05 if relative else 0.1, 0.5, limit, 9, 1.0)
            for name, (limit, relative) in twin_loops.LIMITS.items()
        ]

    monkeypatch.setattr(twin_loops, "rows_of", rows_of)
    table, figure = twin_loops.run(tmp_path)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert len(rows) == len(twin_loops.CASES) * len(twin_loops.LIMITS)
    assert (rows[0]["specimen"], rows[0]["twin"], rows[0]["difference"]) == ("2", "2.1", "0.1000")
    assert rows[-1]["limit"] == ""
    assert "<svg" in figure.read_text()


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_the_specimen_of_a_case_becomes_labels(monkeypatch):
    monkeypatch.setattr(twin_loops, "GRAINS", 30)
    specimen, scan = twin_loops.specimen_and_scan("ellipsoids")
    assert specimen.count == 30
    assert scan.gravity is None
    assert scan.solid_fraction == pytest.approx(specimen.solid_fraction, abs=0.05)
