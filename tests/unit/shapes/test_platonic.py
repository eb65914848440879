"""Platonic solids against their closed formulas."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError

ROOT5 = 5**0.5
#: corners, faces, volume of the solid whose edge is 1
SOLIDS = {
    "tetrahedron": (4, 4, 2**0.5 / 12),
    "cube": (8, 6, 1.0),
    "octahedron": (6, 8, 2**0.5 / 3),
    "dodecahedron": (20, 12, (15 + 7 * ROOT5) / 4),
    "icosahedron": (12, 20, 5 * (3 + ROOT5) / 12),
}


@pytest.mark.parametrize("solid", SOLIDS)
def test_corners_faces_edges_and_volume(solid):
    corners, faces, volume = SOLIDS[solid]
    shape = vg.make_shape("platonic", solid=solid, diameter=2.0)
    assert shape.diameter == pytest.approx(2.0, rel=1e-14)
    assert len(shape.vertices) == corners
    a, b, c = np.moveaxis(shape.vertices[shape.faces], 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert len(np.unique(np.round(normals, 9) + 0.0, axis=0)) == faces
    apart = np.linalg.norm(shape.vertices[:, None] - shape.vertices, axis=2)
    edge = apart[apart > 1e-9].min()
    # Euler: corners - edges + faces = 2, and every edge is as long as every other
    assert np.isclose(apart, edge, rtol=1e-12).sum() == 2 * (corners + faces - 2)
    assert shape.volume == pytest.approx(volume * edge**3, rel=1e-13)
    assert np.ptp(np.linalg.norm(shape.vertices, axis=1)) < 1e-14


def test_an_unknown_solid_is_refused():
    with pytest.raises(InputError, match="cub"):
        vg.make_shape("platonic", solid="cub")
