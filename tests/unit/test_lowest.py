"""The script that writes the lowest versions as constraints for pip."""

import runpy
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
constraints = runpy.run_path(str(ROOT / "tools" / "lowest.py"))["constraints"]
PROJECT = {
    "dependencies": ["numpy>=2.0", "Rich>=13", "contourpy>=1.2.1"],
    "optional-dependencies": {"images": ["tifffile>=2023.7"], "bad": ["vtk"]},
}


def test_floors_become_exact_versions_or_their_newest_correction():
    assert constraints(PROJECT, []) == ["contourpy==1.2.1", "numpy==2.0.*", "Rich==13.*"]
    assert "tifffile==2023.7.*" in constraints(PROJECT, ["images"])


@pytest.mark.parametrize(("extra", "words"), [("bad", "'vtk' has no floor"), ("imags", "'imags' is unknown")])
def test_what_has_no_floor_is_refused(extra, words):
    with pytest.raises(ValueError, match=words):
        constraints(PROJECT, [extra])


def test_all_requirements_of_the_project_have_one():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = list(project["optional-dependencies"])
    lines = {line for lines in project["optional-dependencies"].values() for line in lines} | {*project["dependencies"]}
    assert len(constraints(project, extras)) == len(lines)
