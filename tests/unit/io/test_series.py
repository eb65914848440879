"""Snapshots: a series that ParaView opens, bounded in number, the same after a resume, and free of charge."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
import pyvista

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, OutputExistsError
from voxgran.io.series import Series, listed_times


@pytest.fixture(scope="module")
def few():
    return vg.Packing.of([vg.make_shape("sphere")], vg.Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)])


def test_a_run_leaves_a_series_and_the_same_bits(tmp_path):
    def packed(**more):
        box = vg.Box((4, 4, 6))
        return vg.pack(
            vg.make_shape("sphere"), box, method="digital", count=30, voxel_size=0.125, sweeps=300, seed=4, **more
        )

    series = Series(tmp_path / "run.pvd", max_snapshots=8, every=30)
    recorded, plain = packed(recorder=series), packed()
    assert recorded.position.tobytes() == plain.position.tobytes()
    assert 4 <= len(series.times) <= 8
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == [
        f"snapshot_{time:015d}.vtp" for time in series.times
    ]
    steps = np.diff(series.times)[:-1]
    assert (steps == series.every).all()
    last = vg.load(tmp_path / "run" / f"snapshot_{series.times[-1]:015d}.vtp")
    assert last.position.tobytes() == plain.position.tobytes()
    counts = [vg.load(tmp_path / "run" / f"snapshot_{time:015d}.vtp").count for time in series.times]
    assert counts == sorted(counts)


def test_paraviews_reader_finds_all(few, tmp_path):
    series = Series(tmp_path / "run.pvd", every=10)
    for done in (10, 20, 35):
        series.record(few, done)
    reader = pyvista.get_reader(tmp_path / "run.pvd")
    assert reader.time_values == [10.0, 20.0, 35.0]
    reader.set_active_time_value(20.0)
    assert reader.read()[0].n_points == 2


@pytest.mark.parametrize("most", [2, 3, 5, 8])
@pytest.mark.parametrize("total", [0, 1, 7, 100, 1003])
def test_never_more_than_asked_and_never_fewer_than_half(few, tmp_path, monkeypatch, most, total):
    monkeypatch.setattr("voxgran.io.series.save_packing", lambda packing, path, overwrite: None)
    monkeypatch.setattr(Series, "_list", lambda self: None)
    series, done = Series(tmp_path / "run.pvd", max_snapshots=most, every=1), 0
    while done < total:
        done = min(series.due(done), total)
        series.record(few, done)
        assert len(series.times) <= most
    assert len(series.times) >= min(total, most // 2)
    assert not total or series.times[-1] == total


def test_a_resumed_series_is_that_of_a_run_without_a_stop(few, tmp_path):
    whole = Series(tmp_path / "whole.pvd", max_snapshots=4, every=5)
    for done in range(5, 105, 5):
        if done == whole.due(done - 5) or done % whole.every == 0:
            whole.record(few, done)
    halves = Series(tmp_path / "halves.pvd", max_snapshots=4, every=5)
    for done in range(5, 55, 5):
        if done % halves.every == 0:
            halves.record(few, done)
    # the checkpoint is older than the last snapshot
    halves = Series(tmp_path / "halves.pvd", max_snapshots=4, every=5, resume=True)
    for done in range(30, 105, 5):
        if done % halves.every == 0:
            halves.record(few, done)
    assert halves.times == whole.times
    assert listed_times(tmp_path / "halves.pvd") == whole.times
    with pytest.raises(OutputExistsError, match="give overwrite=True"):
        Series(tmp_path / "halves.pvd")
    assert listed_times(tmp_path / "halves.pvd") == whole.times
    fresh = Series(tmp_path / "halves.pvd", max_snapshots=4, every=5, overwrite=True)
    assert fresh.times == []
    assert not list((tmp_path / "halves").iterdir())


def test_bad_numbers_and_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="max_snapshots is 1"):
        Series(tmp_path / "run.pvd", max_snapshots=1)
    with pytest.raises(InputError, match="every is 0"):
        Series(tmp_path / "run.pvd", every=0)
    (tmp_path / "run.pvd").write_text("<VTKFile><Collection><DataSet/></Collection></VTKFile>")
    with pytest.raises(FileFormatError, match="no list of snapshots"):
        Series(tmp_path / "run.pvd", resume=True)
    (tmp_path / "run.pvd").write_text("<VTKFile>")
    with pytest.raises(FileFormatError, match="remove it and run again"):
        listed_times(tmp_path / "run.pvd")


def test_the_list_is_plain_xml(few, tmp_path):
    Series(tmp_path / "run.pvd", every=10).record(few, 10)
    root = ET.parse(tmp_path / "run.pvd").getroot()
    assert root.attrib["type"] == "Collection"
    assert root[0][0].attrib["file"] == "run/snapshot_000000000000010.vtp"


def test_other_files_among_snapshots_stay(tmp_path, few):
    series = Series(tmp_path / "run.pvd", every=5)
    series.record(few, 5)
    (own,) = series.folder.iterdir()
    others = [series.folder / name for name in ("snapshot_thesis.vtp", "snapshot_000000000000010.vtp", "notes.vtp")]
    for path in others:
        path.write_text("thesis")
    Series(tmp_path / "run.pvd", overwrite=True)
    assert sorted(series.folder.iterdir()) == sorted(others)
    assert not own.exists()
