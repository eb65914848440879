"""A bed that tests of the app share."""

import pytest

import voxgran as vg


@pytest.fixture(scope="session")
def bed():
    """Return boxes and spheres at rest."""
    shapes = [vg.shapes.box(), vg.shapes.sphere()]
    return vg.pack(shapes, vg.Box((3, 3, 6)), "gravity", count=14, seed=1, unit="mm")
