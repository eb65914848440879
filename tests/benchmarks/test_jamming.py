import csv

import pytest

from benchmarks.packing import jamming


@pytest.mark.slow
def test_rows_and_figure_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(jamming, "COUNT", 8)
    monkeypatch.setattr(jamming, "RATES", (1.0, 0.2))
    monkeypatch.setattr(jamming, "SHAPES", {name: jamming.SHAPES[name] for name in ("octahedron", "cube")})
    monkeypatch.setattr(jamming, "scans", lambda *names: {})
    table, figure = jamming.run(tmp_path)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [(row["shape"], row["growth_rate"]) for row in rows] == [
        (name, rate) for name in ("octahedron", "cube") for rate in ("1", "0.2")
    ]
    assert {row["apart"] for row in rows} == {"yes"}
    assert all(0.3 < float(row["solid_fraction"]) < 0.9 for row in rows)
    assert rows[0]["published"] == "0.697"
    assert rows[2]["published"] == ""
    assert "<svg" in figure.read_text()
