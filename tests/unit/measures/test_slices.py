"""Exact volumes in boxes, against booleans of manifold3d and against quadrature."""

import math

import numpy as np
import pytest

from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.geometry.halfspaces import cut_disks, cut_spheres
from voxgran.measures.slices import as_window, cut_mesh, cut_polygon
from voxgran.shapes.tessellate import sphere, unit_box

COMB = np.array([[0, 0], [4, 0], [4, 3], [3, 3], [3, 1], [1, 1], [1, 3], [0, 3]], dtype=float)


def box_of(lower, upper):
    """Return the corners of a box as arrays."""
    return {"lower": np.array(lower, dtype=float), "upper": np.array(upper, dtype=float)}


def sphere_box_volume(centers, radii, *, lower, upper):
    """Return the volume of each sphere inside a box."""
    return cut_spheres(np.array(centers, dtype=float), np.array(radii), **box_of(lower, upper))


def mesh_box_volume(vertices, faces, *, lower, upper):
    """Return the volume of a closed mesh inside a box."""
    return cut_mesh(vertices, faces, np.eye(3)[None], np.zeros((1, 3)), **box_of(lower, upper))[0]


def disk_rectangle_area(centers, radii, *, lower, upper):
    """Return the area of each disk inside a rectangle."""
    return cut_disks(np.array(centers, dtype=float), np.array(radii), **box_of(lower, upper))


def polygon_rectangle_area(vertices, *, lower, upper):
    """Return the area of a polygon inside a rectangle."""
    return cut_polygon(vertices, np.eye(2)[None], np.zeros((1, 2)), **box_of(lower, upper))[0]


def bumpy():
    """Return a closed surface that is not convex."""
    vertices, faces, _ = sphere(3)
    return vertices * (1 + 0.4 * np.sin(5 * vertices[:, :1]) * np.cos(4 * vertices[:, 1:2])), faces


def test_sphere_in_a_box_by_adaptive_quadrature():
    integrate = load("scipy.integrate")
    low, high = np.array([-0.3, -0.8, 0.1]), np.array([0.6, 0.2, 2.0])

    def chord(y, x):
        left = max(0.0, 1 - x * x - y * y)
        return max(0.0, min(high[2], math.sqrt(left)) - max(low[2], -math.sqrt(left)))

    def strip(x):
        return integrate.quad(chord, low[1], high[1], args=(x,), epsabs=1e-12, points=[0.0])[0]

    total = integrate.quad(strip, low[0], high[0], epsabs=1e-12)[0]
    assert sphere_box_volume([[0, 0, 0]], [1.0], lower=low, upper=high)[0] == pytest.approx(total, abs=1e-9)


def test_spheres_scale_and_move():
    generator = stream(0, "spheres")
    centers, radii = generator.uniform(-1, 1, (50, 3)), generator.uniform(0.1, 1, 50)
    low, high = np.array([-0.5, -0.2, -0.4]), np.array([0.3, 0.7, 0.9])
    first = sphere_box_volume(centers, radii, lower=low, upper=high)
    size = 2.0**20
    again = sphere_box_volume(centers * size, radii * size, lower=low * size, upper=high * size)
    assert (again == first * size**3).all()
    shift = np.array([1.0, 2.0, 4.0])
    moved = sphere_box_volume(centers + shift, radii, lower=low + shift, upper=high + shift)
    assert moved == pytest.approx(first, abs=1e-14)


def test_disks_in_a_rectangle():
    found = disk_rectangle_area([[0, 0], [5, 5], [0.5, 0.5]], [1.0, 0.5, 0.1], lower=[0, 0], upper=[2, 2])
    assert found == pytest.approx([math.pi / 4, 0.0, math.pi / 100], abs=1e-15)


def test_meshes_agree_with_manifold():
    library, (vertices, faces) = load("manifold3d"), bumpy()
    solid = library.Manifold(library.Mesh64(np.ascontiguousarray(vertices), faces.astype(np.uint64)))
    assert mesh_box_volume(vertices, faces, lower=[-np.inf] * 3, upper=[np.inf] * 3) == pytest.approx(
        solid.volume(), rel=1e-13
    )
    generator = stream(1, "windows")
    for _ in range(60):
        low = generator.uniform(-1.2, 0.9, 3)
        high = low + generator.uniform(0.01, 2.0, 3)
        cut = solid ^ library.Manifold.cube(tuple(high - low)).translate(tuple(low))
        assert mesh_box_volume(vertices, faces, lower=low, upper=high) == pytest.approx(cut.volume(), abs=1e-13)


def test_the_windows_of_a_grid_hold_the_whole_mesh():
    vertices, faces = bumpy()
    edges = np.array([-np.inf, -0.4, 0.0, 0.3, np.inf])
    parts = [
        mesh_box_volume(vertices, faces, lower=edges[[i, j, k]], upper=edges[[i + 1, j + 1, k + 1]])
        for i, j, k in np.ndindex(4, 4, 4)
    ]
    whole = mesh_box_volume(vertices, faces, lower=[-9] * 3, upper=[9] * 3)
    assert min(parts) >= 0
    assert sum(parts) == pytest.approx(whole, rel=1e-13)


def test_a_box_in_a_box_whose_faces_lie_on_it():
    vertices, faces, _ = unit_box()
    for low, high, wanted in [
        ([-0.5] * 3, [0.5] * 3, 1.0),
        ([0.0] * 3, [0.5] * 3, 0.125),
        ([0.5, -1, -1], [1, 1, 1], 0.0),
        ([-1, -1, 0.5], [1, 1, 1], 0.0),
        ([-0.25] * 3, [2] * 3, 0.75**3),
    ]:
        assert mesh_box_volume(vertices, faces, lower=low, upper=high) == pytest.approx(wanted, abs=1e-16)


def test_the_kernel_agrees_with_its_plain_twin():
    vertices, faces = bumpy()
    # its twin: fine columns, each with the lengths between the crossings of its line
    low, high = np.array([-0.4, -0.5, -0.2]), np.array([0.5, 0.3, 0.6])
    steps = 60
    axes = [low[a] + (np.arange(steps) + 0.5) * (high[a] - low[a]) / steps for a in range(2)]
    x, y = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
    total = 0.0
    for a, b, c in vertices[faces]:
        twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if twice == 0:
            continue
        u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / twice
        v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / twice
        hit = (u > 0) & (v > 0) & (u + v < 1)
        z = u * a[2] + v * b[2] + (1 - u - v) * c[2]
        total += np.sign(twice) * np.clip(z[hit], low[2], high[2]).sum()
    cell = np.prod((high - low)[:2]) / steps**2
    found = cut_mesh(vertices, faces, np.eye(3)[None], np.zeros((1, 3)), lower=low, upper=high)[0]
    assert found == pytest.approx(total * cell, rel=2e-3)


def test_copies_are_mapped():
    vertices, faces, _ = unit_box()
    maps, centers = np.array([np.eye(3), 2 * np.eye(3)]), np.array([[0.0, 0, 0], [10.0, 0, 0]])
    found = cut_mesh(vertices, faces, maps, centers, lower=np.array([0.0, -5, -5]), upper=np.array([10.0, 5, 5]))
    assert found == pytest.approx([0.5, 4.0], abs=1e-15)


def test_polygons():
    assert polygon_rectangle_area(COMB, lower=[0.5, 0.5], upper=[3.5, 2]) == pytest.approx(2.5, abs=1e-15)
    assert polygon_rectangle_area(COMB, lower=[-9, -9], upper=[9, 9]) == pytest.approx(8.0, abs=1e-15)
    assert polygon_rectangle_area(COMB, lower=[1, 1], upper=[3, 3]) == 0.0
    assert polygon_rectangle_area(COMB, lower=[-np.inf, 2], upper=[np.inf, np.inf]) == pytest.approx(2.0, abs=1e-15)


@pytest.mark.parametrize(("lower", "upper"), [([0, 0, 2], [1] * 3), ([0], [1] * 3), ([np.nan, 0, 0], [1] * 3)])
def test_what_is_refused(lower, upper):
    with pytest.raises(InputError, match="window runs from"):
        as_window(lower, upper, 3)
