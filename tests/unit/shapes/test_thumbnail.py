"""Small pictures: the silhouette is that of the solid, light comes from above, and it takes no renderer."""

import math
import subprocess
import sys

import numpy as np
import pytest

import voxgran as vg
from voxgran.shapes.describing.thumbnail import DENSITY, VIEW, _in_front, picture, surface_samples
from voxgran.shapes.tessellate import sphere


def picture_of(packing):
    bodies = [shape.vertices[shape.faces] for shape in packing.shapes]
    matrices = packing.matrices * packing.scale[:, None, None]
    flat = packing.dimension == 2
    return picture(bodies, packing.shape_id, matrices, packing.position, packing.diameters, flat=flat)


def picture_of_shape(name):
    container = vg.Rectangle((2, 2)) if name == "disk" else vg.Box((2, 2, 2))
    return picture_of(vg.Packing.of([vg.make_shape(name)], container, position=[(1, 1, int(name != "disk"))]))


def test_points_lie_on_the_triangles_and_cover_them():
    triangle = np.array([[(0, 0, 0), (2, 0, 0), (0, 1, 0)]], dtype=float)
    points, normals = surface_samples(triangle, 0.05)
    assert (normals == (0, 0, 1)).all()
    assert (points[:, :2] >= 0).all()
    assert (points[:, 0] / 2 + points[:, 1] <= 1 + 1e-12).all()
    assert np.ptp(points[:, 0]) > 1.9
    cells = set(map(tuple, (points[:, :2] // 0.1).astype(int)))
    inside = [(i, j) for i in range(20) for j in range(10) if (i + 1) * 0.05 + (j + 1) * 0.1 <= 1]
    assert cells.issuperset(inside)


@pytest.mark.parametrize("name", ["sphere", "disk"])
def test_a_sphere_covers_a_round_patch(name):
    image = picture_of_shape(name)
    assert image.shape == (160, 160, 4)
    share = image[..., 3].mean() / 255
    assert share == pytest.approx(math.pi / 4 * 0.94**2, rel=0.02)


def test_light_comes_from_above():
    image = picture_of_shape("sphere").astype(float)
    assert image[30:50, 70:90, :3].mean() > 1.2 * image[115:135, 70:90, :3].mean()


@pytest.mark.parametrize("level", [2, 5])
def test_a_surface_has_as_many_points_whatever_its_triangles(level):
    vertices, faces, _ = sphere(level)
    points, normals = surface_samples(vertices[faces], 0.05)
    assert len(points) == pytest.approx(DENSITY * 4 * math.pi / 0.05**2, rel=0.05)
    assert points.mean(axis=0) == pytest.approx(np.zeros(3), abs=0.01)
    assert ((points * normals).sum(axis=1) > 0.9).all()


def test_small_grains_have_fewer_points_than_large_ones(monkeypatch):
    drawn = []
    monkeypatch.setattr(
        "voxgran.shapes.describing.thumbnail._drawn", lambda points, *_, **__: drawn.append(len(points))
    )
    for scale in (1.0, 0.1):
        poses = {"position": [(2, 2, 2), (6, 6, 6)], "scale": [4.0, 4.0 * scale]}
        picture_of(vg.Packing.of(vg.make_shape("sphere"), vg.Box((9, 9, 9)), **poses))
    large, small = drawn
    assert small < 0.6 * large


def test_no_renderer_is_loaded():
    code = (
        "import sys, voxgran as vg; vg.make_shape('cone')._repr_html_(); "
        "print([name for name in ('vtkmodules', 'pyvista', 'open3d', 'numba') if name in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


@pytest.mark.slow
def test_grains_behind_others_are_left_out(monkeypatch):
    """The picture stays the same, and of a deep packing few grains are drawn."""
    position = np.mgrid[:8, :8, :8].reshape(3, -1).T + 0.5
    packing = vg.Packing.of(vg.shapes.sphere(), vg.Box((8, 8, 8)), position=position)
    monkeypatch.setattr("voxgran.shapes.describing.thumbnail.DENSITY", 2.0)
    some = picture_of(packing).astype(float)
    monkeypatch.setattr("voxgran.shapes.describing.thumbnail.FEW", 2000)
    assert np.abs(some - picture_of(packing)).mean() < 1.0
    front = _in_front(position @ VIEW.T, 1.0)
    assert 0.1 * packing.count < len(front) < 0.6 * packing.count
