"""The bytes a voxel that docs/guide/voxels.md states: no operation takes more."""

import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran.lattice.grid import Grid
from voxgran.voxels.closed_form import spheres_bits

N = 160
GRID = Grid((-1.0, -1.0, -1.0), 2.0 / N, (N, N, N))
CALLS = {
    "voxelize": lambda shape, mask, share: vg.voxelize(shape, grid=GRID),
    "voxelize(fraction=True)": lambda shape, mask, share: vg.voxelize(shape, grid=GRID, fraction=True),
    "distance_transform": lambda shape, mask, share: vg.distance_transform(mask),
    "signed_distance": lambda shape, mask, share: vg.signed_distance(shape, grid=GRID),
    "erosion": lambda shape, mask, share: vg.erosion(mask, 2.5),
    "closing": lambda shape, mask, share: vg.closing(mask, 2.5),
    "connected_components": lambda shape, mask, share: vg.connected_components(mask),
    "local_thickness": lambda shape, mask, share: vg.local_thickness(mask),
    "resample": lambda shape, mask, share: vg.resample(mask, factor=0.5, method="nearest"),
    "crop": lambda shape, mask, share: vg.crop(mask),
    "iso_surface": lambda shape, mask, share: vg.iso_surface(share),
}


def stated(name):
    """Return the bytes a voxel that the page states."""
    page = (Path(__file__).parents[2] / "docs" / "guide" / "voxels.md").read_text()
    row = next(line for line in page.splitlines() if line.startswith("|") and f"`{name}`" in line.split("|")[1])
    number = row.split("|")[2].strip()
    return {"1/8": 0.125, "that of the result": 0.125}.get(number) or float(re.match(r"\d+", number)[0])


@pytest.fixture(scope="module")
def inputs():
    centers = np.array([[0.0, 0, 0], [0.6, 0.1, 0.2], [-0.5, -0.4, 0.1]])
    mask = spheres_bits(centers, np.array([0.3, 0.2, 0.35]), GRID, cover="center").unpacked()
    return vg.make_shape("solid_union", seed=2), mask, mask.astype(float)


@pytest.mark.parametrize("name", [slow(name) if name == "iso_surface" else name for name in CALLS])
def test_no_more_than_stated(name, inputs):
    CALLS[name](*inputs)
    tracemalloc.start()
    try:
        CALLS[name](*inputs)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # what depends on the surface: pieces of triangles, runs, corners
    beside = 12e6 if name in ("iso_surface", "voxelize(fraction=True)") else 2e6
    assert peak <= stated(name) * N**3 + beside


def peak_of(work):
    """Return the bytes that a call takes at its peak."""
    work()
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the mesh has")
def test_what_stands_beside_the_bytes_a_voxel(inputs):
    """The third column of the page."""
    shape, mask, _ = inputs
    sphere, voxels = vg.make_shape("ellipsoid"), N**3
    cut = len(vg.voxelize(sphere, grid=GRID, fraction=True).shares.cut)
    bits = vg.voxelize(sphere, grid=GRID).bits
    holes = shape.faces[1:]
    limits = [
        (lambda: vg.voxelize(shape, grid=GRID, cover="touch"), voxels / 4 + 2e6),
        (lambda: vg.voxelize(sphere, grid=GRID, fraction=True), (2 + 1 / 8) * voxels + 200 * cut),
        (lambda: vg.voxelize_mesh(shape.vertices, shape.faces, grid=GRID), voxels / 8 + 25 * 2**20),
        (lambda: vg.voxelize_mesh(shape.vertices, holes, grid=GRID), (4 + 1 / 8) * voxels + 25 * 2**20),
        (lambda: vg.distance_transform(mask, squared=True), 4 * voxels + 2e6),
        (lambda: (bits.count(), bits.centroid(), bits.bounds(), bits.face_count()), 30 * 2**20),
    ]
    for work, limit in limits:
        assert peak_of(work) <= limit
