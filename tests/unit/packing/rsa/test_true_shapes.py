"""Random sequential addition of true shapes: the tests of pairs and walls against contacts/, and what a run keeps."""

import itertools
from functools import partial

import kit
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.arrays import WHOLE
from voxgran._base.errors import InputError, PackingWarning
from voxgran._base.seeds import stream
from voxgran.contacts.overlap.true_pairs import place_relative, shapes_meet
from voxgran.contacts.overlap.true_shapes import inner_radius, true_shapes
from voxgran.contacts.overlap.true_walls import is_within_walls
from voxgran.contacts.parts import row_of
from voxgran.contacts.walls import escape_depths
from voxgran.containers.kernel_container import kernel_container
from voxgran.geometry.farthest import farthest_of_row
from voxgran.geometry.rotation import random_rotations, rotation_matrices, write_matrix
from voxgran.packing.rsa.method import registration as rsa
from voxgran.packing.rsa.overlaps import Bed, Grains
from voxgran.packing.rsa.true_overlaps import is_taken, list_near
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres

task_of = partial(kit.task_of, "rsa")
ELL = ((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2))


def dumbbell():
    """Two spheres of different radii, apart from each other, whose centroid is in the smaller one or in none."""
    return Shape.of(Spheres(np.array([[-0.6, 0, 0], [0.8, 0.1, 0]]), np.array([0.4, 0.5])), name="dumbbell")


SOLIDS = {
    "sphere": lambda: vg.make_shape("sphere"),
    "ellipsoid": lambda: vg.make_shape("ellipsoid", semi_axes=(2, 1.2, 0.8)),
    "box": lambda: vg.make_shape("box", lengths=(1.5, 1, 0.6)),
    "cylinder": lambda: vg.make_shape("cylinder", radius=0.4, height=1.5),
    "cone": lambda: vg.make_shape("cone", radius=0.7, height=1.1),
    "rod": lambda: vg.make_shape("spherocylinder", radius=0.4, height=1.9),
    "polyhedron": lambda: vg.make_shape("convex_polyhedron", seed=1),
    # with few facets, since the depth of each overlap is found too
    "union": lambda: vg.make_shape("solid_union", seed=2, chord_error=0.01),
    "clump": dumbbell,
}
FLAT = {
    "disk": lambda: vg.make_shape("disk"),
    "ell": lambda: vg.make_shape("polygon", vertices=ELL),
    "pentagon": lambda: vg.make_shape("polygon", corners=5),
}


def unit(make):
    """Return a shape of equivalent diameter 1, as problems have them."""
    shape = make()
    return shape.scaled(1 / shape.diameter)


def turns(generator, many, dimension):
    if dimension == 3:
        return random_rotations(generator, many)
    angle = np.pi * generator.random(many)
    return np.column_stack([np.cos(angle), np.zeros(many), np.zeros(many), np.sin(angle)])


def tables(shapes, container, scale):
    core = np.array([inner_radius(shape) for shape in shapes]) * scale
    return true_shapes(shapes, container, np.arange(len(shapes)), np.array(scale), core)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        # of unions contacts take long to find; of the others every second pair is quick enough
        slow(*pair) if ("union" in pair and "box" not in pair) or k % 2 else pair
        for kinds in (SOLIDS, FLAT)
        for k, pair in enumerate(itertools.combinations_with_replacement(kinds, 2))
    ],
)
def test_pairs_meet_where_contacts_say_so(one, other):
    """Random poses, also of other sizes and one within the other; the answer is that of the exact contacts."""
    makes = SOLIDS | FLAT
    shapes, scale = [unit(makes[one]), unit(makes[other])], (1.0, 0.7)
    dimension = shapes[0].dimension
    room = vg.Box((40, 40, 40)) if dimension == 3 else vg.Rectangle((40, 40))
    made = tables(shapes, room, scale)
    generator = stream(len(one) + 7 * len(other), "test")
    # the contacts of the union take long to find
    found, many = [], 12 if "union" in (one, other) else 16
    for _ in range(many):
        orientation = turns(generator, 2, dimension)
        step = generator.normal(size=3) * (np.arange(3) < dimension)
        step *= generator.uniform(0.0, 1.6) / np.linalg.norm(step)
        position = np.array([np.zeros(3), step]) + 20.0 * (np.arange(3) < dimension)
        pair = vg.Packing.of(shapes, room, position=position, scale=scale, shape_id=[0, 1], orientation=orientation)
        write_matrix(orientation[0], made.work.turn)
        write_matrix(orientation[1], made.work.other)
        place_relative(made)
        x, y, z = rotation_matrices(orientation)[0].T @ step / scale[0]
        meet = shapes_meet(made, 0, 1, x, y, z, scale[1] / scale[0])
        assert meet == (vg.verify(pair).overlapping_pairs == 1)
        found.append(meet)
    assert many / 8 < sum(found) < many


def test_shapes_within_a_mesh_meet_it():
    """Wholly inside, no surfaces cross: small shapes in a thick shell of two nested surfaces, and in its hollow."""
    big = vg.make_shape("solid_union", seed=2).scaled(1.0)
    big = big.scaled(1 / big.diameter)
    for make in SOLIDS.values():
        made = tables([big, unit(make)], vg.Box((40, 40, 40)), (1.0, 0.02))
        deep = big.vertices.mean(axis=0) * 0.0
        for axis in range(3):
            made.work.relative[axis] = np.eye(3)[axis]
        assert shapes_meet(made, 0, 1, *deep, 0.02)
        x, y, z = -deep * 50
        assert shapes_meet(made, 1, 0, x, y, z, 50.0)
        assert not shapes_meet(made, 0, 1, 2.0, 0.0, 0.0, 0.02)


ROOMS = {
    "box": lambda: vg.Box((1.7, 1.6, 1.8), "y", origin=(2, -1, 0.5)),
    "cylinder": lambda: vg.Cylinder(0.95, 1.6),
    "sphere": lambda: vg.Sphere(1.05),
    "mesh": lambda: vg.ClosedMesh(vg.make_shape("solid_union", seed=3).scaled(2.4)),
    "rectangle": lambda: vg.Rectangle((1.7, 1.6), "x", origin=(2, -1)),
    "disk": lambda: vg.Disk(0.95),
    "polygon": lambda: vg.Polygon([(0, 0), (2.4, 0), (2.4, 2), (1.2, 1.3), (0, 2)]),
}


@pytest.mark.parametrize("name", ROOMS)
def test_walls_hold_what_contacts_say_is_inside(name):
    room, found = ROOMS[name](), []
    generator, (lower, upper) = stream(3, name), room.bounds
    for make in (SOLIDS if room.dimension == 3 else FLAT).values():
        shape, scale = unit(make), 0.9
        made = tables([shape], room, (scale,))
        walls = kernel_container(room)
        # escapes from meshes take long to find
        for orientation in turns(generator, 4 if name == "mesh" else 12, room.dimension):
            place = lower + (0.5 + 0.45 * (generator.random(3) - 0.5)) * (upper - lower)
            one = vg.Packing.of([shape], room, position=[place], scale=[scale], orientation=[orientation])
            write_matrix(orientation, made.work.turn)
            held = is_within_walls(walls, made, 0, scale, *place)
            assert held == bool(escape_depths(one)[0] <= 0), shape.name
            found.append(held)
    assert 0.1 < np.mean(found) < 0.95


def test_a_cavity_of_the_container_does_not_lie_in_a_grain():
    """No triangles cross, and the grain lies within the outer walls."""
    cube = vg.make_shape("box", lengths=(6, 6, 6))
    vertices = np.concatenate([cube.vertices, cube.vertices / 100])
    faces = np.concatenate([cube.faces, cube.faces[:, ::-1] + len(cube.vertices)])
    room = vg.ClosedMesh(vg.Shape.from_mesh(vertices, faces))
    walls = kernel_container(room)
    for name in ("union", "box", "clump", "sphere"):
        made = tables([unit(SOLIDS[name])], room, (1.5,))
        made.work.turn[:] = np.eye(3)
        # the second sphere of the clump
        deep = np.array([-0.75, 0.0, 0.0]) if name == "clump" else np.zeros(3)
        assert not is_within_walls(walls, made, 0, 1.5, *deep)
        assert is_within_walls(walls, made, 0, 1.5, 1.5, 1.5, 1.5)


def test_farthest_points_of_rows():
    """The farthest point is the support point along its own direction: the best of those that steps lead to."""
    generator = stream(1, "rows")
    for kind, size in (
        ("ellipsoid", {"semi_axes": (2, 1.2, 0.8)}),
        ("box", {"lengths": (0.9, 0.5, 1.4)}),
        ("cylinder", {"radius": 0.4, "height": 1.5}),
        ("cone", {"radius": 0.7, "height": 1.1}),
        ("spherocylinder", {"radius": 0.4, "height": 1.9}),
    ):
        shape = vg.make_shape(kind, **size)
        for place in (*generator.normal(size=(20, 3)), np.zeros(3), np.array([0.1, 0, 0]), np.array([0, 0, -0.3])):
            way = generator.normal(size=(200, 3))
            for _ in range(300):
                points = place + shape.geometry.support(way)
                way = points / np.linalg.norm(points, axis=1)[:, None]
            best = np.linalg.norm(points, axis=1).max()
            assert farthest_of_row(row_of(shape.geometry), *place) == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize("name", ["box", "cone", "union", "polyhedron"])
def test_closed_cells_hold_no_free_place(name):
    """Half way: where a new grain fits in any orientation there is an open cell, and many are closed."""
    shape, box = SOLIDS[name](), vg.Box((4.5, 4, 5), "y")
    problem = task_of(shape, box, until="saturated", seed=3, tries=100).problem
    state = rsa.prepare(problem)
    while state.arrays["depth"][0] < 2 and not state.stop_reason:
        state = rsa.advance(problem, state, 50)
    made = state.derived["precomputed"]
    made_shapes = made.shapes._replace(orientation=state.arrays["orientation"])
    classes, cell = made.classes, state.arrays["cell"]
    edge = classes.span[0] / (classes.base[0] * 2.0 ** state.arrays["depth"][0])
    cells = {tuple(row) for row in cell[:, :3].tolist()}
    assert len(cells) < 0.7 * np.prod(classes.base[0] * 8)
    generator = np.random.Generator(np.random.PCG64(1))
    hits = 0
    for place in classes.low[0] + generator.random((3000, 3)) * classes.span[0]:
        if tuple(np.floor((place - classes.low[0]) / edge).astype(int).tolist()) in cells:
            continue
        hits += 1
        grains = (state.arrays["position"], made.half, made.level, state.arrays["entered"], False)
        core = classes.half[0, 0] * (1 + WHOLE)
        many = list_near(Bed(Grains(*grains), made.cells, made.walls), made_shapes, tuple(place), core, core)
        assert many < 0 or is_taken(Grains(*grains), made_shapes, many, (0.0, 0.0, 0.0), core)
    assert hits > 100


def test_cubes_go_beyond_their_bounding_spheres():
    """Bounding spheres allow 0.14; published for cubes at saturation is 0.3686."""
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    with pytest.warns(PackingWarning):
        packing = vg.pack(cube, vg.Box((6, 6, 6), "xyz"), method="rsa", until="saturated", seed=1, tries=1000, count=90)
    proof = packing.provenance["saturation"]
    assert vg.verify(packing).ok
    assert 0.31 < packing.solid_fraction < 0.38
    assert packing.stop_reason == "steps"
    assert proof["of"] == "true shapes"
    assert not proof["proven"]
    assert proof["not_proven"] == 90 - packing.count
    # the run ends after as many failures in a row as one round of all grains has
    assert 90 * 1000 <= proof["failed_in_row"] <= proof["failed_tries"]
    assert proof["open_cells"] > 0
    tried = vg.pack(cube, vg.Box((6, 6, 6), "xyz"), method="rsa", until="tries", seed=1, tries=20)
    told = tried.provenance["saturation"]
    assert (told["of"], told["proven"]) == ("true shapes", False)
    assert told["failed_tries"] == tried.provenance["counters"]["refused"] > 100


def test_a_target_is_met_beyond_the_tries():
    """The search of open cells goes on where all tries of a grain fail, in rounds."""
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    packing = vg.pack(cube, vg.Box((6, 6, 6), "xyz"), method="rsa", seed=2, tries=200, solid_fraction=0.27)
    counters = packing.provenance["counters"]
    assert packing.stop_reason == "solid_fraction"
    assert packing.solid_fraction == pytest.approx(0.27, abs=1 / 216)
    assert 0 < counters["search_from"] < packing.count
    assert vg.verify(packing).ok


def test_saturation_is_proven_where_all_cells_close():
    """A container in which a rod has no place at all, in any orientation, around one that was placed."""
    rod = vg.make_shape("cylinder", radius=0.45, height=1.0)
    with pytest.warns(PackingWarning):
        packing = vg.pack(
            rod, vg.Box((1.02, 1.02, 1.02)), method="rsa", until="saturated", count=2, seed=1, tries=20000
        )
    assert packing.count == 1
    assert packing.stop_reason == "saturated"
    assert packing.provenance["saturation"]["proven"]


@pytest.mark.parametrize("scheme", ["classic", "2", "4a", "4c"])
def test_schemes_without_moves_hold_for_true_shapes(scheme):
    shapes = [vg.make_shape("cone"), vg.make_shape("ellipsoid")]
    packing = vg.pack(
        shapes, vg.Cylinder(2, 5), method="rsa", scheme=scheme, tries=20, sizes=vg.sizes.discrete([1.0, 0.6], [1, 2]),
        seed=1,
    )  # fmt: skip
    assert packing.count > 20
    assert vg.verify(packing).ok
    assert len(np.unique(packing.orientation, axis=0)) == packing.count


@pytest.mark.parametrize("scheme", ["1", "3", "4b", "4d"])
def test_schemes_with_moves_are_refused(scheme):
    with pytest.raises(InputError, match=f"scheme '{scheme}' is asked for with shape 'cone'"):
        vg.pack([vg.make_shape("sphere"), vg.make_shape("cone")], vg.Box((4, 4, 4)), "rsa", scheme=scheme, count=2)


@pytest.mark.parametrize("dimension", [2, 3])
def test_orientations_are_uniform(dimension):
    """Means of all components of the rotation matrices vanish, and those of their squares are 1 / dimension."""
    shape = vg.make_shape("polygon", corners=3) if dimension == 2 else vg.make_shape("cone")
    room = vg.Rectangle((200, 200), "xy") if dimension == 2 else vg.Box((40, 40, 40), "xyz")
    packing = vg.pack(shape, room, method="rsa", count=2000, seed=1)
    matrix = rotation_matrices(packing.orientation)[:, :dimension, :dimension]
    assert np.abs(matrix.mean(axis=0)).max() < 4 / np.sqrt(2000 * dimension)
    assert (matrix**2).mean(axis=0) == pytest.approx(1 / dimension, abs=0.04)
    if dimension == 2:
        assert (packing.orientation[:, 1:3] == 0).all()


def test_a_grain_longer_than_a_period_lies_beside_its_own_images():
    rod = vg.make_shape("box", lengths=(3, 0.5, 0.5))
    packing = vg.pack(rod, vg.Box((2.2, 5, 5), "xyz"), method="rsa", count=10, seed=1)
    assert packing.count == 10
    assert vg.verify(packing).ok
    # none lies along the short period
    along = np.abs(rotation_matrices(packing.orientation)[:, 0, 0])
    assert along.max() < 0.98


def test_many_small_grains_near_a_large_one():
    shapes, sizes = vg.make_shape("box", lengths=(1, 1, 1)), vg.sizes.discrete([3.0, 0.25], [1, 1199])
    packing = vg.pack(shapes, vg.Box((5, 5, 5), "x"), method="rsa", count=1200, sizes=sizes, seed=2, order="largest")
    assert packing.count == 1200
    assert vg.verify(packing).ok


@pytest.mark.parametrize("options", [{"until": "saturated", "tries": 30}, {"count": 60, "tries": 5}])
def test_chunks_and_resumption_do_not_matter(options):
    shapes, found = [vg.make_shape("box", lengths=(1.2, 1, 0.8)), vg.make_shape("sphere")], []
    for chunk, anew in ((10**6, False), (997, True), (61, False)):
        problem = task_of(
            shapes, vg.Box((3, 3.5, 3.2), "y"), sizes=vg.sizes.uniform(0.6, 1.2), seed=6, **options
        ).problem
        state = rsa.prepare(problem)
        while not state.stop_reason:
            state = rsa.advance(problem, state, chunk)
            if anew:
                state.derived = {}
        found.append((state.done, state.counters, {name: array.tobytes() for name, array in state.arrays.items()}))
    assert all(one == found[0] for one in found)
