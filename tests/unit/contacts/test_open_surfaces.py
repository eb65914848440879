"""Gaps and depths of open surfaces against plain NumPy, closed forms and the collision filter of VTK."""

import math

import numpy as np
import pytest
import pyvista

import voxgran as vg
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.find import find_contacts
from voxgran.contacts.walls import escape_depths
from voxgran.geometry.rotation import random_rotations
from voxgran.shapes.families.surfaces.sheet import lattice_faces
from voxgran.shapes.spheres import Spheres

TURN = [math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0]  # a quarter about y
ROOM = vg.Box((20, 20, 20))
FLAT = vg.make_shape("sheet", lengths=(2.0, 2.0))
SHAPES = [
    vg.make_shape("sheet", lengths=(1.2, 0.9), roll=120),
    vg.make_shape("shell", opening=60),
    vg.make_shape("random_surface", seed=5, max_frequency=0.75),
]


def pair(one, other, way, turn=None, container=ROOM):
    """Return two grains, the second one shifted by a way and turned."""
    orientation = [[1, 0, 0, 0], turn or [1, 0, 0, 0]]
    place = np.array(container.bounds).mean(axis=0)
    return Assembly.of([one, other], container, position=[place, place + way], shape_id=[0, 1], orientation=orientation)


def gap_of(one, other, way, turn=None, reach=5.0):
    found = find_contacts(pair(one, other, way, turn), reach)
    back = find_contacts(pair(other, one, -np.array(way), turn=None), reach) if turn is None else found
    assert len(found.gap) == 1
    assert back.gap[0] == pytest.approx(found.gap[0], abs=1e-12)
    return found.gap[0]


def pierces(ends, triangles):
    """Tell for (k, 2, 3) segments and (m, 3, 3) triangles whether any segment crosses any triangle (Moller 1997)."""
    start, way = ends[:, None, 0], ends[:, None, 1] - ends[:, None, 0]
    a, u, v = triangles[None, :, 0], triangles[None, :, 1] - triangles[None, :, 0], triangles[None, :, 2]
    v = v - a
    across = np.cross(way, v)
    scale = (u * across).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = ((start - a) * across).sum(axis=-1) / scale
        turned = np.cross(start - a, np.broadcast_to(u, across.shape))
        other = (way * turned).sum(axis=-1) / scale
        along = (v * turned).sum(axis=-1) / scale
    return bool(((share > 0) & (other > 0) & (share + other < 1) & (along > 0) & (along < 1)).any())


def cross(one, other):
    """Return whether two sets of triangles, (m, 3, 3), cross: an edge of one then pierces a face of the other."""
    edges = [np.stack([t, np.roll(t, -1, axis=1)], axis=2).reshape(-1, 2, 3) for t in (one, other)]
    return pierces(edges[0], other) or pierces(edges[1], one)


def placed(assembly, grain):
    shape = assembly.shapes[assembly.shape_id[grain]]
    return assembly.world_vertices(grain)[shape.faces]


def random_pairs(count, seed, spread):
    generator = np.random.default_rng(seed)
    turns = random_rotations(generator, 2 * count)
    for k in range(count):
        shapes = [SHAPES[m] for m in generator.integers(0, len(SHAPES), 2)]
        place = 10 + spread * (generator.random((2, 3)) - 0.5)
        yield Assembly.of(shapes, ROOM, position=place, shape_id=[0, 1], orientation=turns[2 * k : 2 * k + 2])


@pytest.mark.slow
def test_what_crosses_is_found_as_numpy_and_vtk_find_it():
    found = []
    for assembly in random_pairs(100, seed=1, spread=1.2):
        triangles = [placed(assembly, grain) for grain in range(2)]
        gap = find_contacts(assembly, 5.0).gap[0]
        found.append(cross(*triangles))
        assert (gap < 0) == found[-1]
        meshes = [
            pyvista.PolyData.from_regular_faces(t.reshape(-1, 3), np.arange(t.size // 3).reshape(-1, 3))
            for t in triangles
        ]
        assert (meshes[0].collision(meshes[1])[1] > 0) == found[-1]
    assert 25 < sum(found) < 75


def test_the_depth_of_a_crossing_parts_the_two_and_no_random_way_is_shorter():
    generator, looked = np.random.default_rng(2), 0
    for assembly in random_pairs(40, seed=3, spread=1.0):
        found = find_contacts(assembly, 5.0)
        depth = -found.gap[0]
        if depth <= 0:
            continue
        one, other = placed(assembly, 0), placed(assembly, 1)
        assert not cross(one, other + 1.000001 * depth * found.normal[0])
        for way in generator.normal(size=(8, 3)):
            assert cross(one, other + 0.99 * depth * way / np.linalg.norm(way))
        looked += 1
    assert looked > 10


def square(cells):
    x, y = np.meshgrid(np.arange(cells + 1) / cells, np.arange(cells + 1) / cells)
    faces = lattice_faces(cells, cells)
    return vg.Shape.from_surface(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), faces)


@pytest.mark.parametrize("cells", [1, 2, 10, 40])
@pytest.mark.parametrize(
    ("turn", "way", "depth"),
    [
        (TURN, (0.0, 0.0, 0.0), 0.5),
        (TURN, (0.13, -0.1, 0.2), 0.3),
        ([0.92, 0.31, 0.1, -0.216564], (0.0, 0.0, 0.0), None),
    ],
)
def test_the_depth_of_a_crossing_does_not_depend_on_the_triangles(cells, turn, way, depth):
    turn = np.array(turn) / np.linalg.norm(turn)
    place = np.array([3.0, 3.0, 3.0])
    coarse, fine = (
        vg.Packing.of([square(n)], vg.Box((6, 6, 6)), position=[place, place + way], orientation=[[1, 0, 0, 0], turn])
        for n in (1, cells)
    )
    depth = depth or vg.verify(coarse).deepest * coarse.diameters[0]
    assert depth > 0.1
    assert vg.verify(fine).deepest * fine.diameters[0] == pytest.approx(depth, rel=0.01)


def test_a_shell_pushed_by_a_millionth_into_one_around_it():
    shell = SHAPES[1]
    inside = Assembly.of([shell], ROOM, position=[[10, 10, 10]] * 2, scale=[1.0, 0.4])
    near = find_contacts(inside, 5.0)
    assert near.gap[0] > 0.01
    shift = -(near.gap[0] + 1e-6) * near.normal[0]
    pushed = Assembly.of([shell], ROOM, position=[[10, 10, 10], 10 + shift], scale=[1.0, 0.4])
    assert 1e-8 < -find_contacts(pushed, 5.0).gap[0] <= 1.00001e-6


def test_a_surface_on_its_copy_only_touches():
    for shape in (SHAPES[0], SHAPES[2]):
        assert gap_of(shape, shape, (0.0, 0.0, 0.0)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("push", [1e-2, 1e-6, 1e-9])
def test_a_corner_that_pierces_is_as_deep_as_it_was_pushed(push):
    corner = vg.Shape.from_surface([[0, 0, 0], [-1, 0.1, 2], [1, -0.1, 2]], [[0, 1, 2]])
    tip = np.array(corner.offset) + np.array([0.2, 0.5, 0.0])
    assert gap_of(FLAT, corner, tip - np.array([0.0, 0.0, push])) == pytest.approx(-push, rel=1e-6)
    assert gap_of(FLAT, corner, tip + np.array([0.0, 0.0, push])) == pytest.approx(push, rel=1e-6)


@pytest.mark.parametrize("way", [(0, 0, 0), (0.3, 0.3, 0), (0, 0, 0.5), (0.4, -0.2, 0.3)])
def test_sheets_that_cross_along_edges_of_their_triangles_cross(way):
    upright = vg.Shape.from_surface([[-1, -1, -1], [1, 1, -1], [1, 1, 1], [-1, -1, 1]], [[0, 1, 2], [0, 2, 3]])
    assert gap_of(FLAT, upright, way) < -1e-3
    assert gap_of(FLAT, FLAT, way, TURN) < -1e-3


@pytest.mark.parametrize(
    ("way", "turn"),
    [
        ((0.0, 0.0, 0.0), None),  # on each other
        ((0.7, 0.3, 0.0), None),  # in one plane
        ((2.0, 0.0, 0.0), None),  # border at border
        ((2.0, 2.0, 0.0), None),  # corner at corner
        ((0.3, 0.2, 1.0), TURN),  # one stands on the other
        ((1.0, 0.0, 1.0), TURN),  # two borders in a right angle
    ],
)
def test_sheets_that_only_touch_do_not_overlap(way, turn):
    assert gap_of(FLAT, FLAT, way, turn) == pytest.approx(0.0, abs=1e-12)


def test_sheets_apart_have_the_gap_between_them():
    assert gap_of(FLAT, FLAT, (0.3, 0.1, 0.25)) == pytest.approx(0.25)
    assert gap_of(FLAT, FLAT, (2.3, 0.0, 0.4)) == pytest.approx(0.5)
    assert gap_of(FLAT, FLAT, (0.0, 0.0, 1.25), TURN) == pytest.approx(0.25)


def meshed(name, **parameters):
    shape = vg.make_shape(name, **parameters)
    return vg.Shape.from_mesh(shape.vertices, shape.faces)


#: solids, and how far their lowest point, or their flat bottom, lies below the centroid
SOLIDS = {
    "sphere": (vg.make_shape("sphere", diameter=1.0), 0.5),
    "box": (vg.make_shape("box", lengths=(1, 1, 1)), 0.5),
    "mesh": (meshed("box", lengths=(1, 1, 1)), 0.5),
    "ellipsoid": (vg.make_shape("ellipsoid", semi_axes=(0.6, 0.7, 0.5)), 0.5),
    "cylinder": (vg.make_shape("cylinder", radius=0.4, height=1.0), 0.5),
    "cone": (vg.make_shape("cone", radius=0.5, height=1.0), 0.25),
    "rod": (vg.make_shape("spherocylinder", radius=0.5, height=1.6).rotated((0.5**0.5, 0.5**0.5, 0, 0)), 0.5),
}


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("push", [-0.3, -1e-6, 1e-6, 1e-2])
def test_a_sheet_under_a_solid(name, push):
    solid, below = SOLIDS[name]
    assert gap_of(FLAT, solid, (0.05, 0.02, below - push)) == pytest.approx(-push, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("shape", [vg.make_shape, meshed], ids=["box", "mesh"])
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.313, -0.271)])
def test_a_needle_that_pierces_a_sheet_is_found(shape, place):
    """The deepest point of the sheet lies in the middle of the needle, on no corner and no edge of either."""
    needle = shape("box", lengths=(0.01, 0.012, 2.0))
    assert gap_of(FLAT, needle, (*place, 0.2)) == pytest.approx(-0.005, rel=2e-3)


@pytest.mark.parametrize("name", SOLIDS)
def test_a_sheet_inside_a_solid_is_found(name):
    small = vg.make_shape("sheet", lengths=(0.02, 0.02))
    depth = -gap_of(small, SOLIDS[name][0], (0.0, 0.0, 0.0))
    least = {"cylinder": 0.39, "cone": 0.22}.get(name, 0.48)
    assert least < depth < least + 0.04


def test_a_clump_counts_by_its_single_spheres():
    clump = vg.Shape.of(Spheres(np.array([[0, 0, 0], [0.4, 0.1, 0.3]]), np.array([0.4, 0.3])), name="clump")
    low = (clump.geometry.centers[:, 2] - clump.geometry.radii).min()
    assert gap_of(FLAT, clump, (0.0, 0.0, -low - 0.01)) == pytest.approx(-0.01)
    assert gap_of(FLAT, clump, (0.0, 0.0, -low + 0.01)) == pytest.approx(0.01)


def test_a_sheet_in_a_cavity_is_free():
    outer, inner = vg.make_shape("box", lengths=(2, 2, 2)), vg.make_shape("box", lengths=(1, 1, 1))
    hollow = vg.Shape.from_mesh(
        np.concatenate([outer.vertices, inner.vertices]),
        np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)]),
    )
    sheet = vg.make_shape("sheet", lengths=(0.6, 0.6))
    assert gap_of(sheet, hollow, (0, 0, 0)) == pytest.approx(0.2)
    assert gap_of(sheet, hollow, (0, 0, 0.75)) == pytest.approx(-0.25, rel=1e-3)


WALLS = [
    (vg.Box((2.2, 2.2, 2.2)), 0.1),
    (vg.Cylinder(radius=1.5, height=2.0), 1.5 - math.sqrt(2)),
    (vg.Sphere(radius=1.5), 1.5 - math.sqrt(2)),
    (vg.ClosedMesh(meshed("box", lengths=(2.2, 2.2, 2.2))), 0.1),
]


@pytest.mark.parametrize(("container", "room"), WALLS, ids=lambda value: getattr(value, "kind", ""))
def test_how_far_a_sheet_is_within_walls_or_beyond(container, room):
    middle = np.array(container.bounds).mean(axis=0)
    assert escape_depths(Assembly.of([FLAT], container, position=[middle]))[0] == pytest.approx(-room, rel=1e-9)
    larger = Assembly.of([FLAT], container, position=[middle], scale=[1.2])
    corner = 1.2 * (math.sqrt(2) if container.kind in ("cylinder", "sphere") else 1.0)
    beyond = corner - (1.5 if container.kind in ("cylinder", "sphere") else 1.1)
    assert escape_depths(larger)[0] == pytest.approx(
        beyond * (math.sqrt(2) if container.kind == "mesh" else 1.0), rel=2e-3
    )


@pytest.mark.parametrize(
    ("position", "depth"),
    [
        ([[2, 2, 2], [2.5, 2.2, 1.0 - 1e-6 + 2]], 1e-6),  # into a sheet
        ([[2, 2, 0.0 + 1e-6], [2.5, 2.2, 3.0 + 2e-6]], 1e-6),  # across a periodic face
    ],
)
def test_verify_finds_a_sheet_pushed_by_a_millionth(position, depth):
    box = vg.Box((8, 8, 4), periodic="z")
    packing = vg.Packing.of([FLAT], box, position=position, orientation=[[1, 0, 0, 0], TURN])
    proof = vg.verify(packing)
    assert not proof.ok
    assert proof.overlapping_pairs == 1
    assert proof.deepest * FLAT.diameter == pytest.approx(depth, rel=1e-3)


def test_verify_finds_a_sheet_inside_a_solid_and_one_beyond_a_wall():
    sphere = vg.make_shape("sphere", diameter=3.0)
    small = vg.make_shape("sheet", lengths=(0.5, 0.5))
    box = vg.Box((6, 6, 6))
    inside = vg.verify(vg.Packing.of([sphere, small], box, position=[[3, 3, 3], [3, 3, 3.4]], shape_id=[0, 1]))
    assert inside.overlapping_pairs == 1
    assert inside.deepest * inside.mean_diameter == pytest.approx(1.5 - 0.4, rel=1e-9)
    out = vg.verify(vg.Packing.of([sphere, small], box, position=[[3, 3, 3], [0.25 - 1e-6, 1, 1]], shape_id=[0, 1]))
    assert out.escaped == 1
    assert out.largest_escape * out.mean_diameter == pytest.approx(1e-6, rel=1e-3)
