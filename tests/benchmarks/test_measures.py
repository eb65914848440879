"""The benchmark of measures, small."""

import time

import numpy as np
import pytest

import voxgran as vg
from benchmarks.grains.measures import counted, measured, packings, reported
from voxgran.measures.registered.profile import axis_profile

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("jagged_pictures")]


@pytest.fixture(scope="module")
def small():
    return packings(solids=40, spheres=60)


@pytest.mark.filterwarnings("ignore:the bulk holds")
def test_rows_of_small_packings(small):
    for name, packing in small.items():
        assert vg.verify(packing).ok
        near = packing.contacts(packing.contact_gap)
        assert near.count > 1.5 * packing.count
        rows = {row[2]: row for row in measured(name, packing)}
        assert {"all usual", "contacts", "density", "profile", "profile along z"} <= set(rows)
        assert all(row[:2] == (name, packing.count) and row[3] >= 0 for row in rows.values())


def seconds_of_one(compute, packing):
    began = time.process_time()
    compute(packing)
    return time.process_time() - began


@pytest.mark.filterwarnings("ignore:the bulk holds")
def test_rows_of_reports(monkeypatch):
    # each report once, where the benchmark takes the least time of several
    monkeypatch.setattr("benchmarks.grains.measures._seconds", seconds_of_one)
    rows = reported(8)
    assert [row[:3] for row in rows] == [("random solids", 8, "report"), ("spheres", 8, "report")]
    assert all(row[3] > 0 and row[4] is None for row in rows)


@pytest.mark.parametrize("name", ["random solids", "spheres"])
def test_counted_points_tend_to_the_exact_profile(small, name):
    packing = small[name]
    exact = axis_profile(packing)
    few, many = (
        np.sqrt(np.mean((counted(packing, exact.edges, points) - exact.solid_fraction) ** 2))
        for points in (100, 10_000)
    )
    # the error of a mean falls with the square root of the number of points, to that of the voxels
    assert many < 0.3 * few
    assert many < 5e-3
