"""Tetrahedral: cells and places of lattices, climbs against closed formulas and SciPy, and packings to targets."""

import math

import meshio
import numpy as np
import pytest
from kit import slow, task_of
from scipy.optimize import linprog
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, MissingFileError, PackingWarning
from voxgran.packing.tessellation.climb import HINT, MOST, _ascend
from voxgran.packing.tessellation.filling import COLUMNS, KIND, REST, Walls, climbed, last_places, next_places, taken
from voxgran.packing.tessellation.mesh import (
    CELL,
    CORNER,
    EDGE,
    FACE,
    NODE,
    inscribed,
    lattice_mesh,
    lattice_points,
    places_of,
    thickness,
    triangulated,
    triangulated_by_tiles,
)
from voxgran.packing.tessellation.method import registration as tetrahedral

pytestmark = pytest.mark.usefixtures("forked_readers")

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
#: edge of the cubes of the lattice, in mean edges of its cells
CUBE = 3 / (1 + math.sqrt(3))
#: what the spheres inscribed in the cells of a body-centered cubic lattice fill, and disks in equilateral triangles
CUBIC, TRIANGULAR = 12 * 4 / 3 * math.pi * (math.sqrt(2) / 8) ** 3, math.pi / (3 * math.sqrt(3))


def random_of(*key):
    return np.random.Generator(np.random.Philox(key))


def start(x, y, z, hint=0.3, most=9.0):
    """Return the queue of one place that is climbed from."""
    row = np.zeros((1, COLUMNS))
    row[0, :3], row[0, HINT], row[0, MOST], row[0, KIND] = (x, y, z), hint, most, REST
    return row


# cells and places


def test_inscribed_spheres_touch_all_sides():
    center, radius = inscribed(np.array([[(0.0, 0, 0), (3, 0, 0), (0, 4, 0)]]))
    assert center[0] == pytest.approx([1, 1, 0])
    assert radius[0] == pytest.approx(1)
    corners = random_of(1).random((20, 4, 3))
    center, radius = inscribed(corners)
    for k in range(4):
        a, b, c = np.moveaxis(np.delete(corners, k, axis=1), 1, 0)
        normal = np.cross(b - a, c - a)
        away = ((center - a) * normal).sum(axis=1) / np.linalg.norm(normal, axis=1)
        assert np.abs(away) == pytest.approx(radius)


def test_places_of_a_cubic_lattice():
    n, edge = 3, 0.7
    box = vg.Box((n * CUBE * edge,) * 3, "xyz", origin=(5, 1, -2))
    mesh = lattice_mesh(box, edge, 0.2, 1)
    place, radius, kind = places_of(mesh, box)
    counts = np.bincount(kind, minlength=5)
    # of each cube: 2 nodes with 14 edges each, of which half are its own, 24 faces, 12 cells of 4 corners
    assert counts[[CELL, NODE, EDGE, FACE, CORNER]].tolist() == [k * n**3 for k in (12, 2, 14, 24, 48)]
    assert ((place >= box.bounds[0]) & (place < box.bounds[1])).all()
    assert np.unique(np.round(place[kind == EDGE], 9), axis=0).shape == (14 * n**3, 3)
    exact = places_of(lattice_mesh(box, edge, 0.0, 1), box)
    assert exact[1] == pytest.approx(math.sqrt(2) / 8 * CUBE * edge)
    assert radius.std() > 0.05 * radius.mean()


def test_places_of_a_triangular_lattice():
    rectangle = vg.Rectangle((6, 3 * math.sqrt(3)), "xy")
    _, radius, kind = places_of(lattice_mesh(rectangle, 1.0, 0.0, 1), rectangle)
    assert np.bincount(kind).tolist() == [72, 36, 108, 0, 216]
    assert radius == pytest.approx(1 / (2 * math.sqrt(3)))


@pytest.mark.parametrize(
    "container", [vg.Box((4, 5, 6)), vg.Cylinder(2, 5), vg.Sphere(2.5, origin=(9, 0, 0)), vg.Disk(3.0)]
)
def test_cells_fill_the_container_and_stay_inside(container):
    mesh = lattice_mesh(container, 0.5, 0.3, 2)
    corners = mesh.nodes[mesh.cells]
    along = corners[:, 1:] - corners[:, :1]
    if container.dimension == 3:
        volume = np.abs(np.linalg.det(along)).sum() / 6
    else:
        volume = np.abs(np.linalg.det(along[:, :, :2])).sum() / 2
    # the surface of a round wall is cut off by the facets of cells of this size
    assert volume == pytest.approx(container.volume, rel=1e-9 if container.kind == "box" else 0.05)
    assert volume <= container.volume * (1 + 1e-9)
    assert container.signed_distance(mesh.nodes).max() < 0.01


# climbs


def test_linear_programs_as_by_scipy():
    for seed in range(60):
        draw, count = random_of(2, seed), 1 + seed % 17
        rows = draw.normal(size=(count, 4))
        rows[:, :3] /= np.linalg.norm(rows[:, :3], axis=1)[:, None]
        box = np.array([0.5, 0.7, 0.9 if seed % 3 else 0.0])
        basis, inverse, step = np.zeros(4, np.int64), np.zeros((4, 4)), np.zeros(4)
        _ascend(rows, count, box, 1e-13, basis, inverse, step)
        upper = np.column_stack([-rows[:, :3], np.ones(count)])
        bounds = [*((-b, b) for b in box), (None, None)]
        twin = linprog([0, 0, 0, -1], A_ub=upper, b_ub=rows[:, 3], bounds=bounds)
        assert step[3] == pytest.approx(-twin.fun, abs=1e-10)
        assert (upper @ step - rows[:, 3]).max() < 1e-10
        assert (np.abs(step[:3]) <= box + 1e-10).all()
        # the multipliers are shares of the rows that hold
        assert inverse[3][basis < count].sum() == pytest.approx(1)


def test_between_four_spheres_and_between_three_disks():
    walls = Walls(vg.Box((9, 9, 9), "xyz"))
    four = np.array([(1.0, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) / math.sqrt(2) + 4
    spheres = np.column_stack([four, np.ones(4)])
    found, normals = climbed(spheres, start(4.1, 3.8, 4.05), walls, 0.01)
    assert found[0] == pytest.approx([4, 4, 4, math.sqrt(1.5) - 1], abs=1e-12)
    assert np.abs(normals[0].sum(axis=0)).max() < 1e-9
    assert np.linalg.norm(normals[0], axis=1) == pytest.approx(1)
    # the next holes are on the other side of each sphere
    rows = next_places(found, normals, walls, 9.0)
    ways = (rows[:, :3] - 4) / (1.3 * found[0, 3])
    assert np.sort((ways @ (four - 4).T) / math.sqrt(1.5), axis=1) == pytest.approx(np.array([[-1, *[1 / 3] * 3]] * 4))
    turns = 2 * math.pi / 3 * np.arange(3)
    disks = np.column_stack([4 + np.cos(turns), 4 + np.sin(turns), np.zeros(3), np.full(3, math.sqrt(0.75))])
    found, normals = climbed(disks, start(4.05, 3.9, 0), Walls(vg.Rectangle((9, 9), "xy")), 0.01)
    assert found[0] == pytest.approx([4, 4, 0, 1 - math.sqrt(0.75)], abs=1e-12)
    assert (normals[0] != 0).any(axis=1).sum() == 3


@pytest.mark.parametrize("shift", [(0, 0, 0), (3.5, 0, 0), (3.5, -3.5, 3.5)])
def test_neighbours_are_found_across_periodic_faces(shift):
    walls = Walls(vg.Box((7, 7, 7), "xyz"))
    four = np.array([(1.0, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) / math.sqrt(2) + 3.5
    spheres = np.column_stack([(four + shift) % 7, np.ones(4)])
    found, _ = climbed(spheres, start(*(np.array([3.45, 3.6, 3.5]) + shift) % 7), walls, 0.01)
    assert (found[0, :3] - 3.5 - shift + 3.5) % 7 == pytest.approx(3.5)
    assert found[0, 3] == pytest.approx(math.sqrt(1.5) - 1, abs=1e-12)


def test_in_a_corner_and_at_round_walls():
    corner = 2 - math.sqrt(3)
    found, _ = climbed(np.array([(1.0, 1, 1, 1)]), start(0.2, 0.3, 0.25), Walls(vg.Box((9, 9, 9))), 0.01)
    assert found[0] == pytest.approx([corner] * 4, abs=1e-12)
    # a disk in the middle and two that touch it and each other leave a hole at the round wall: Descartes
    ring = np.array([(3.0, 3, 0, 1), (5, 3, 0, 1), (4, 3 + math.sqrt(3), 0, 1)])
    found, _ = climbed(ring, start(5.2, 4.6, 0), Walls(vg.Disk(3.0, origin=(7, 7))), 0.01)
    bends = np.array([1.0, 1, -1 / 3])
    assert found[0, 3] == pytest.approx(
        1 / (bends.sum() + 2 * math.sqrt(bends[0] * bends[1] + (bends[0] + bends[1]) * bends[2])), abs=1e-9
    )


@pytest.mark.parametrize("hint", [0.05, 0.3, 3.0])
def test_climbs_end_at_local_maxima_that_touch_four(hint):
    """Also where the spheres within reach are more than are looked at."""
    box, draw = vg.Box((4, 4, 4)), random_of(5)
    spheres = np.column_stack([draw.random((120, 3)) * 4, 0.1 + 0.2 * draw.random(120)])
    queue = np.concatenate([start(*point, hint=hint) for point in draw.random((40, 3)) * 4])

    def clearance(points):
        away = np.linalg.norm(points[:, None] - spheres[None, :, :3], axis=2) - spheres[:, 3]
        return np.column_stack([away, points, 4 - points])

    found, normals = climbed(spheres, queue, Walls(box), 1e-6)
    gaps = np.sort(clearance(found[:, :3]), axis=1)
    assert gaps[:, 0] == pytest.approx(found[:, 3], abs=1e-12)
    assert gaps[:, 3] == pytest.approx(found[:, 3], abs=1e-9)
    assert (found[:, 3] >= clearance(queue[:, :3]).min(axis=1) - 1e-12).all()
    assert ((normals != 0).any(axis=2).sum(axis=1) == 4).all()
    # no direction leads up
    for step in draw.normal(size=(50, 3)) * 1e-5:
        assert (clearance(found[:, :3] + step).min(axis=1) < found[:, 3]).all()


def test_climbs_out_of_a_crowd_see_what_is_beyond_it():
    near = np.column_stack([1.0 + 0.2 * random_of(7).random((100, 3)), np.full(100, 0.01)])
    spheres = np.vstack([near, [(2.5, 2.5, 2.5, 0.6)]])
    found, _ = climbed(spheres, start(1.25, 1.25, 1.25, hint=3.0), Walls(vg.Box((5, 5, 5))), 0.01)
    away = np.linalg.norm(spheres[:, :3] - found[0, :3], axis=1) - spheres[:, 3]
    assert min(away.min(), found[0, :3].min(), (5 - found[0, :3]).min()) == pytest.approx(found[0, 3])


def test_spheres_grow_to_the_largest_radius():
    walls = Walls(vg.Box((9, 9, 9)))
    found, normals = climbed(np.zeros((0, 4)), start(1.0, 2.0, 3.0, most=1.25), walls, 0.1)
    assert found[0, 3] == 1.25
    assert walls.depth(found[:, :3])[0] >= 1.25
    # around one that nothing holds the next places are along the axes
    rows = next_places(found, normals, walls, 1.25)
    assert len(rows) == 6
    assert np.linalg.norm(rows[:, :3] - found[0, :3], axis=1) == pytest.approx(1.3 * 1.25)
    assert climbed(np.zeros((0, 4)), start(1.0, 2.0, 3.0, most=1.25), walls, 1.3)[0][0, 3] == 0


def test_the_largest_are_taken_first():
    found = np.array([(1.0, 1, 1, 0.5), (1.9, 1, 1, 0.6), (1.5, 1, 1, 0.55), (3.0, 1, 1, 0.5), (8.7, 1, 1, 0.4)])
    chosen, again = taken(found, Walls(vg.Box((9, 9, 9), "x")), 1e-12)
    # 1 is the largest; 2 has its center inside 1; 0 overlaps 1 and climbs again; 3 touches 1 by a hair, 4 is apart
    assert chosen.tolist() == [1, 3, 4]
    assert again.tolist() == [0]
    wraps = np.array([(0.2, 1, 1, 0.6), (8.7, 1, 1, 0.4)])
    assert taken(wraps, Walls(vg.Box((9, 9, 9), "x")), 1e-12)[0].tolist() == [0]
    assert taken(wraps, Walls(vg.Box((9, 9, 9))), 1e-12)[0].tolist() == [0, 1]


def test_holes_larger_than_expected_are_found_between_round_walls():
    found, _ = climbed(np.zeros((0, 4)), start(2.0, 3.1, 3.2, hint=0.2), Walls(vg.Sphere(3.0)), 0.01)
    assert found[0] == pytest.approx([3, 3, 3, 3], abs=1e-6)


def test_cells_between_spheres():
    four = np.array([(1.0, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) / math.sqrt(2) + 4
    spheres, hole = np.column_stack([four, np.ones(4)]), math.sqrt(1.5) - 1
    walls = Walls(vg.Box((9, 9, 9)))
    rows = last_places(spheres, walls, 0.99 * hole, 5.0)
    assert rows[:, :3] == pytest.approx(np.full((1, 3), 4.0))
    assert rows[0, [HINT, MOST, KIND]].tolist() == [0.99 * hole, 5, REST]
    assert len(last_places(spheres, walls, 1.01 * hole, 5.0)) == 0
    # in one plane there are no cells, and one sphere has cells with its periodic images
    spheres[:, 2] = 1.0
    assert len(last_places(spheres, walls, 0.01, 5.0)) == 0
    one = np.array([(0.5, 0.5, 0.5, 0.9)])
    rows = last_places(one, Walls(vg.Box((2, 2, 2), "xyz")), 0.1, 5.0)
    found, _ = climbed(one, rows, Walls(vg.Box((2, 2, 2), "xyz")), 0.1)
    assert found[:, 3].max() == pytest.approx(math.sqrt(3) - 0.9)


# packings


def test_cells_of_exact_lattices():
    box = vg.Box((3 * CUBE,) * 3, "xyz")
    packing = vg.pack(SPHERE, box, "tetrahedral", edge=1.0, jitter=0.0, count=12 * 27)
    assert packing.solid_fraction == pytest.approx(CUBIC)
    rectangle = vg.Rectangle((6, 3 * math.sqrt(3)), "xy")
    packing = vg.pack(DISK, rectangle, "tetrahedral", edge=1.0, jitter=0.0, count=72)
    assert packing.solid_fraction == pytest.approx(TRIANGULAR)


@pytest.mark.parametrize(
    "container", [vg.Box((6, 6, 6)), slow(vg.Box((6, 6, 6), "xy")), vg.Cylinder(3, 6), slow(vg.Sphere(3.5))]
)
def test_what_is_full_has_no_hole(container):
    packing = vg.pack(SPHERE, container, "tetrahedral", edge=1.5, smallest=0.25, seed=3)
    assert packing.stop_reason == "full"
    assert vg.verify(packing, tolerance=1e-12).ok
    assert packing.diameters.min() >= 0.25 * (1 - 1e-12)
    lower, upper = container.bounds
    points = lower + random_of(6).random((20_000, 3)) * (upper - lower)
    depth = -container.signed_distance(points)
    image = np.array([(i, j, 0) for i in (-1, 0, 1) for j in (-1, 0, 1)]) * (upper - lower) * container.periodic
    centers = (packing.position[None] + np.unique(image, axis=0)[:, None]).reshape(-1, 3)
    radii = np.tile(packing.diameters / 2, len(np.unique(image, axis=0)))
    away, near = cKDTree(centers).query(points, k=30)
    room = np.minimum((away - radii[near]).min(axis=1), depth)
    assert room.max() < 0.125
    walls, spheres = Walls(container), np.column_stack([packing.position - lower, packing.diameters / 2])
    left, _ = climbed(spheres, last_places(spheres, walls, 0.125, np.inf), walls, 0.125)
    assert left[:, 3].max() == 0
    assert packing.solid_fraction > 0.6


def test_spheres_touch():
    packing = vg.pack(
        SPHERE, vg.ClosedMesh(vg.Shape.from_mesh(*vg.Box((6, 6, 6)).mesh())), "tetrahedral", edge=1.5, seed=3
    )
    assert vg.verify(packing, tolerance=1e-12).ok
    contacts = packing.contacts(1e-9)
    # each sphere of a hole brings four contacts, some with walls; each of a cell touches spheres at its node
    assert 2 * len(contacts.i) / packing.count > 4
    assert packing.solid_fraction > 0.55


def test_polygons_and_narrow_containers():
    region = vg.Polygon([(0, 0), (6, 0), (6, 4), (3, 2.5), (0, 4)], holes=[[(2, 1), (3, 1), (3, 2), (2, 2)]])
    packing = vg.pack(DISK, region, "tetrahedral", edge=0.3)
    assert vg.verify(packing, tolerance=1e-12).ok
    assert packing.solid_fraction > 0.8
    # no sphere is wider than the period, and a layer of spheres is no reason to fail
    narrow = vg.pack(SPHERE, vg.Box((0.5, 4, 4), "x"), "tetrahedral", edge=2)
    assert narrow.diameters.max() <= 0.5
    assert vg.verify(narrow).ok
    layer = vg.pack(SPHERE, vg.Box((4, 4, 0.5)), "tetrahedral", edge=1, smallest=0.5)
    assert layer.diameters == pytest.approx(0.5)
    assert vg.verify(layer).ok


def test_diameters_stay_within_limits():
    packing = vg.pack(SPHERE, vg.Box((6, 6, 6)), "tetrahedral", smallest=0.5, largest=0.9)
    assert packing.diameters.min() >= 0.5 * (1 - 1e-12)
    assert packing.diameters.max() == pytest.approx(0.9)
    assert packing.solid_fraction > 0.5
    # the edge follows from the sphere in a regular tetrahedron, sqrt(1/6) of its edge wide
    assert packing.provenance["parameters"]["edge"] == pytest.approx(0.9 * math.sqrt(6))
    plain = vg.pack(SPHERE, vg.Box((6, 6, 6)), "tetrahedral", edge=1.5, count=20)
    assert plain.provenance["parameters"]["smallest"] == pytest.approx(0.3)


def test_targets():
    box = vg.Box((6, 6, 6))
    half = vg.pack(SPHERE, box, "tetrahedral", solid_fraction=0.5, edge=1.5)
    assert half.solid_fraction == pytest.approx(0.5, abs=1e-12)
    assert (half.stop_reason, half.provenance["missed"]["solid_fraction"]) == ("solid_fraction", 0)
    assert vg.verify(half).ok
    many = vg.pack(SPHERE, box, "tetrahedral", count=1000)
    assert (many.count, many.stop_reason) == (1000, "count")
    assert many.solid_fraction > 0.55
    both = vg.pack(SPHERE, box, "tetrahedral", count=1000, solid_fraction=0.2)
    assert both.count < 1000
    assert both.solid_fraction == pytest.approx(0.2, abs=1e-12)
    with pytest.warns(PackingWarning, match=r"the solid fraction is 0\.\d+ instead of 0\.9 where .* \(full\)"):
        vg.pack(SPHERE, box, "tetrahedral", solid_fraction=0.9, edge=3)


def test_a_solid_fraction_beside_a_start():
    """It is that of the further grains, of the true volume of their shapes."""
    box, cube = vg.Box((6, 6, 6)), vg.make_shape("box", lengths=(1, 1, 1))
    first = vg.Packing.of([SPHERE], box, position=[(1.5, 1.5, 1.5), (4, 4, 4)], scale=[2, 1])
    packing = vg.pack(cube, box, "tetrahedral", start=first, solid_fraction=0.1)
    assert packing.position[:2].tolist() == first.position.tolist()
    assert packing.diameters[:2].tolist() == first.diameters.tolist()
    assert packing.volumes[2:].sum() / box.volume == pytest.approx(0.1, abs=1e-12)
    assert vg.verify(packing).ok


def test_a_scaled_scene_gives_the_same():
    one = vg.pack(SPHERE, vg.Cylinder(2, 4), "tetrahedral", edge=1, seed=2)
    two = vg.pack(SPHERE, vg.Cylinder(2e-3, 4e-3), "tetrahedral", edge=1e-3, seed=2)
    assert two.position == pytest.approx(1e-3 * one.position, abs=1e-12)


# meshes from files


def kuhn(path, kind="tetra"):
    """Write a cube as six tetrahedra around a diagonal, or a square as two triangles."""
    points = np.indices((2, 2, 2)).reshape(3, -1).T.astype(float)
    cells = [(0, a, 7 - b, 7) for a in (1, 2, 4) for b in (1, 2, 4) if a != b]
    if kind == "triangle":
        cells = [(0, 2, 6), (0, 4, 6)]
    meshio.Mesh(points, [(kind, np.array(cells))]).write(path)
    return str(path)


@pytest.mark.parametrize("suffix", ["vtu", slow("msh"), slow("inp")])
def test_a_mesh_of_a_file(tmp_path, suffix):
    path = kuhn(tmp_path / f"cube.{suffix}")
    packing = vg.pack(SPHERE, vg.Box((1, 1, 1)), "tetrahedral", mesh=path, count=6)
    # three times the volume over the area of the sides
    assert packing.diameters == pytest.approx(1 / (1 + math.sqrt(2)))
    assert vg.verify(packing).ok
    denser = vg.pack(SPHERE, vg.Box((1, 1, 1)), "tetrahedral", mesh=path, edge=0.5)
    assert denser.solid_fraction > packing.solid_fraction
    assert vg.verify(denser).ok


def test_triangles_of_a_file(tmp_path):
    path = kuhn(tmp_path / "square.vtu", "triangle")
    packing = vg.pack(DISK, vg.Rectangle((1, 1)), "tetrahedral", mesh=path, count=2)
    assert packing.diameters == pytest.approx(2 - math.sqrt(2))
    with pytest.raises(FileFormatError, match="holds no tetra cells"):
        vg.pack(SPHERE, vg.Box((1, 1, 1)), "tetrahedral", mesh=path, count=2)


def test_files_that_are_no_mesh(tmp_path):
    with pytest.raises(MissingFileError):
        vg.pack(SPHERE, vg.Box((1, 1, 1)), "tetrahedral", mesh=str(tmp_path / "none.vtu"), count=2)
    (tmp_path / "bad.vtu").write_text("<VTKFile>")
    with pytest.raises(FileFormatError, match="cannot be read"):
        vg.pack(SPHERE, vg.Box((1, 1, 1)), "tetrahedral", mesh=str(tmp_path / "bad.vtu"), count=2)


# what is refused


def test_what_is_refused():
    box = vg.Box((6, 6, 6))
    with pytest.raises(InputError, match="sizes is given: the method makes the sizes"):
        vg.pack(SPHERE, box, "tetrahedral", sizes=vg.sizes.lognormal(1, 0.2), count=5)
    with pytest.raises(InputError, match="smallest is 2 and largest is 1"):
        vg.pack(SPHERE, box, "tetrahedral", smallest=2, largest=1)
    with pytest.raises(InputError, match=r"edge is 20: no cell is longer than the container of 6"):
        vg.pack(SPHERE, box, "tetrahedral", edge=20)
    first = vg.Packing.of([SPHERE], box, position=[(1, 1, 1), (1.5, 1, 1)])
    with pytest.raises(InputError, match="grain 1 of start"):
        vg.pack(SPHERE, box, "tetrahedral", start=first, count=3)


# thin containers


def tilted(lengths):
    """Return a thin box with walls along no axis, as a closed mesh."""
    vertices, faces = vg.Box(lengths).mesh()
    turn = np.linalg.qr(random_of(8).normal(size=(3, 3)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    return vg.ClosedMesh(vg.Shape.from_mesh(vertices @ turn.T, faces))


def shell(thick):
    """Return the room between two spheres, the outer one of radius 1, as a closed mesh."""
    sphere = vg.make_shape("sphere", diameter=2)
    inner = sphere.faces[:, ::-1] + len(sphere.vertices)
    vertices = np.vstack([sphere.vertices, (1 - thick) * sphere.vertices])
    return vg.ClosedMesh(vg.Shape.from_mesh(vertices, np.vstack([sphere.faces, inner])))


def test_thicknesses():
    assert thickness(vg.Box((1e4, 1e4, 0.1))) == pytest.approx(0.1, rel=1e-4)
    assert thickness(vg.Cylinder(0.5, 1e4)) == pytest.approx(0.5, rel=0.02)
    assert thickness(vg.Sphere(3)) == pytest.approx(2, rel=0.02)
    assert thickness(shell(0.02)) == pytest.approx(0.02, rel=0.01)
    assert thickness(vg.Rectangle((1e4, 0.1))) == pytest.approx(0.1, rel=1e-4)
    assert thickness(vg.Disk(3)) == pytest.approx(3, rel=0.01)
    frame = vg.Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], holes=[[(1, 1), (8, 1), (8, 8), (1, 8)]])
    assert thickness(frame) == pytest.approx(1)


@pytest.mark.parametrize(
    ("container", "least"),
    [
        slow(vg.Box((5, 5, 0.2)), 0.55),
        slow(vg.Box((2, 2, 0.2), "xyz"), 0.6),
        (vg.Box((0.1, 0.1, 5)), 0.6),
        slow(vg.Cylinder(0.05, 3), 0.6),
        slow(vg.Cylinder(2, 0.15), 0.55),
        slow(shell(0.2), 0.55),
        slow(tilted((3, 3, 0.2)), 0.6),
        slow(tilted((0.05, 0.05, 4)), 0.6),
        (vg.Rectangle((20, 0.02)), 0.74),
        (vg.Polygon([(0, 0), (10, 7), (10, 7.01), (0, 0.01)]), 0.75),
    ],
)
def test_thin_containers_are_filled_by_default(container, least):
    packing = vg.pack(DISK if container.dimension == 2 else SPHERE, container, "tetrahedral")
    assert packing.stop_reason == "full"
    assert packing.solid_fraction > least
    assert packing.count < 60_000
    assert vg.verify(packing, tolerance=1e-9).ok


@pytest.mark.parametrize("count", [50, 4000])
def test_counts_in_thin_containers_are_spread(count):
    packing = vg.pack(SPHERE, vg.Box((20, 20, 0.1)), "tetrahedral", count=count)
    assert packing.count == count
    # a uniform density has a standard deviation of the length over the root of 12
    assert packing.position[:, :2].std(axis=0) == pytest.approx(20 / math.sqrt(12), rel=0.15)


@pytest.mark.slow
def test_the_thinnest_containers_take_no_minutes():
    """Neither the lattice of the mesh nor the spheres are many."""
    for container in (vg.Box((20, 20, 1e-3)), tilted((1e-3, 1e-3, 10)), vg.Rectangle((1e4, 1e-3))):
        shape = DISK if container.dimension == 2 else SPHERE
        packing = vg.pack(shape, container, "tetrahedral", count=300)
        limits = packing.provenance["parameters"]
        assert lattice_points(container, limits["edge"]) <= 2e5
        assert packing.count == 300
        # the distance from triangles that are 10,000 times as long as they are wide is exact to a few 1e-9
        assert vg.verify(packing, tolerance=1e-8).ok
    # of these the default would make many more
    problem = task_of("tetrahedral", SPHERE, vg.Box((200, 200, 0.2))).problem
    assert tetrahedral.cost(problem).memory > 200_000 * 1000


def test_wide_limits_do_not_count_in_thin_containers():
    box = vg.Box((3, 3, 0.3))
    wide, plain = vg.pack(SPHERE, box, "tetrahedral", largest=30), vg.pack(SPHERE, box, "tetrahedral", edge=3)
    assert wide.count == pytest.approx(plain.count, rel=0.1)
    assert wide.solid_fraction == pytest.approx(plain.solid_fraction, rel=0.02)


def test_tiles_have_the_cells_of_the_whole():
    points = random_of(9).random((3000, 3)) * [60, 60, 1.5]
    whole = np.sort(triangulated(points, 3), axis=1)
    tiles = np.sort(triangulated_by_tiles(points, 3, 12.0, 4.0), axis=1)
    whole, tiles = set(map(tuple, whole.tolist())), set(map(tuple, tiles.tolist()))
    # those at the faces of the hull have large circumspheres, which reach beyond a tile
    assert len(whole & tiles) > 0.96 * len(whole)
    assert len(tiles - whole) < 0.04 * len(whole)


@pytest.mark.slow
def test_running_sums_decide_whether_a_fraction_is_met():
    """Of many thousand spheres another order of summation gives another rounding, which once ended in an error."""
    packing = vg.pack(SPHERE, vg.Box((20, 20, 0.1)), "tetrahedral", solid_fraction=0.4)
    assert packing.stop_reason == "solid_fraction"
    assert packing.solid_fraction == pytest.approx(0.4, abs=1e-5)
