"""The bench of relaxation: its rows, kept and read again, and small beds in LAMMPS where it is installed."""

import dataclasses

import engine_cases as cases
import numpy as np
import pytest
from kit import slow

from benchmarks.model import write_rows
from benchmarks.settling import relax

ROW = relax.Way("spheres", 40, "gravity", 0.5, 2.25, 30.0, 4.0, 1, 0.58, 4.5, 0.125, 0.0625)


def test_rows_are_read_as_they_were_written(tmp_path):
    rows = [ROW, dataclasses.replace(ROW, start="poured", rests=0)]
    write_rows(tmp_path / "relax.csv", relax.HEAD, map(dataclasses.astuple, rows))
    assert relax._rows_of(tmp_path / "relax.csv") == rows
    assert relax._rows_of(tmp_path / "none.csv") == []


def test_rows_that_are_there_are_not_measured_again(tmp_path, monkeypatch):
    write_rows(tmp_path / "relax.csv", relax.HEAD, [dataclasses.astuple(ROW)])
    monkeypatch.setattr(relax, "calibration", lambda: 0.06)
    monkeypatch.setattr(relax, "KINDS", (("spheres", relax.spheres, ((40, 4.0),)),))
    assert relax.compare_ways(tmp_path / "relax.csv") == [ROW]


@pytest.mark.parametrize(
    ("sinking", "share"),
    [([0.0, 1.0, 1.0, 1.0, 1.0], 0.25), ([0.0, 0.5, 0.9985, 1.0, 1.0], 0.75), ([0.1, 0.1, 0.1], 0.0)],
)
def test_the_time_of_sinking_ends_where_the_mean_stays(sinking, share):
    assert relax._share_of_sinking(np.array(sinking)) == share


def test_the_figure_shows_both_ways(tmp_path):
    rows = [ROW, dataclasses.replace(ROW, start="poured", solid_fraction=0.6)]
    proofs = [relax.Proof("spheres", "gravity", 0.99, 0.03, 0.2), relax.Proof("spheres", "rsa", 0.0, 3.0, 4.0)]
    relax._draw(rows, proofs, tmp_path / "relax.svg")
    text = (tmp_path / "relax.svg").read_text()
    assert text.startswith("<?xml")
    assert len(text) > 10_000


@pytest.mark.slow
@pytest.mark.engine
@pytest.mark.parametrize("grains", ["spheres", slow("hull clumps")])
def test_beds_at_rest_sink_less_than_others(monkeypatch, grains):
    monkeypatch.setattr(relax, "PROVEN", [one for one in relax.PROVEN if one[0] == grains])
    monkeypatch.setenv("VOXGRAN_LAMMPS", cases.program("lmp", "make test-engines"))
    found = {row.made_by: row for row in relax.compare_proofs(40)}
    assert found["gravity"].share_proven > 0.9
    assert found["gravity"].sinking < 0.1 < found["digital, not settled"].sinking
    assert found["rsa"].share_proven < 0.1
