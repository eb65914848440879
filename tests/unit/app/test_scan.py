"""The pane of a scan: what it asks for, in which order, and that a packing becomes a run that is done."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

import voxgran as vg
from voxgran.app import scan
from voxgran.app.desk import Desk
from voxgran.app.scan import ScanPane

pytest.importorskip("tomli_w")
pytestmark = pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
SCENE = {
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 12},
    "material": {"friction": 0.7},
    "output": {"report": False, "vtk": False, "statistics": False},
}


class State(dict):
    """The state of a page, as trame has it."""

    __getattr__, __setattr__ = dict.__getitem__, dict.__setitem__

    def change(self, *_):
        """Leave functions alone that hear of changes."""
        return lambda function: function


@pytest.fixture
def pane(tmp_path):
    """Return the pane of an image of eight boxes, and the numbers of runs that were shown."""
    grey = np.zeros((24, 24, 24), dtype=np.uint8)
    for x, y, z in np.ndindex(2, 2, 2):
        grey[2 + 12 * x : 10 + 12 * x, 2 + 12 * y : 10 + 12 * y, 2 + 12 * z : 10 + 12 * z] = 150
    np.save(tmp_path / "scan.npy", grey)
    desk = Desk(SCENE, tmp_path / "runs", tmp_path)
    shown = []
    made = ScanPane(desk, State(), shown.append)
    made.test = SimpleNamespace(shown=shown, desk=desk)
    yield made
    if made.process.process is not None:
        made.process.process.end()
    desk.look.stage.close()


def followed(pane, ended):
    """Follow the process until something is so."""
    end = time.monotonic() + 120
    while not ended():
        assert time.monotonic() < end, dict(pane.state)
        pane.follow()
        time.sleep(0.02)


def test_an_image_is_opened_segmented_again_and_becomes_a_run(pane, tmp_path, monkeypatch):
    state, desk = pane.state, pane.test.desk
    pane.moved()
    assert not pane.asked
    state.scan_path = "no.npy"
    pane.open()
    followed(pane, lambda: state.scan_errors)
    assert "no.npy" in state.scan_errors["path"]
    assert not pane.asked
    state.scan_path, state.scan_voxel_size, state.scan_unit = "scan.npy", "0,5", "mm"
    pane.open()
    followed(pane, lambda: len(state.scan_slices) == 3 and not pane.process.doing)
    assert state.scan_errors == {}
    assert state.scan_found.startswith("8 grains")
    assert (state.scan_low, state.scan_high) == (0, 150)
    # nothing is asked for while no slider is moved, and once when it rests
    pane.follow()
    assert not pane.process.doing
    monkeypatch.setattr(scan, "PAUSE", 0.0)
    state.scan_threshold = 100
    pane.moved()
    assert pane.asked == ["draw"]
    followed(pane, lambda: "threshold=100" in state.scan_python and not pane.process.doing)
    # what is open stays where another file is none, and its slices are drawn
    state.scan_path = "no.npy"
    pane.open()
    followed(pane, lambda: state.scan_errors and not pane.process.doing and not pane.asked)
    assert list(state.scan_errors) == ["path"]
    assert "no.npy" in state.scan_errors["path"]
    pane.ask("finish")
    followed(pane, lambda: pane.test.shown)
    assert pane.test.shown == [1]
    assert not state.scanning
    desk.open(1)
    names = {}
    exec(state.scan_python, names)
    assert np.array_equal(desk.packing.position, names["packing"].position)
    assert vg.Scene.from_toml(tmp_path / "runs" / "run_1.toml").material.friction == 0.7
    assert desk.file("scene.toml")
    # the next is another run
    assert desk.run().number == 2


@pytest.mark.slow
def test_a_scan_is_stopped_and_opened_again(pane, tmp_path):
    state, desk = pane.state, pane.test.desk
    state.scan_path, state.scan_voxel_size, state.scan_unit = "scan.npy", "0,5", "mm"
    for ask in (pane.open, lambda: pane.ask("finish")):
        ask()
        pane.follow()
        assert state.scan_busy
        process = pane.process.process.process
        pane.stop()
        assert process.poll() is not None
        pane.follow()
        assert (state.scan_busy, state.scan_about, pane.asked) == ("", "", [])
        assert not list((tmp_path / "runs").glob("run_*"))
        pane.open()
        followed(pane, lambda: state.scan_about and not pane.process.doing and not pane.asked)
    assert not desk.queue.runs


def test_an_upload_fills_the_path(pane, tmp_path):
    kept = pane.test.desk.kept("../scan.npy", (tmp_path / "scan.npy").read_bytes())
    pane.open(kept)
    assert pane.state.scanning
    assert pane.asked == ["open"]
    assert pane.state.scan_path == str(tmp_path / "runs" / "uploads" / "scan.npy")
