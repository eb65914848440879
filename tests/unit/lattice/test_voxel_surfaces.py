"""Surfaces of voxels as they are: closed and without crossings for any image."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxgran._base.seeds import stream
from voxgran.geometry.crossing import count_crossings
from voxgran.lattice.cuberille import voxel_surface
from voxgran.lattice.label import components
from voxgran.shapes.shells import edge_faults


def volume(vertices, faces):
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.einsum("fi,fi->", a, np.cross(b, c)) / 6


def random_mask(seed, share):
    mask = stream(seed, "mask").random((5, 6, 4)) < share
    mask[2, 2, 2] = True
    return mask


@given(seed=st.integers(0, 10**6), share=st.floats(0.05, 0.95))
def test_any_voxels_have_a_closed_surface_in_which_each_edge_has_two_faces(seed, share):
    mask = random_mask(seed, share)
    vertices, faces = voxel_surface(mask)
    assert edge_faults(faces, len(vertices)).tolist() == [0, 0, 0]
    assert np.array_equal(vertices, np.round(2 * vertices) / 2)
    assert count_crossings(vertices, faces) == 0
    assert volume(vertices, faces) == pytest.approx(mask.sum(), rel=1e-13)


def test_the_surface_of_a_block_is_that_of_the_block():
    mask = np.zeros((5, 6, 7), dtype=bool)
    mask[1:3, 2:5, 3:7] = True
    vertices, faces = voxel_surface(mask)
    assert np.array_equal([vertices.min(axis=0), vertices.max(axis=0)], [(1, 2, 3), (3, 5, 7)])
    assert np.array_equal(vertices, np.round(vertices))
    assert len(faces) == 2 * 2 * (2 * 3 + 3 * 4 + 4 * 2)
    assert volume(vertices, faces) == pytest.approx(24.0, rel=1e-14)


def test_voxels_that_share_an_edge_or_a_corner_only_have_vertices_of_their_own_there():
    for other in ((2, 2, 1), (2, 2, 2)):
        mask = np.zeros((4, 4, 4), dtype=bool)
        mask[1, 1, 1] = mask[other] = True
        vertices, faces = voxel_surface(mask)
        double = len(vertices) - len(np.unique(vertices, axis=0))
        # the ends and the middle of the edge, or the corner
        assert double == (3 if other[2] == 1 else 1)
        assert components(len(vertices), faces[:, 0], faces[:, 1]).max() == 1
