"""Scans that are worked on: what is proposed, drawn and made is what the functions of the library give."""

import base64
import io
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from kit import grey_beads
from PIL import Image

import voxgran as vg
from voxgran._base.errors import InputError, VoxgranError
from voxgran.report.slices import GRAIN, SEVERAL
from voxgran.scene.scans import Scan, ScanProcess

pytestmark = pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
FILES = {"output": {"report": False, "vtk": False, "statistics": False}, "measure": {"which": ["coordination"]}}


@pytest.fixture
def place(tmp_path):
    """Return the file of an image of eight spheres, of which two are nearly one."""
    rows = [(x, y, z) for x in (8, 25) for y in (8, 25) for z in (8, 25)]
    np.save(tmp_path / "scan.npy", grey_beads([*rows, (8, 8, 14)], 6, 34))
    return tmp_path / "scan.npy"


def pixels(slice_):
    """Return the picture of a slice, (h, w, 3)."""
    data = base64.b64decode(slice_["source"].partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def colored(slice_, color):
    """Return which pixels of a slice have a colour."""
    wanted = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    return (np.abs(pixels(slice_).astype(int) - wanted) <= 1).all(axis=-1)


def test_what_is_proposed_is_what_the_library_finds(place):
    scan, found = Scan(), vg.segment(vg.load_image(place, voxel_size=0.5, unit="mm"))
    told = scan.open(path=place, voxel_size=0.5, unit="mm")
    assert told["threshold"] == found.threshold
    assert told["separation"] == found.separation
    assert told["found"].startswith(f"{found.grains} grains, {found.suspects.sizes['neck']} in doubt")
    assert told["about"].startswith("34 x 34 x 34 voxels 0.5 x 0.5 x 0.5 mm, grey values")
    assert np.array_equal(scan.found.labels, found.labels)
    # the separation that is proposed stays relative, another one is a length
    scan.segment(threshold=100.0, separation=told["separation"], dark=False)
    assert "separation" not in scan.given
    assert np.array_equal(scan.found.labels, vg.segment(vg.load_image(place), threshold=100.0).labels)
    scan.segment(threshold=100.0, separation=2.0, min_size=30)
    one = vg.segment(vg.load_image(place, voxel_size=0.5), threshold=100.0, separation=2.0, min_size=30)
    assert np.array_equal(scan.found.labels, one.labels)


def test_slices_show_labels_suspects_and_the_solid_of_another_threshold(place):
    scan = Scan()
    told = scan.open(path=place, voxel_size=(0.5, 0.5, 1.0))
    scan.segment(threshold=told["threshold"], separation=4.0)
    (several,) = scan.found.suspects["grain"].values
    x, y, z = np.argwhere(scan.found.labels == several).mean(axis=0) / 34
    across_x, across_y, across_z = scan.draw(at=(x, y, z), threshold=told["threshold"])["slices"]
    assert [round(one["aspect"], 3) for one in (across_x, across_y, across_z)] == [0.5, 0.5, 1.0]
    # rows are z downward from the top, columns y
    places = np.argwhere(colored(across_x, SEVERAL))
    assert places.size
    labels = scan.found.labels[int(x * 34)].T[::-1]
    assert (labels[tuple(places.T)] == several).all()
    assert colored(across_x, GRAIN).any()
    # the outlines of the solid alone
    (solid, *_rest) = scan.draw(at=(x, y, z), threshold=90.0)["slices"]
    assert not colored(solid, SEVERAL).any()
    assert (np.load(place)[int(x * 34)].T[::-1][colored(solid, GRAIN)] > 90).all()
    # dark grains are the other side
    (dark, *_rest) = scan.draw(at=(x, y, z), threshold=90.0, dark=True)["slices"]
    assert (np.load(place)[int(x * 34)].T[::-1][colored(dark, GRAIN)] < 90).all()


def test_a_packing_is_that_of_the_labels_with_files_as_of_a_run(place, tmp_path):
    scan, run = Scan(), tmp_path / "run_1"
    scan.open(path=place, voxel_size=0.5, unit="mm")
    given = {**FILES, "scene": {"seed": 3, "unit": "m"}, "packing": {"method": "gravity"}, "shape": []}
    told = scan.finish(folder=run, mapping=given, base=tmp_path, gravity="-z")
    left, names = vg.load(run / "packing.vtp"), {}
    exec(told["python"], names)
    for packing in (vg.packing_of_labels(scan.found, gravity="-z"), names["packing"]):
        assert np.array_equal(left.position, packing.position)
        assert (left.unit, left.gravity, left.contact_gap) == (packing.unit, packing.gravity, packing.contact_gap)
    # the scene begins with these grains
    result = vg.Scene.from_mapping(told["scene"]).run(tmp_path / "out")
    assert np.allclose(result.packing.position, left.position, rtol=1e-14)
    assert result.packing.unit == "mm"


def test_errors_name_their_field_and_leave_no_folder(place, tmp_path):
    with pytest.raises(InputError, match="open one first"):
        Scan().draw(at=(0, 0, 0), threshold=1.0)
    scan = Scan()
    scan.open(path=place)
    (tmp_path / "run_1").mkdir()
    np.save(tmp_path / "flat.npy", np.zeros((4, 4)))
    with pytest.raises(InputError, match="three axes"):
        scan.open(path=tmp_path / "flat.npy")
    assert scan.image.values.shape == scan.found.labels.shape
    assert scan.path == place
    with pytest.raises(InputError, match="voxel_size"):
        scan.finish(folder=tmp_path / "run_1", mapping=FILES, base=tmp_path)
    assert not (tmp_path / "run_1").exists()


def answer_of(process, name, **given):
    """Return what a process answers."""
    process.begin(name, given)
    end = time.monotonic() + 120
    while (told := process.answer()) is None:
        assert time.monotonic() < end
        time.sleep(0.02)
    return told


def test_a_process_answers_and_is_replaced_when_it_has_ended(place):
    process = ScanProcess()
    assert process.answer() is None
    assert set(answer_of(process, "open", path=Path("no.tif"), unit=None)["errors"]) == {"path"}
    assert "unit" in answer_of(process, "open", path=place, voxel_size=0.5, unit="cubits")["errors"]
    told = answer_of(process, "open", path=place, voxel_size=0.5)
    assert told["errors"] == {}
    assert answer_of(process, "segment", threshold=100.0, separation=0.0)["errors"].keys() == {"separation"}
    number = process.process.process.pid
    process.begin("segment", {"threshold": 100.0, "separation": None})
    os.kill(number, signal.SIGKILL)
    end = time.monotonic() + 60
    while (told := process.answer()) is None:
        assert time.monotonic() < end
    assert told.get("errors") or told["threshold"] == 100.0
    assert "open one first" in answer_of(process, "draw", at=(0, 0, 0), threshold=1.0)["errors"]["path"]
    assert process.process.process.pid != number
    process.process.end()


def test_a_scan_that_is_no_image_is_refused(tmp_path):
    (tmp_path / "scan.tif").write_bytes(b"nothing of this is an image")
    with pytest.raises(VoxgranError, match=r"scan\.tif"):
        Scan().open(path=tmp_path / "scan.tif")
