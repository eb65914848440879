"""The bench of growth: rows of each case, exponents, memory, and a million spheres from packing to the report."""

import csv
import sys
from functools import partial

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from benchmarks.model import timed
from benchmarks.packing import scale
from benchmarks.packing.scale import CASES, Row, bed, exponent_of, measure_case, most_memory
from voxgran._base.machine import peak_memory


@pytest.fixture
def small(monkeypatch):
    """Numbers of grains that take no time."""
    monkeypatch.setattr(scale, "COUNTS", (40, 160, 640))
    monkeypatch.setattr(scale, "BED", 40)
    monkeypatch.setattr(scale, "WIDTH", 4.0)
    bed.cache_clear()
    yield
    bed.cache_clear()


@pytest.mark.parametrize("name", ["deposition", "load .vtp", slow("fit_clump")])
def test_a_case_has_a_row_for_each_number_of_grains(name, small):
    rows = list(measure_case(name, 160))
    many = [2, 8] if name == "fit_clump" else [40, 160]
    assert [row.grains for row in rows] == many
    assert rows[0].exponent is None
    assert rows[1].exponent == pytest.approx(np.log(rows[1].seconds / rows[0].seconds) / np.log(4), rel=1e-9)
    assert all(row.bytes_a_grain > 0 and row.seconds > 0 for row in rows)


def test_exponents_and_memory():
    assert exponent_of(Row("a", 10, 1.0, None), 100, 10.0) == pytest.approx(1.0)
    assert exponent_of(None, 100, 10.0) is None
    assert exponent_of(Row("a", 100, 1.0, None), 100, 10.0) is None
    assert most_memory(partial(np.ones, 10**6)) == pytest.approx(8e6, rel=0.01)


@pytest.mark.slow
def test_the_files(small, tmp_path, monkeypatch):
    monkeypatch.setattr(scale, "CASES", dict.fromkeys(("deposition", "verify"), 160))
    monkeypatch.setattr(scale, "measure_peer", lambda: [Row(scale.POURING, 40, 1.0, None)])
    table, figure = scale.run(tmp_path)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [row["case"] for row in rows] == ["deposition"] * 2 + ["verify"] * 2 + [scale.POURING]
    assert rows[-1]["bytes_a_grain"] == ""
    assert figure.read_text().startswith("<?xml")
    assert set(scale.METHODS) < set(CASES)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tiled", "advancing_front", "deposition", "rsa", "expand", "gravity"])
def test_a_million_spheres_from_packing_to_the_report(name, tmp_path):
    """Each step ends, what it says is true of all grains, and the page has what it draws of them chosen.

    The method `gravity` takes up to 40 minutes and 6 GB, the others up to 2 minutes and 4 GB.
    """
    count, dense = 1_000_000, name == "expand"
    given = {"expand": {"solid_fraction": scale.DENSE}, "gravity": {"threads": 1}}.get(name, {})
    ways = {"tiled": partial(bed, count), "advancing_front": partial(scale.front, count)}
    # the bed by gravity is 100 wide and 90 high
    tall, fraction = {"deposition": 2.0, "gravity": 1.38}.get(name, 0.0), scale.DENSE if dense else scale.LOOSE
    pack = ways.get(name) or partial(scale.packed, name, count, fraction=fraction, tall=tall, **given)

    def step(what, work):
        """Print the seconds of a step, which the guide states."""
        found, seconds = timed(work)
        sys.stdout.write(f"{name}: {what} {seconds:.1f} s, {peak_memory() / 1e9:.1f} GB\n")
        return found

    packing = step("pack", pack)
    assert packing.count > 0.7 * count
    assert step("verify", packing.verify).ok
    tree = step("measure", packing.measure)
    assert 0.2 < float(tree["solid_fraction"]) < 0.7
    sys.stdout.write(f"{name}: bulk solid fraction {float(tree['bulk_solid_fraction']):.4f}\n")
    step("save", partial(packing.save, tmp_path / "bed.vtp"))
    assert step("load", partial(vg.load, tmp_path / "bed.vtp")) == packing
    assert step("deck", partial(vg.write_deck, packing, tmp_path / "run", "lammps", material=vg.Material())).files
    step("report", partial(vg.save_report, packing, tmp_path / "page.html", statistics=tree))
    text = (tmp_path / "page.html").read_text()
    assert "Spheres are drawn as points" in text
    assert f"It shows 20000 of {packing.count} grains" in text
    assert "3000 grains of a cube in the middle" in text
