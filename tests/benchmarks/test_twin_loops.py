import csv

import numpy as np
import pytest

import voxgran as vg
from benchmarks.grains import twin_loops
from voxgran.lattice.necks import touching
from voxgran.scene.twins.compared import SHARED


@pytest.mark.slow
@pytest.mark.parametrize("case", twin_loops.CASES)
def test_a_closed_loop_ends_where_it_began(case):
    rows = twin_loops.rows_of(case)
    assert {row.measure for row in rows if row.limit is not None} == {
        "solid_fraction",
        "coordination_number",
        "mean_coordination_number",
        "D50",
        "mean_radial_peak",
        "tortuosity",
    }
    # the mean of four peaks of g(r) has a standard error of 3 %
    wide = [row for row in rows if row.limit is not None and abs(row.difference) > row.limit]
    assert not [row for row in wide if row.measure != "mean_radial_peak" or abs(row.ratio) > 2]


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.parametrize("case", ["spheres", *twin_loops.CASES])
def test_labels_that_share_faces_are_counted_alike_by_segmentation_and_by_truth(case, monkeypatch):
    """Mean contacts of whole grains: known, within a voxel, and of labels that share faces, true ones and segmented."""
    monkeypatch.setitem(twin_loops.CASES, "spheres", lambda: [vg.shapes.sphere()])
    specimen = twin_loops.specimen_of(case, 3)
    for across in (10, 17, 30):
        cut = across // 3
        image = vg.to_image(specimen, 1 / across)[cut:-cut, cut:-cut, cut:-cut][:240, :240, :240]
        solid, told = (image > 0).astype(float), []
        for labels in (image, np.asarray(vg.segment(solid, threshold=0.5, voxel_size=1 / across).labels)):
            border = [labels.take(end, axis=axis) for axis in range(3) for end in (0, -1)]
            whole = np.setdiff1d(labels, np.concatenate([side.ravel() for side in border]))
            whole = whole[whole > 0]
            told += [touching(labels, (False,) * 3, faces=many)[whole].mean() for many in (1, SHARED, 4)]
            if labels is image:
                known = whole - 1
        exact = []
        for gap in (1e-3, 1 / across):
            pairs = specimen.contacts(gap)
            number = np.bincount(np.concatenate([pairs.i, pairs.j]), minlength=specimen.count)
            exact.append(number[known].mean())
        print(case, across, *(f"{one:.2f}" for one in exact), "less known:", *(f"{one - exact[0]:.2f}" for one in told))  # noqa: T201
        assert told[4] == pytest.approx(told[1], abs=0.15)
        assert exact[0] < told[4] < min(exact[0] + 1.8, exact[1])
