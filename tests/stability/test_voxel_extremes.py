"""Meshes and lattices at the ends of what is possible: slivers, far places, many triangles, thin lattices."""

import subprocess
import sys

import numpy as np
import pytest
from kit import fixed_shape, slow
from scipy.spatial import ConvexHull

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.lattice.grid import Grid
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import unit_box
from voxgran.shapes.winding import winding_numbers
from voxgran.voxels.occupy import voxelize


def pillow(thickness):
    """Return a box of which two faces are split by slivers of a thickness and by a triangle of area 0."""
    vertices, faces, _ = unit_box()
    top = np.flatnonzero((vertices[faces][:, :, 2] == 0.5).all(axis=1))[0]
    a, b, c = faces[top]
    # a vertex next to the side a b splits the face in a sliver and two more
    extra = (vertices[a] + vertices[b]) / 2 + (vertices[c] - (vertices[a] + vertices[b]) / 2) * thickness
    new = len(vertices)
    faces = np.concatenate([np.delete(faces, top, axis=0), [[a, b, new], [b, c, new], [c, a, new]]])
    return np.concatenate([vertices, [extra]]), faces


@pytest.mark.parametrize("thickness", [0.0, 1e-12, 1e-9, 1e-3])
@pytest.mark.parametrize("turn", [None, 0, 1])
def test_slivers_and_triangles_of_no_area(thickness, turn):
    vertices, faces = pillow(thickness)
    plain, sides, _ = unit_box()
    matrix = np.eye(3) if turn is None else rotation_matrices(random_rotations(stream(1, "turn"), 2))[turn]
    grid = Grid((-1.0, -1.0, -1.0), 1 / 16, (32, 32, 32))
    body, box = fixed_shape(vertices @ matrix.T, faces), fixed_shape(plain @ matrix.T, sides)
    found, expected = voxelize(body, grid=grid, fraction=True), voxelize(box, grid=grid, fraction=True)
    assert np.array_equal(found.mask, expected.mask)
    assert np.abs(found.fraction - expected.fraction).max() < 1e-12
    touched = voxelize(body, grid=grid, cover="touch").mask
    assert np.array_equal(touched, voxelize(box, grid=grid, cover="touch").mask)


@pytest.mark.parametrize("far", [1e6, 1e9])
def test_far_away_only_the_digits_of_the_coordinates_are_lost(far, data_dir):
    scan = vg.load_shape(data_dir / "bennu_lp.obj")
    scan = scan.scaled(1000 / scan.diameter)
    place = np.array([far, -far, far])
    grid = Grid((-600.0, -600.0, -600.0), 25.0, (48, 48, 48))
    away = Grid(tuple(float(value) for value in place - 600.0), 25.0, grid.shape)
    near = voxelize(scan, grid=grid, fraction=True)
    moved = voxelize(fixed_shape(scan.vertices + place, scan.faces), grid=away, fraction=True)
    assert np.count_nonzero(near.mask != moved.mask) <= 2
    assert np.abs(near.fraction - moved.fraction).max() < 1e-15 * far
    assert moved.volume == pytest.approx(scan.volume, rel=1e-15 * far)


@pytest.mark.parametrize("size", [1e-12, 1e-6, 1e6, 1e12])
def test_sizes(size, data_dir):
    scan = vg.load_shape(data_dir / "bennu_lp.obj")
    scan = scan.scaled(1 / scan.diameter)
    small = voxelize(scan, voxel_size=1 / 23, fraction=True)
    voxels = voxelize(scan.scaled(size), voxel_size=size / 23, fraction=True)
    assert np.array_equal(voxels.mask, small.mask)
    assert np.abs(voxels.fraction - small.fraction).max() < 1e-12
    assert voxels.volume == pytest.approx(scan.volume * size**3, rel=1e-12)


def test_half_a_million_triangles():
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 501)[:-1], np.linspace(0, np.pi, 501)[1:-1], indexing="ij")
    ring = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1).reshape(-1, 3)
    k = np.arange(500 * 499).reshape(500, 499)
    a, b, c, d = k[:, :-1], k[:, 1:], np.roll(k, -1, 0)[:, 1:], np.roll(k, -1, 0)[:, :-1]
    sides = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    top, after = k[:, 0], np.roll(k[:, 0], -1)
    low, behind = k[:, -1], np.roll(k[:, -1], -1)
    n = len(ring)
    caps = [np.column_stack([np.full(500, n), top, after]), np.column_stack([np.full(500, n + 1), behind, low])]
    body = fixed_shape(np.concatenate([ring, [[0, 0, 1.0], [0, 0, -1]]]), np.concatenate([sides, *caps]))
    assert len(body.faces) == 499_000
    for resolution in (1, 64):
        voxels = voxelize(body, voxel_size=2.0 / resolution, fraction=True)
        assert voxels.volume == pytest.approx(body.volume, rel=1e-12)
    mask = voxels.mask
    distance = np.linalg.norm(voxels.grid.coordinates(np.argwhere(np.ones(mask.shape))), axis=1)
    assert mask.ravel()[distance < 1 - 1e-4].all()
    assert not mask.ravel()[distance > 1].any()


def test_one_triangle_covers_the_lattice():
    # a large tetrahedron whose slanted face runs through the whole lattice
    corners = np.concatenate([np.zeros((1, 3)), 90 * np.eye(3)]) - 20.3
    body = fixed_shape(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    grid = Grid((0.0, 0.0, 0.0), 1.0, (20, 20, 20))
    voxels = voxelize(body, grid=grid, fraction=True)
    level = grid.coordinates(np.argwhere(np.ones(grid.shape))).sum(axis=1)
    assert np.array_equal(voxels.mask.ravel(), level < 90 - 3 * 20.3)
    exact = max(90 - 60.9, 0) ** 3 / 6 - 3 * max(90 - 60.9 - 20, 0) ** 3 / 6
    assert voxels.volume == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("counts", [(1, 1, 1), (1, 1, 4096), (4096, 1, 1), (1, 4096, 1)])
def test_thin_lattices(counts, data_dir):
    scan = vg.load_shape(data_dir / "itokawa_lp.obj")
    size = 2.4 * scan.bounding_radius / max(counts)
    grid = Grid(tuple(-n * size / 2 for n in counts), size, counts)
    voxels = voxelize(scan, grid=grid, fraction=True)
    points = grid.coordinates(np.argwhere(np.ones(counts)))
    inside = winding_numbers(scan.vertices[scan.faces], points) > 0.5
    assert np.array_equal(voxels.mask.ravel(), inside)
    assert 0 < voxels.volume <= scan.volume * (1 + 1e-12)
    assert (voxels.fraction[voxels.mask] > 0).all() or counts == (1, 1, 1)
    assert voxelize(scan, grid=grid, cover="touch").mask[voxels.fraction > 0].all()
    if counts == (1, 1, 1):
        assert voxels.volume == pytest.approx(scan.volume, rel=1e-12)


def test_nan_is_refused():
    vertices, faces, _ = unit_box()
    for bad in (np.nan, np.inf):
        broken = vertices.copy()
        broken[3, 1] = bad
        with pytest.raises(InputError):
            Shape.from_mesh(broken, faces)
        with pytest.raises(InputError):
            vg.voxelize_mesh(broken, faces, voxel_size=0.1)
        with pytest.raises(InputError):
            voxelize(vg.make_shape("box"), voxel_size=bad)


@pytest.mark.parametrize("count", [200, slow(1000)])
def test_random_meshes_keep_within_the_stated_bound(count):
    generator = stream(9, "meshes")
    turns = random_rotations(stream(9, "poses"), count)
    error = []
    for turn in turns:
        points = generator.normal(size=(int(generator.integers(4, 30)), 3)) * generator.uniform(0.2, 1.0, 3)
        found = ConvexHull(points)
        corners = points[found.simplices]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        inward = np.einsum("fi,fi->f", normal, found.equations[:, :3]) < 0
        faces = np.where(inward[:, None], found.simplices[:, ::-1], found.simplices)
        used, local = np.unique(faces, return_inverse=True)
        shape = Shape.from_mesh(points[used], local.reshape(-1, 3)).rotated(turn)
        size = shape.diameter / generator.uniform(2, 20)
        voxels = voxelize(shape, voxel_size=size, fraction=True)
        assert voxels.volume == pytest.approx(shape.volume, rel=1e-12)
        counted = voxels.mask.sum() * size**3
        cut = vg.voxelize(shape, grid=voxels.grid, cover="touch").mask.sum() - len(voxels.shares.runs)
        assert abs(counted - shape.volume) <= cut * size**3
        assert abs(counted - shape.volume) <= len(voxels.shares.cut) * size**3
        error.append((counted - shape.volume) / size**3 / np.sqrt(len(voxels.shares.cut)))
    # centers sample the volume without bias
    assert abs(np.mean(error)) < 0.03 * np.sqrt(1000 / count)
    assert np.std(error) < 0.5


LARGE = """
import voxgran as vg
from voxgran.lattice.grid import Grid
shape = vg.make_shape("solid_union", seed=1)
half = shape.bounding_radius * 1.01
voxels = vg.voxelize(shape, grid=Grid((-half,) * 3, 2 * half / 1024, (1024, 1024, 1024)))
low, high = voxels.bits.bounds()
print(voxels.bits.words.nbytes, voxels.volume / shape.volume, *voxels.centroid, high[0] - low[0])
print(voxels.bits.face_count())
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


@pytest.mark.slow
def test_1024_cubed_voxels_in_bits_stay_below_2_gib():
    done = subprocess.run([sys.executable, "-c", LARGE], capture_output=True, text=True, check=True)
    numbers = [float(word) for word in done.stdout.split()]
    assert numbers[0] == 2**27
    assert numbers[1] == pytest.approx(1, rel=1e-6)
    assert np.abs(numbers[2:5]).max() < 1e-5
    assert numbers[-1] < 2 * 2**20
