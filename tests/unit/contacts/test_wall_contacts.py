"""Contacts with walls: gaps are those of the exact tests, and grains stand on as many points as hold them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.contacts.assembly import Assembly, Lid
from voxgran.contacts.manifolds.pair_list import no_pairs
from voxgran.contacts.manifolds.rows import ROW, WALL, ContactRows, Grains, Search
from voxgran.contacts.manifolds.smooth_distance import smooth_distance
from voxgran.contacts.manifolds.wall_bodies import ELLIPSOID, SMOOTH, wall_bodies
from voxgran.contacts.manifolds.wall_bodies import Lid as LidPlane
from voxgran.contacts.manifolds.wall_contacts import find_wall_contacts
from voxgran.contacts.walls import escape_depths
from voxgran.containers.kernel_container import kernel_container
from voxgran.geometry.rotation import normalized, product
from voxgran.shapes.mesh import Mesh, hull_of
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

NO_LID = LidPlane(np.array([0.0, 0.0, 1.0]), math.inf)


def grains_of(assembly):
    """Return the grains of an assembly as kernels take them."""
    n = assembly.count
    return Grains(
        *(assembly.position.copy(), assembly.matrices.copy(), assembly.scale.copy(), assembly.bounding_radii.copy()),
        *(np.array(assembly.shape_id, dtype=np.int64), np.zeros(n, dtype=np.int64), np.zeros(n)),
    )


def empty_rows(many):
    """Return rows without content."""
    return ContactRows(
        np.zeros((many, ROW)), np.zeros(many, dtype=np.int64), np.zeros(many, dtype=np.int64), np.zeros((many, ROW))
    )


class Found:
    """The contacts of an assembly with walls and lid."""

    def __init__(self, assembly, margin, *, rest=0.0, lid=NO_LID, room=20_000, start=0):
        self.assembly, self.rows = assembly, empty_rows(room)
        self.first, self.count = np.zeros((2, assembly.count), dtype=np.int64)
        self.grains, self.walls = grains_of(assembly), (kernel_container(assembly.container), lid)
        self.bodies = wall_bodies(assembly.shapes, assembly.container)
        self.margin, self.rest = margin, rest
        self.m = self.find(start)

    def find(self, start=0):
        """Find the contacts again; return the row after the last."""
        search = Search(self.grains, no_pairs(), self.margin, self.rest)
        self.m = find_wall_contacts(search, *self.walls, self.bodies, (self.first, self.count), self.rows, start)
        return self.m

    def of(self, grain):
        """Return the rows of a grain."""
        first = self.first[grain]
        return self.rows.row[first : first + self.count[grain]]

    def least(self):
        """Return the smallest gap of each grain, infinite where it has no contact."""
        return np.array([self.of(k)[:, 9].min(initial=math.inf) for k in range(self.assembly.count)])


def random_poses(shapes, container, many, seed=0, *, low=0.4, high=1.3):
    """Return grains anywhere in the bounds of a container, many of them near walls or through them."""
    generator = np.random.Generator(np.random.Philox(seed))
    lower, upper = container.bounds
    position = lower + (upper - lower) * generator.random((many, 3))
    if container.kind in ("hopper", "walls"):
        # outside, a rim about the axis is nearest to a cone all around
        position = np.resize(position[container.signed_distance(position) < 0], (many, 3))
    turn = normalized(generator.normal(size=(many, 4)))
    if container.dimension == 2:
        position[:, 2] = 0.0
        turn[:, 1:3] = 0.0
        turn = normalized(turn)
    scale = low + (high - low) * generator.random(many)
    shape = generator.integers(0, len(shapes), many)
    return Assembly(tuple(shapes), shape, scale, position, turn, container)


def hull_shape(points):
    """Return the convex hull of points, of which some lie inside."""
    corners = points[np.sort(ConvexHull(points).vertices)]
    return Shape.of(hull_of(corners), name="hull")


def clump():
    """Return a union of three spheres."""
    return Shape.of(
        Spheres(np.array([[0, 0, 0], [0.5, 0.1, 0], [0.1, 0.4, 0.3]]), np.array([0.4, 0.3, 0.25])), name="c"
    )


def solids():
    """Return shapes of all kinds in space."""
    generator = np.random.Generator(np.random.Philox(3))
    return [
        vg.make_shape("sphere"),
        clump(),
        vg.make_shape("ellipsoid", semi_axes=(0.8, 0.5, 0.3)),
        vg.make_shape("ellipsoid", semi_axes=(0.5, 0.5, 0.2)),
        vg.make_shape("box", lengths=(1.2, 0.7, 0.5)),
        vg.make_shape("cylinder", radius=0.4, height=1.1),
        vg.make_shape("cone", radius=0.5, height=1.0),
        vg.make_shape("spherocylinder", radius=0.3, height=1.4),
        hull_shape(generator.normal(size=(20, 3)) / 2.5),
    ]


CONTAINERS = {
    "box": vg.Box((4.0, 5.0, 6.0), origin=(1.0, -2.0, 0.5)),
    "periodic": vg.Box((4.0, 5.0, 6.0), periodic=(True, True, False)),
    "cylinder": vg.Cylinder(2.5, 5.0, origin=(1.0, 2.0, -1.0)),
    "sphere": vg.Sphere(2.5, origin=(1.0, 2.0, -1.0)),
    "hopper": vg.Hopper(3.5, 0.8, 55.0),
    "drum": vg.Drum(2.5, 5.0, "y", origin=(1.0, 2.0, -1.0)),
    "walls": vg.Walls(
        [
            {"kind": "cylinder", "radius": 2.5, "axis": (1, 0, 2), "point": (0.5, 0, 0)},
            {"kind": "cone", "radius": 3, "angle": 40, "axis": (0.3, 0, 1), "point": (0, 0, 0.5)},
            {"kind": "plane", "normal": (0.2, -0.1, 1), "point": (0, 0, 3)},
            {"kind": "sphere", "radius": 3.5, "point": (0, 0.5, 0)},
        ]
    ),
}


def test_contacts_with_a_mesh_do_not_depend_on_the_reach():
    """Walls are found at the rims of cones and cylinders, between the points that stand for them."""
    box = vg.make_shape("box", lengths=(4, 5, 6))
    assembly = random_poses(solids(), vg.ClosedMesh(vg.Shape.from_mesh(box.vertices, box.faces)), 2000)
    least = Found(assembly, 0.05).least()
    near = Found(assembly, 1e-3).least()
    shallow = (least > -0.02) & (least <= 1e-3)
    assert shallow.sum() > 30
    np.testing.assert_allclose(near[shallow], least[shallow], atol=1e-12)
    assert np.isinf(near[least > 1e-3]).all()


@pytest.mark.parametrize("name", CONTAINERS)
def test_the_smallest_gap_is_that_of_the_exact_test(name):
    """Of 400 grains of nine kinds, inside and through the walls, also with a lid."""
    assembly = random_poses(solids(), CONTAINERS[name], 400)
    found = Found(assembly, 100.0)
    np.testing.assert_allclose(found.least(), -escape_depths(assembly), atol=1e-9)
    level = float(np.median(assembly.position[:, 2]))
    lidded = replace(assembly, lid=Lid(np.array([0.0, 0.0, 1.0]), level))
    with_lid = Found(lidded, 100.0, lid=LidPlane(np.array([0.0, 0.0, 1.0]), level))
    np.testing.assert_allclose(with_lid.least(), -escape_depths(lidded), atol=1e-9)


@pytest.mark.parametrize("name", ["cylinder", "hopper"])
def test_small_disks_that_lie_against_a_round_wall_touch_it_with_two_points_of_the_rim(name):
    """Their ends are within a few degrees of the wall, whose curvature parts the two points by little."""
    container = CONTAINERS[name]
    wall, many = container.boundary.round[0], 60
    generator = np.random.Generator(np.random.Philox(7))
    turn = generator.uniform(0, 2 * math.pi, many)
    normal = np.stack([wall.cosine * np.cos(turn), wall.cosine * np.sin(turn), np.full(many, wall.sine)], axis=1)
    position = np.array([*wall.center[:2], container.bounds[:, 2].mean()]) + 0.0 * normal
    position += normal * (wall.distance(position) - 0.15)[:, None]
    leaning = normal + 0.02 * generator.normal(size=(many, 3))
    orientation = normalized(np.column_stack([1 + leaning[:, 2], -leaning[:, 1], leaning[:, 0], np.zeros(many)]))
    disk = vg.make_shape("cylinder", radius=0.2, height=0.2)
    ones = np.zeros(many, dtype=np.int64), np.ones(many)
    assembly = Assembly((disk,), *ones, position, orientation, container)
    found = Found(assembly, 0.3)
    np.testing.assert_allclose(found.least(), -escape_depths(assembly), atol=1e-12)
    angle = 2 * math.pi * np.arange(20_000) / 20_000
    ring = 0.2 * np.column_stack([np.cos(angle), np.sin(angle), np.full(len(angle), 0.5)])
    dense = [
        wall.distance(ring @ turned.T + place).min() for turned, place in zip(assembly.matrices, position, strict=True)
    ]
    np.testing.assert_allclose(found.least(), dense, atol=1e-7)


@pytest.mark.parametrize("name", CONTAINERS)
def test_rows_hold_points_of_the_wall(name):
    """A gap along the normal from the arm's end there is a point of the wall, or of its plane."""
    found = Found(random_poses(solids(), CONTAINERS[name], 200, seed=1), 0.3)
    row, grain = found.rows.row[: found.m], found.rows.i[: found.m]
    assert found.m > 100
    assert (found.rows.j[: found.m] == WALL).all()
    assert (row[:, 9] <= 0.3).all()
    np.testing.assert_allclose(np.linalg.norm(row[:, :3], axis=1), 1.0)
    assert not row[:, 6:9].any()
    inside = row[:, 9] > 0
    points = found.assembly.position[grain] + row[:, 3:6] + row[:, 9:10] * row[:, :3]
    distance = found.assembly.container.signed_distance(points[inside])
    # it may lie beyond another wall
    assert (distance > -1e-9).all()
    assert np.mean(np.abs(distance) < 1e-9) > 0.55


def placed(shape, container, position, orientation=(1.0, 0.0, 0.0, 0.0), scale=1.0):
    """Return one grain in a container."""
    turn = np.array([orientation]) / np.linalg.norm(orientation)
    return Assembly((shape,), np.zeros(1, dtype=np.int64), np.array([scale]), np.array([position]), turn, container)


def base_of(rows):
    """Return the horizontal places of contacts with a floor."""
    floor = rows[rows[:, 2] < -0.99]
    return floor[:, 3:5]


def test_grains_stand_on_their_bases():
    box = vg.Box((10.0, 10.0, 10.0))
    cube = Found(placed(vg.make_shape("box", lengths=(1.0, 1.0, 1.0)), box, (5.0, 5.0, 0.501)), 0.05, rest=1e-3)
    rows = cube.of(0)
    assert sorted(map(tuple, np.round(base_of(rows), 12))) == [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)]
    np.testing.assert_allclose(rows[:, 9], 0.0, atol=1e-12)
    for shape, height in (
        (vg.make_shape("cylinder", radius=0.5, height=1.0), 0.5),
        (vg.make_shape("cone", radius=0.5, height=1.0), 0.25),
    ):
        rows = Found(placed(shape, box, (5.0, 5.0, height + 1e-3)), 0.05).of(0)
        assert 3 <= len(rows) <= 8
        np.testing.assert_allclose(rows[:, 9], 1e-3, atol=1e-12)
        angle = np.sort(np.arctan2(*base_of(rows).T))
        assert np.diff(angle, append=angle[0] + 2 * math.pi).max() < 0.6 * math.pi


def test_a_cylinder_lies_on_two_rims():
    turn = (math.cos(math.pi / 4), math.sin(math.pi / 4), 0.0, 0.0)
    lying = placed(vg.make_shape("cylinder", radius=0.5, height=1.0), vg.Box((10.0,) * 3), (5.0, 5.0, 0.51), turn)
    rows = Found(lying, 0.02).of(0)
    assert np.ptp(rows[:, 4]) == pytest.approx(1.0)
    np.testing.assert_allclose(rows[:, 9].min(), 0.01, atol=1e-12)


def test_of_a_fine_base_the_contacts_are_spread():
    """Of 200 corners of a prism 8 are kept, which hold it on all sides."""
    angle = 2 * math.pi * np.arange(200) / 200
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    prism = hull_shape(np.concatenate([np.column_stack([ring, np.full(200, h)]) for h in (0.0, 1.0)]))
    rows = Found(placed(prism, vg.Box((10.0,) * 3), (5.0, 5.0, 0.501)), 0.05).of(0)
    assert len(rows) == 8
    angle = np.sort(np.arctan2(*base_of(rows).T))
    assert np.diff(angle, append=angle[0] + 2 * math.pi).max() < 0.4 * math.pi


def test_a_stick_touches_a_round_wall_at_both_ends():
    stick = vg.make_shape("ellipsoid", semi_axes=(2.4, 0.2, 0.2))
    rows = Found(placed(stick, vg.Cylinder(2.5, 10.0), (0.0, 0.0, 5.0)), 0.2).of(0)
    np.testing.assert_allclose(np.sort(rows[:, 0]), [-1.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(rows[:, 9], 0.1, atol=1e-9)


def mesh_container(points, faces=None):
    """Return the convex hull of points, or a mesh, as a container that keeps its place."""
    shape = hull_shape(points) if faces is None else vg.Shape.from_mesh(points, faces)
    return vg.ClosedMesh(shape)


def mesh_box(lengths):
    """Return a box of triangles as a container, with one corner at the origin."""
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)
    return mesh_container(corners * lengths)


def test_a_mesh_of_a_box_is_a_box():
    """Each wall near a grain counts, with the same smallest gap as in the box itself."""
    lengths = (4.0, 5.0, 6.0)
    assembly = random_poses(solids(), vg.Box(lengths), 250, seed=5, low=0.3, high=0.8)
    inside = escape_depths(assembly) < 0
    chosen = [getattr(assembly, key)[inside] for key in ("shape_id", "scale", "position", "orientation")]
    kept = Assembly(assembly.shapes, *chosen, vg.Box(lengths))
    flat = Found(kept, 0.15)
    mesh = Found(Assembly(kept.shapes, *chosen, mesh_box(lengths)), 0.15)
    assert np.isfinite(flat.least()).sum() > 20
    np.testing.assert_allclose(mesh.least(), flat.least(), atol=1e-9)
    for k in range(kept.count):
        sides = [{tuple(np.round(row[:3]).astype(int)) for row in found.of(k)} for found in (flat, mesh)]
        assert sides[0] == sides[1]


def step_container():
    """Return a room with a step: its edge, along y at x = 2, z = 1, protrudes into the room."""
    profile = np.array([[0, 1], [2, 1], [2, 0], [6, 0], [6, 5], [0, 5]], dtype=float)
    n = len(profile)
    points = np.concatenate([np.column_stack([profile[:, 0], np.full(n, y), profile[:, 1]]) for y in (0.0, 4.0)])
    sides = [f for k in range(n) for f in ((k, (k + 1) % n, n + k), ((k + 1) % n, n + (k + 1) % n, n + k))]
    caps = [(0, 1, 5), (1, 4, 5), (1, 2, 4), (2, 3, 4)]
    ends = [face for a, b, c in caps for face in ((a, c, b), (n + a, n + b, n + c))]
    faces = np.array([*sides, *ends])
    a, b, c = np.moveaxis(points[faces], 1, 0)
    if np.einsum("fi,fi->", a, np.cross(b, c)) < 0:
        faces = faces[:, ::-1]
    return mesh_container(points, faces)


@pytest.mark.parametrize("depth", [0.01, -0.03])
@pytest.mark.parametrize("kind", ["box", "ellipsoid", "cylinder", "sphere", "spherocylinder"])
def test_an_edge_of_the_wall_touches_faces_of_grains(kind, depth):
    """A grain over a step has its contact at the edge, between its corners."""
    kinds = {
        "box": (vg.make_shape("box", lengths=(2.0, 2.0, 0.5)), 0.25),
        "cylinder": (vg.make_shape("cylinder", radius=0.4, height=2.0), 1.0),
        "ellipsoid": (vg.make_shape("ellipsoid", semi_axes=(0.4, 0.5, 0.8)), 0.8),
        "sphere": (vg.make_shape("sphere"), 0.5),
        "spherocylinder": (vg.make_shape("spherocylinder", radius=0.4, height=1.6), 0.8),
    }
    shape, half = kinds[kind]
    # its axis halves the angle of the edge
    normal = np.array([-1.0, 0.0, -1.0]) / math.sqrt(2)
    turn = (math.cos(math.pi / 8), 0.0, math.sin(math.pi / 8), 0.0)
    place = np.array([2.0, 2.0, 1.0]) - (half + depth) * normal
    rows = Found(placed(shape, step_container(), place, turn), 0.2).of(0)
    k = rows[:, 9].argmin()
    tolerance = 1e-6
    assert rows[k, 9] == pytest.approx(depth, abs=tolerance)
    np.testing.assert_allclose(rows[k, :3], normal, atol=1e-3)
    least = rows[rows[:, 9] < depth + tolerance]
    np.testing.assert_allclose(least[:, 3:6] @ normal, half, atol=5 * tolerance)
    width = {"box": 2.0, "cylinder": 0.8}.get(kind, 0.0)
    # deep in a cylinder the mantle is nearer than the end
    assert (0.7 if kind == "cylinder" else 0.8) * width <= np.ptp(least[:, 4]) <= width + 1e-3


def test_spheres_in_a_mesh_are_exact():
    assembly = random_poses([vg.make_shape("sphere")], step_container(), 300, seed=7, low=0.2, high=0.7)
    depth = escape_depths(assembly)
    inside = depth < 0.1
    np.testing.assert_allclose(Found(assembly, 10.0).least()[inside], -depth[inside], atol=1e-9)


def test_meshes_in_a_mesh_touch_where_their_surfaces_are_nearest():
    """Against the distance of the surfaces, of grains that lie wholly inside."""
    shapes = [vg.make_shape("box", lengths=(1.2, 0.7, 0.5)), solids()[-1]]
    assembly = random_poses(shapes, step_container(), 150, seed=8, low=0.4, high=0.8)
    depth = escape_depths(assembly)
    least = Found(assembly, 0.5).least()
    near = (depth < 0) & (depth > -0.5)
    assert near.sum() > 30
    np.testing.assert_allclose(least[near], -depth[near], atol=1e-6)
    assert (least[depth > 1e-3] < 0).all()
    assert np.isinf(least[depth < -0.5]).all()


def test_round_solids_in_a_mesh_touch_where_they_are_nearest():
    """Against the distance of the nearest of many points of the surfaces."""
    shapes = [solids()[k] for k in (2, 3, 5, 6, 7)]
    container = step_container()
    assembly = random_poses(shapes, container, 60, seed=9, low=0.4, high=0.8)
    least = Found(assembly, 0.3).least()
    edge = np.column_stack([np.full(401, 2.0), np.linspace(0.0, 4.0, 401), np.ones(401)])
    near = 0
    for k in range(assembly.count):
        shape, scale = shapes[assembly.shape_id[k]], assembly.scale[k]
        gap = -container.signed_distance(assembly.world_vertices(k)).max()
        body = (edge - assembly.position[k]) @ assembly.matrices[k] / scale
        surface = Shape(Mesh(shape.vertices.copy(), shape.faces.copy())).geometry.tree
        gap = min(gap, surface.signed_distance(body).min() * scale)
        if 0 < gap < 0.28:
            near += 1
            # tessellations are inscribed: the true gap is smaller by their error
            assert gap - 0.012 < least[k] < gap + 1e-9
    assert near > 10


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
def test_signed_distances_of_smooth_solids(kind):
    """The nearest point is on the solid, the way to it is along its normal, and no tessellation is nearer."""
    size = np.array([0.8, 0.5, 0.3]) if kind == ELLIPSOID else np.array([0.5, 1.2, 0.0])
    names = {number: name for name, number in SMOOTH.items()}
    solid = Primitive(names[kind], tuple(size[size > 0]))
    vertices, faces, error = solid.tessellation()
    points = np.random.Generator(np.random.Philox(2)).normal(size=(300, 3)) * 0.6
    expected = Mesh(vertices, faces).tree.signed_distance(points)
    for point, other in zip(points, expected, strict=True):
        distance, *rest = smooth_distance(kind, size, *point)
        nearest, normal = np.array(rest[:3]), np.array(rest[3:])
        np.testing.assert_allclose(nearest + distance * normal, point, atol=1e-9)
        assert distance == pytest.approx(other, abs=error + 1e-12)
        assert (distance < 0) == solid.contains(point[None])[0]


def test_gaps_do_not_depend_on_the_orientation_of_the_scene():
    """A cylinder container turned about its axis, with its grains, has the same gaps."""
    container = vg.Cylinder(2.5, 5.0)
    assembly = random_poses(solids(), container, 200, seed=11)
    angle = 0.7
    turn = np.array([math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)])
    matrix = np.array(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1.0]]
    )  # fmt: skip
    turned = Assembly(
        assembly.shapes, assembly.shape_id, assembly.scale, assembly.position @ matrix.T,
        np.array([product(turn, q) for q in assembly.orientation]), container,
    )  # fmt: skip
    one, other = Found(assembly, 0.5), Found(turned, 0.5)
    np.testing.assert_array_equal(one.count, other.count)
    np.testing.assert_allclose(one.least(), other.least(), atol=1e-9)


def test_full_rows_lose_nothing():
    assembly = random_poses(solids(), CONTAINERS["box"], 100, seed=2)
    found = Found(assembly, 0.5)
    generator = np.random.Generator(np.random.Philox(1))
    found.rows.row[: found.m, 10:14] = generator.random((found.m, 4))
    found.rows.old[:] = found.rows.row
    m, before = found.m, (found.first.copy(), found.count.copy())
    short = ContactRows(*(array[: m // 2].copy() for array in found.rows[:3]), found.rows.old)
    long, found.rows = found.rows, short
    assert found.find() == -1
    np.testing.assert_array_equal(found.first, before[0])
    np.testing.assert_array_equal(found.count, before[1])
    found.rows = long
    # as the bed does where it makes room: no old row is taken
    long.old[:, 14] = 0.0
    assert found.find() == m
    np.testing.assert_array_equal(long.row[:m, :14], long.old[:m, :14])


def test_impulses_stay_with_their_wall():
    """A corner in an edge of the box touches two walls with one arm; each contact keeps its own impulse."""
    cube = placed(vg.make_shape("box", lengths=(1.0, 1.0, 1.0)), vg.Box((10.0,) * 3), (0.501, 5.0, 0.501))
    found = Found(cube, 0.05)
    found.rows.row[: found.m, 10] = 1.0 + np.arange(found.m)
    found.rows.old[:] = found.rows.row
    assert found.find() == 8
    np.testing.assert_array_equal(found.rows.row[:8, 10], 1.0 + np.arange(8))


def test_outlines_touch_the_walls_of_a_rectangle():
    shapes = [
        vg.make_shape("disk"),
        Shape.of(Outline("polygon", vertices=np.array([[0, 0], [2, 0], [2, 1], [1, 0.4], [0, 1]])), name="notched"),
    ]
    for periodic in ((False, False), (True, False)):
        assembly = random_poses(shapes, vg.Rectangle((6.0, 5.0), periodic=periodic), 100, seed=4)
        found = Found(assembly, 100.0)
        np.testing.assert_allclose(found.least(), -escape_depths(assembly), atol=1e-9)
        assert not found.rows.row[: found.m, [2, 5]].any()


def test_a_container_without_closed_form_is_refused():
    class Room:
        kind, dimension, periodic = "room", 3, (False, False, False)

    with pytest.raises(InputError, match="closed form"):
        wall_bodies((vg.make_shape("sphere"),), Room())
