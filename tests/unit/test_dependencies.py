"""The floors that pyproject.toml states: none is older than what the package needs."""

import re
import tomllib
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[2] / "pyproject.toml"
#: the oldest releases that work with NumPy 2, found by installing them; `numpy.bitwise_count` came with NumPy 2.0
FLOORS = {
    "contourpy": (1, 2, 1),
    "imagecodecs": (2024, 9, 22),
    "matplotlib": (3, 8, 4),
    "meshio": (5, 3, 5),
    "netCDF4": (1, 7, 1),
    "numba": (0, 60),
    "numpy": (2, 0),
    "pynrrd": (1, 1, 1),
    "scikit-image": (0, 23, 2),
    "scipy": (1, 13),
}


def stated():
    """Return the floors of the project by library, a list each, those of the extras included."""
    project = tomllib.loads(PROJECT.read_text())["project"]
    found = {}
    for line in [
        *project["dependencies"],
        *(line for lines in project["optional-dependencies"].values() for line in lines),
    ]:
        name, floor = re.fullmatch(r"([\w.-]+)(?:\[\w+\])?>=([\d.]+)(?:,<[\d.]+)?", line).groups()
        found.setdefault(name, []).append(tuple(int(part) for part in floor.split(".")))
    return found


@pytest.mark.parametrize("name", FLOORS)
def test_no_floor_is_older_than_what_is_needed(name):
    assert stated()[name]
    assert all(floor >= FLOORS[name] for floor in stated()[name])


def test_extras_agree_on_their_floors():
    assert [name for name, floors in stated().items() if len(set(floors)) > 1] == []
