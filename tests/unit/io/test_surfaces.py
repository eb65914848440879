"""Merged surfaces enclose the volume of their grains, where these lie."""

import numpy as np
import pytest

from voxgran._base.errors import TooLargeError
from voxgran.contacts import surfaces
from voxgran.contacts.surfaces import merged_surfaces
from voxgran.shapes.mesh import Mesh


def test_each_grain_keeps_its_volume_and_place(mixed):
    merged = merged_surfaces(mixed)
    for grain in range(mixed.count):
        piece = Mesh(merged.vertices.copy(), merged.faces[merged.grain == grain])
        assert piece.volume == pytest.approx(mixed.volumes[grain], rel=0.02)
        np.testing.assert_allclose(piece.centroid, mixed.position[grain], atol=0.02)


def test_only_the_chosen_grains_are_merged(mixed):
    merged = merged_surfaces(mixed, grains=np.array([3, 5]))
    assert set(merged.grain) == {3, 5}
    assert merged.faces.max() == len(merged.vertices) - 1


def test_other_bodies_may_stand_for_the_shapes(mixed):
    corners = (np.eye(3), np.array([[0, 1, 2]]))
    merged = merged_surfaces(mixed, bodies=[corners] * 4)
    assert len(merged.faces) == mixed.count
    first = mixed.matrices[0] @ np.eye(3)[0] * mixed.scale[0] + mixed.position[0]
    np.testing.assert_allclose(merged.vertices[merged.faces[merged.grain == 0][0, 0]], first)


def test_too_many_triangles_are_refused(mixed, monkeypatch):
    monkeypatch.setattr(surfaces, "TRIANGLE_LIMIT", 100)
    with pytest.raises(TooLargeError, match="at most 100 are merged"):
        merged_surfaces(mixed)
