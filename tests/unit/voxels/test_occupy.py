import numpy as np
import pytest
from kit import mesh_box, slow
from scipy.ndimage import binary_dilation, binary_erosion, label

import voxgran as vg
from voxgran._base.errors import InputError, TooLargeError, UnknownNameError
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import lattice_rotations, quaternions_of, random_rotations, rotation_matrices
from voxgran.lattice.grid import Grid
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.voxels.model import Voxels
from voxgran.voxels.occupy import BACKENDS, occupy, voxelize
from voxgran.voxels.touch import touched_voxels

TURNS = random_rotations(stream(8, "turns"), 3)


def cube_grid(half, size):
    return Grid((-half * size,) * 3, size, (2 * half,) * 3)


@pytest.fixture(scope="module")
def scan(data_dir):
    return vg.load_shape(data_dir / "itokawa_lp.obj")


@pytest.mark.parametrize("turn", range(3))
def test_both_backends_give_the_same_voxels_of_a_scan(scan, turn):
    size = scan.diameter / 25
    grid = cube_grid(26, size)
    masks = [occupy(scan, grid, rotation=TURNS[turn], backend=name) for name in BACKENDS]
    assert masks[0].sum() * size**3 == pytest.approx(scan.volume, rel=0.01)
    assert np.array_equal(masks[0], masks[1])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("nudge", [0.0, 5e-7, -5e-7, 2e-6, -2e-6, 5e-5, -5e-5])
def test_centers_near_the_surface_are_settled_by_one_rule(backend, nudge):
    # faces at a distance of `nudge` voxels outside of centers: on the surface, those on the lower side are in
    grid = Grid((-10.5,) * 3, 1.0, (21,) * 3)
    box = mesh_box([10 + 2 * nudge] * 3)
    voxels = voxelize(box, grid=grid, backend=backend)
    assert voxels.mask.sum() == (10 if nudge == 0 else 11 if nudge > 0 else 9) ** 3
    if nudge == 0:
        assert np.argwhere(voxels.mask).min() == 5
        assert np.argwhere(voxels.mask).max() == 14


@pytest.mark.parametrize("backend", BACKENDS)
def test_touch_is_the_same_for_both_backends_and_closed(backend):
    box = mesh_box([4.0, 4.0, 3.0])
    grid = cube_grid(5, 1.0)
    mask = occupy(box, grid, cover="touch", backend=backend)
    # faces between voxels touch the voxels on both sides; at +-1.5 they run through voxels
    assert np.argwhere(mask).min(axis=0).tolist() == [2, 2, 3]
    assert np.argwhere(mask).max(axis=0).tolist() == [7, 7, 6]
    assert mask.sum() == 6 * 6 * 4


def test_touch_is_the_surface_and_what_it_encloses(scan):
    grid = cube_grid(20, scan.bounding_radius / 17.3)
    for turn in TURNS:
        mask = occupy(scan, grid, rotation=turn, cover="touch")
        posed = scan.rotated(turn)
        surface = touched_voxels(posed.vertices, posed.faces, grid).unpacked()
        assert np.array_equal(surface, occupy(scan, grid, rotation=turn, cover="surface"))
        # the twin: flood the outside from a corner; this solid has no cavity
        regions = label(~surface)[0]
        assert np.array_equal(mask, regions != regions[0, 0, 0])
        assert (mask | ~occupy(scan, grid, rotation=turn)).all()


def test_the_pose_is_that_of_the_moved_mesh(scan):
    turn, scale, offset = TURNS[0], 1.7, np.array([0.3, -0.2, 0.11]) * scan.diameter
    matrix = rotation_matrices(turn[None])[0]
    moved = Mesh(scan.vertices @ matrix.T * scale + offset, scan.faces)
    grid = cube_grid(18, scan.diameter / 9)
    for cover in ("center", "touch"):
        posed = occupy(scan, grid, scale=scale, rotation=turn, offset=offset, cover=cover)
        # a shape made of the moved mesh remembers where its centroid lay
        again = Shape.of(moved, name="moved")
        assert np.array_equal(posed, occupy(again, grid, offset=again.offset, cover=cover))


@pytest.mark.parametrize("cover", ["center", "touch"])
def test_rotations_of_the_lattice_turn_the_voxels(scan, cover):
    n, turn = 24, TURNS[1]
    grid = cube_grid(n // 2, scan.bounding_radius / 11)
    mask = occupy(scan, grid, rotation=turn, cover=cover)
    centers = np.argwhere(mask) + 0.5 - n / 2
    for matrix in lattice_rotations():
        turned = Shape(scan.geometry.rotated(matrix @ rotation_matrices(turn[None])[0]), "turned")
        expected = np.zeros_like(mask)
        expected[tuple((centers @ matrix.T + n / 2 - 0.5).astype(int).T)] = True
        assert np.array_equal(occupy(turned, grid, cover=cover), expected)
    assert np.allclose(quaternions_of(lattice_rotations()[:1]), [[1, 0, 0, 0]])


def test_spheres_in_closed_form():
    sphere = Shape.of(Spheres(np.array([[0.0, 0, 0], [1.4, 0.3, 0]]), np.array([1.0, 0.7])), name="two")
    grid = cube_grid(16, 0.171)
    centers = grid.coordinates(np.argwhere(np.ones(grid.shape)))
    assert np.array_equal(occupy(sphere, grid).ravel(), sphere.geometry.contains(centers))
    # the nearest point of each cube
    touch = np.zeros(len(centers), dtype=bool)
    for middle, radius in zip(sphere.geometry.centers, sphere.geometry.radii, strict=True):
        nearest = np.clip(middle, centers - 0.171 / 2, centers + 0.171 / 2)
        touch |= np.linalg.norm(nearest - middle, axis=1) <= radius
    assert np.array_equal(occupy(sphere, grid, cover="touch").ravel(), touch)


@pytest.mark.parametrize("cover", ["center", "touch"])
def test_one_sphere_is_a_sphere(cover):
    sphere = vg.make_shape("sphere")
    one = Shape.of(Spheres(np.zeros((1, 3)), np.array([0.5])), name="one")
    grid = cube_grid(10, 0.0613)
    place = [0.02, -0.01, 0.04]
    masks = [occupy(shape, grid, scale=0.9, offset=place, cover=cover) for shape in (sphere, one)]
    assert np.array_equal(*masks)
    if cover == "center":
        # its tessellation is inscribed
        meshed = occupy(sphere, grid, scale=0.9, offset=place, backend="open3d")
        assert not (meshed & ~masks[0]).any()
        assert meshed.sum() > 0.97 * masks[0].sum()


@pytest.mark.parametrize("kind", ["ellipsoid", "box", "cylinder", "cone", "spherocylinder"])
def test_regular_solids(kind):
    sizes = {"ellipsoid": (1.0, 0.7, 0.5), "box": (1.0, 1.4, 0.8), "cone": (0.9, 1.2)}
    shape = Shape.of(Primitive(kind, sizes.get(kind, (0.6, 1.3))), name=kind).rotated(TURNS[2])
    size = shape.diameter / 15.3
    voxels = voxelize(shape, voxel_size=size)
    centers = voxels.grid.coordinates(np.argwhere(np.ones(voxels.mask.shape)))
    assert np.array_equal(voxels.mask.ravel(), shape.geometry.contains(centers))


@pytest.mark.parametrize("kind", ["ellipsoid", slow("cylinder"), slow("cone"), "spherocylinder"])
@pytest.mark.parametrize("turn", [slow(None), 0, slow(2)])
def test_cubes_that_round_solids_touch_are_exact(kind, turn):
    sizes = {"ellipsoid": (1.0, 0.7, 0.5), "cylinder": (0.6, 1.3), "cone": (0.9, 1.2), "spherocylinder": (0.6, 1.1)}
    shape = Shape.of(Primitive(kind, sizes[kind]), name=kind)
    shape = shape if turn is None else shape.rotated(TURNS[turn])
    grid = Grid((-1.31, -1.27, -1.35), 0.171, (16, 16, 17))
    mask = occupy(shape, grid, cover="touch")
    # the independent checker: the largest depth of a point of the cube in the solid, by a convex minimization
    edge = mask ^ binary_erosion(mask) | binary_dilation(mask) ^ mask
    solid = shape.geometry
    for voxel in np.argwhere(edge):
        low = np.array(grid.origin) + voxel * grid.voxel_size
        gap = least_gauge(solid, low, low + grid.voxel_size)
        if abs(gap) > 1e-6:
            assert mask[tuple(voxel)] == (gap < 0), (voxel, gap)


def least_gauge(solid, low, high):
    """Return the least value over a cube of a convex function that is below 0 in the solid."""
    d, turn = solid.dimensions, solid.matrix

    def gauge(points):
        x, y, z = (points @ turn).T
        if solid.kind == "ellipsoid":
            return np.sqrt((x / d[0]) ** 2 + (y / d[1]) ** 2 + (z / d[2]) ** 2) - 1
        if solid.kind == "cylinder":
            return np.maximum(np.hypot(x, y) / d[0] - 1, 2 * abs(z) / d[1] - 1)
        if solid.kind == "spherocylinder":
            return np.sqrt(x**2 + y**2 + np.maximum(abs(z) - d[1] / 2, 0) ** 2) - d[0]
        return np.maximum(np.hypot(x, y) - d[0] * (0.75 - z / d[1]), -0.25 * d[1] - z)

    # the gauge is convex: a compass search from its best corner, with all 26 directions, ends near the least value
    best = np.clip(np.zeros(3), low, high)
    value, step = gauge(best[None])[0], (high - low).max()
    ways = np.array([w for w in np.ndindex(3, 3, 3) if w != (1, 1, 1)]) - 1.0
    generator = stream(12, "ways")
    while step > 1e-9:
        tries = np.clip(best + step * np.concatenate([ways, generator.normal(size=(20, 3))]), low, high)
        values = gauge(tries)
        if values.min() < value - 1e-15:
            best, value = tries[int(np.argmin(values))], values.min()
        else:
            step /= 1.6
    return value


def test_outlines():
    disk = Shape.of(Outline("disk", radius=1.0), name="disk")
    grid = Grid((-1.5, -1.4, 7.0), 0.13, (24, 23, 1))
    x, y = np.meshgrid(grid.centers(0), grid.centers(1), indexing="ij")
    place = np.array([0.07, -0.03, 0.0])
    mask = occupy(disk, grid, offset=place)
    assert np.array_equal(mask[:, :, 0], np.hypot(x - 0.07, y + 0.03) <= 1)
    dx, dy = (np.maximum(np.abs(c - p) - 0.065, 0) for c, p in zip((x, y), place[:2], strict=True))
    assert np.array_equal(occupy(disk, grid, offset=place, cover="touch")[:, :, 0], np.hypot(dx, dy) <= 1)


def test_a_polygon_is_turned_and_moved():
    # an L of three quarters: turned by a right angle its notch lies at the upper left
    corners = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2.0]])
    bend = Shape.of(Outline("polygon", vertices=corners), name="L")
    grid = Grid((-1.0, -1.0, 0.0), 0.125, (16, 16, 1))
    quarter = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    place = np.array([0.5 - bend.offset[1] / 2, bend.offset[0] / 2 - 0.5, 0.0])
    # the corner of the L at (0.5, -0.5), one arm upward, one to the left
    mask = occupy(bend, grid, scale=0.5, rotation=quarter, offset=place)[:, :, 0]
    x, y = np.meshgrid(grid.centers(0), grid.centers(1), indexing="ij")
    square = (np.abs(x) < 0.5) & (np.abs(y) < 0.5)
    assert np.array_equal(mask, square & ~((x < 0) & (y > 0)))
    touch = occupy(bend, grid, scale=0.5, rotation=quarter, offset=place, cover="touch")[:, :, 0]
    # a ring more: the perimeter of 32 pixels, one at each of five corners, one less at the notch
    assert touch.sum() == 3 * 4 * 4 + 32 + 5 - 1


def test_pixels_that_a_polygon_touches():
    # corners at quarter pixels: the touched pixels of an upright square are those that it overlaps
    square = Shape.of(
        Outline("polygon", vertices=np.array([[0.25, 0.25], [4.75, 0.25], [4.75, 3.75], [0.25, 3.75]])), name="s"
    )
    grid = Grid((0.0, 0.0, -0.5), 1.0, (6, 5, 1))
    assert occupy(square, grid, offset=square.offset, cover="touch").sum() == 5 * 4
    assert occupy(square, grid, offset=square.offset).sum() == 5 * 4
    voxels = voxelize(square, voxel_size=0.1)
    assert voxels.mask.shape[2] == 1
    assert voxels.volume == pytest.approx(square.volume, rel=0.02)


def test_covers_and_fractions_go_together(scan):
    voxels = voxelize(scan, voxel_size=scan.diameter / 8, cover="touch", fraction=True)
    assert np.array_equal(voxels.mask, voxelize(scan, voxel_size=scan.diameter / 8, cover="touch").mask)
    assert (voxels.mask | (voxels.fraction == 0)).all()
    assert voxels.volume == pytest.approx(scan.volume, rel=1e-12)


def test_bad_input_is_refused(scan):
    grid = cube_grid(2, 1.0)
    with pytest.raises(InputError, match="voxel_size is missing"):
        voxelize(scan)
    with pytest.raises(InputError, match="exactly one"):
        voxelize(scan, voxel_size=1.0, grid=grid)
    with pytest.raises(InputError, match="shape"):
        voxelize(scan, grid=grid, out=np.zeros((4, 4, 5), dtype=bool))
    with pytest.raises(InputError, match="type float"):
        voxelize(scan, grid=grid, out=np.zeros((4, 4, 4)))
    with pytest.raises(InputError, match="npy"):
        voxelize(scan, grid=grid, out="mask.tif")
    with pytest.raises(InputError, match="voxel_size"):
        voxelize(scan, voxel_size=0.0)
    with pytest.raises(InputError, match="cover"):
        voxelize(scan, voxel_size=1.0, cover="surface")
    with pytest.raises(UnknownNameError, match="scanline"):
        voxelize(scan, voxel_size=1.0, backend="scan")
    with pytest.raises(TooLargeError, match="voxel_size"):
        voxelize(scan, voxel_size=scan.diameter * 1e-6)
    with pytest.raises(InputError, match="scale"):
        occupy(scan, grid, scale=-1.0)
    with pytest.raises(InputError, match="rotation"):
        occupy(scan, grid, rotation=[1, 1, 0, 0])
    with pytest.raises(InputError, match="offset"):
        occupy(scan, grid, offset=[np.nan, 0, 0])


def test_the_mask_is_written_where_it_is_wanted(scan, tmp_path):
    voxels = voxelize(scan, voxel_size=scan.diameter / 9)
    out = np.ones(voxels.shape, dtype=bool)
    assert voxelize(scan, grid=voxels.grid, out=out).mask is out
    assert np.array_equal(out, voxels.mask)
    path = tmp_path / "mask.npy"
    mapped = voxelize(scan, grid=voxels.grid, out=path)
    assert isinstance(mapped.mask, np.memmap)
    assert np.array_equal(np.load(path), voxels.mask)
    assert mapped.volume == voxels.volume
    before = path.read_bytes()
    with pytest.raises(InputError, match="cover"):
        voxelize(scan, grid=voxels.grid, cover="surface", out=path)
    assert path.read_bytes() == before


def test_bits_and_mask_are_one(scan):
    voxels = voxelize(scan, voxel_size=scan.diameter / 9)
    again = Voxels(voxels.mask, voxels.origin, voxels.voxel_size)
    assert np.array_equal(again.bits.words, voxels.bits.words)
    assert again.volume == voxels.volume == voxels.mask.sum() * voxels.voxel_size**3
    assert np.allclose(voxels.centroid, voxels.grid.coordinates(np.argwhere(voxels.mask)).mean(axis=0))
    assert np.abs(voxels.centroid).max() < 0.05 * scan.diameter
