"""What a plan says is what the run does: libraries loaded, solids turned into voxels and points."""

import json
import subprocess
import sys

import pytest

SCENE = """
[[shape]]
{shape}
[sizes]
kind = "uniform"
low = 0.8
high = 1.2
[container]
{container}
[packing]
{packing}
[output]
vtk = {vtk}
statistics = {statistics}
report = {report}
"""
BALL, DISK, UNION = 'family = "sphere"', 'family = "disk"', 'family = "solid_union"\nseed = 3\nsolids = 3'
BOX = 'kind = "box"\nlengths = [3, 3, 5]\nperiodic = ["x"]'
FLAT = 'kind = "rectangle"\nlengths = [5, 5]'
DIGITAL = 'method = "digital"\ncount = 6\nvoxel_size = 0.1\nsweeps = 5'
POINTS = 'method = "control_point"\ncount = 3\nspacing = 0.3\nsweeps = 5'
CASES = {
    "balls": (BALL, BOX, DIGITAL, "none"),
    "balls as points": (BALL, BOX, POINTS, "none"),
    "disks with statistics": (DISK, FLAT, DIGITAL, "statistics"),
    "disks with surfaces": (DISK, FLAT, DIGITAL, "vtk"),
    "unions": (UNION, BOX, DIGITAL, "none"),
    "unions with a report": (UNION, BOX, DIGITAL, "report"),
}
CODE = """
import json, sys, warnings
import voxgran as vg
from voxgran._base.lazy import loaded
warnings.simplefilter("ignore")
scene = vg.Scene.from_toml(sys.argv[1])
plan = scene.plan().to_mapping()
result = scene.run(sys.argv[2])
print(json.dumps([plan, loaded(), result.packing.provenance["counters"]]))
"""


@pytest.mark.parametrize("name", CASES)
def test_the_run_loads_and_makes_what_the_plan_says(name, tmp_path):
    shape, container, packing, asked = CASES[name]
    output = {key: str(key == asked).lower() for key in ("vtk", "statistics", "report")}
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format(shape=shape, container=container, packing=packing, **output))
    command = [sys.executable, "-c", CODE, str(path), str(tmp_path / "out")]
    out = subprocess.run(command, capture_output=True, text=True, check=False)
    assert out.returncode == 0, out.stderr
    plan, libraries, counters = json.loads(out.stdout.splitlines()[-1])
    assert plan["libraries"] == sorted(libraries)
    assert plan["voxelized_shapes"] == counters["voxelized_shapes"]
    assert plan["sampled_shapes"] == counters["sampled_shapes"]
    assert counters["attempts"] <= plan["attempts"]
