"""Ten thousand grains, killed at random moments and resumed, end with the same bits; snapshots are those of one run."""

import signal
import subprocess
import sys
import time

import pytest

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.io.series import listed_times

SCENE = """
[scene]
seed = 1
[[shape]]
family = "sphere"
[sizes]
kind = "lognormal"
median = 1.0
sigma = 0.2
[container]
kind = "box"
lengths = [20, 20, 60]
periodic = ["x", "y"]
[packing]
method = "digital"
count = 10000
voxel_size = 0.125
sweeps = 2
cycles = 1
[measure]
which = ["density"]
[output]
vtk = false
report = false
statistics = false
snapshots = 6
"""


@pytest.mark.slow
def test_a_large_scene_survives_being_killed(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    command = [sys.executable, "-m", "voxgran", "run", str(path), "-o"]
    subprocess.run([*command, str(tmp_path / "whole")], check=True, capture_output=True)
    waits = stream(1, "kills").uniform(11.0, 25.0, 3)
    for wait in waits:
        run = subprocess.Popen([*command, str(tmp_path / "killed"), "--resume"], stderr=subprocess.DEVNULL)
        time.sleep(wait)
        run.send_signal(signal.SIGKILL)
        run.wait()
    subprocess.run([*command, str(tmp_path / "killed"), "--resume"], check=True, capture_output=True)
    whole, killed = (vg.load(tmp_path / name / "packing.vtp") for name in ("whole", "killed"))
    assert whole.count == 10_000
    assert whole.position.tobytes() == killed.position.tobytes()
    assert whole.orientation.tobytes() == killed.orientation.tobytes()
    times = [listed_times(tmp_path / name / "snapshots.pvd") for name in ("whole", "killed")]
    assert times[0] == times[1]
    assert not list((tmp_path / "killed").glob(".checkpoint*"))
