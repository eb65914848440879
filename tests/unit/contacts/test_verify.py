"""Mutation tests of the checker: one grain pushed by a millionth of a diameter is found by its number."""

import itertools
import math

import numpy as np
import pytest
from kit import slow

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.find import overlaps
from voxgran.contacts.verify import verify
from voxgran.contacts.walls import escape_depths
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.geometry.rotation import random_rotations
from voxgran.shapes.files import load_shape
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import unit_box

PUSH = 1e-6  # mean diameters


def mesh_box(*lengths):
    vertices, faces, _ = unit_box()
    return Shape.of(Mesh(vertices * np.array(lengths), faces), name="mesh box")


def hollow():
    """A cube of edge 4 with a cubic cavity of edge 2."""
    vertices, faces, _ = unit_box()
    both = np.concatenate([faces, faces[:, ::-1] + 8])
    return Shape.of(Mesh(np.concatenate([4 * vertices, 2 * vertices]), both), name="hollow")


@pytest.fixture(scope="module")
def sets(data_dir):
    """Sets of shapes, each packed as one chain of touching grains."""
    clump = Spheres(np.array([[0.0, 0, 0], [0.5, 0.1, 0], [0.2, 0.4, 0.2]]), np.array([0.35, 0.3, 0.25]))
    ell = np.array([(0, 0), (1, 0), (1, 0.4), (0.4, 0.4), (0.4, 1), (0, 1)], dtype=float)
    real = [load_shape(data_dir / f"{name}.obj") for name in ("eros", "bennu_lp")]
    solids = {
        "sphere": Shape.of(Primitive("sphere", (0.5,)), name="sphere"),
        "ellipsoid": Shape.of(Primitive("ellipsoid", (0.6, 0.45, 0.35)), name="ellipsoid"),
        "box": Shape.of(Primitive("box", (0.9, 0.8, 0.7)), name="box"),
        "cylinder": Shape.of(Primitive("cylinder", (0.4, 0.9)), name="cylinder"),
        "cone": Shape.of(Primitive("cone", (0.5, 1.0)), name="cone"),
        "rod": Shape.of(Primitive("spherocylinder", (0.35, 0.6)), name="rod"),
        "clump": Shape.of(clump, name="clump"),
        "mesh box": mesh_box(0.9, 0.8, 0.7),
    }
    plane = {
        "disk": Shape.of(Outline("disk", 0.5), name="disk"),
        "polygon": Shape.of(Outline("polygon", vertices=ell), name="ell"),
    }
    sets = {name: [shape] for name, shape in (solids | plane).items()}
    scans = [shape.scaled(1 / shape.diameter) for shape in real]
    return sets | {"scans": scans, "mixture": [*solids.values(), *scans], "mixture in 2D": list(plane.values())}


NAMES = ["sphere", "ellipsoid", "box", "cylinder", "cone", "rod", "clump", "mesh box", "scans", "mixture"]
PLANE = ["disk", "polygon", "mixture in 2D"]


def rotations(count, dimension, seed):
    generator = stream(seed, "verify")
    if dimension == 3:
        return random_rotations(generator, count)
    angle = generator.uniform(0, np.pi, count)
    return np.column_stack([np.cos(angle), 0 * angle, 0 * angle, np.sin(angle)])


def chain(shapes, count=None):
    """Lay grains along x so that each touches the next one within 1e-9; return the assembly."""
    count = count or max(5, len(shapes))
    dimension = shapes[0].dimension
    container = Box((30, 6, 6)) if dimension == 3 else Rectangle((30, 6))
    generator = stream(5, "verify")
    position = np.zeros((count, 3))
    position[:, 0] = 1.5
    position[:, 1] = 3 + generator.uniform(-0.1, 0.1, count)
    position[:, 2] = 3 + generator.uniform(-0.1, 0.1, count) if dimension == 3 else 0.0
    arrays = {"shape_id": np.arange(count) % len(shapes), "orientation": rotations(count, dimension, 6)}

    def pair(k, x):
        rows = [k - 1, k]
        place = position[rows].copy()
        place[1, 0] = x
        return Assembly.of(shapes, container, position=place, **{key: value[rows] for key, value in arrays.items()})

    for k in range(1, count):
        low, high = position[k - 1, 0] + 0.1, position[k - 1, 0] + 2.5
        while high - low > 1e-10:
            middle = (low + high) / 2
            low, high = (middle, high) if overlaps(pair(k, middle)).count else (low, middle)
        position[k:, 0] = high + 1e-9
    return Assembly.of(shapes, container, position=position, **arrays)


def pushed(assembly, grain, step):
    """Move one grain by a step, in mean diameters."""
    position = assembly.position.copy()
    position[grain] += np.array(step) * assembly.diameters.mean()
    return Assembly.of(
        assembly.shapes,
        assembly.container,
        position=position,
        shape_id=assembly.shape_id,
        scale=assembly.scale,
        orientation=assembly.orientation,
    )


def found_pairs(proof):
    return {(pair.i, pair.j, pair.image) for pair in proof.pairs}


@pytest.mark.parametrize("name", [slow(name) if name in ("scans", "mixture") else name for name in [*NAMES, *PLANE]])
def test_a_grain_pushed_into_another_is_found_by_number(sets, name):
    good = chain(sets[name])
    proof = verify(good)
    assert proof.ok, proof.summary()
    for grain in range(good.count - 1):
        bad = verify(pushed(good, grain, [PUSH, 0, 0]))
        assert found_pairs(bad) == {(grain, grain + 1, (0, 0, 0))}
        assert not bad.ok
        assert bad.overlapping_pairs == 1
        assert 0.05 * PUSH < bad.deepest <= 1.01 * PUSH
        assert (bad.escaped, bad.largest_escape) == (0, 0.0)


@pytest.mark.parametrize("edge", [0, 1, 2])
def test_spheres_of_a_lattice_that_touch_exactly_pass_and_each_push_is_found(sets, edge):
    lattice = np.array(list(itertools.product(range(3), repeat=3)))
    good = Assembly.of(sets["sphere"], Box((3, 3, 3)), position=lattice + 0.5)
    assert verify(good, tolerance=0.0).ok
    step = np.eye(3)[edge] * PUSH
    bad = verify(pushed(good, 13, step))
    other = int(np.flatnonzero((lattice == lattice[13] + np.eye(3)[edge]).all(axis=1))[0])
    assert found_pairs(bad) == {(13, other, (0, 0, 0))}
    assert bad.deepest == pytest.approx(PUSH, rel=1e-9)


@pytest.mark.parametrize("shape", [Shape.of(Primitive("box", (1.0, 1.0, 1.0)), name="box"), mesh_box(1, 1, 1)])
def test_boxes_that_fill_space_pass_and_each_push_is_found(shape):
    lattice = np.array(list(itertools.product(range(3), repeat=3)))
    good = Assembly.of([shape], Box((3, 3, 3)), position=lattice + 0.5)
    assert verify(good).ok
    bad = verify(pushed(good, 13, [0, 0, -PUSH]))
    # the pushed box meets the face below; its sides still touch without depth
    assert found_pairs(bad) == {(12, 13, (0, 0, 0))}
    assert bad.deepest == pytest.approx(PUSH, rel=1e-3)
    assert verify(good).pair_tests > 27


@pytest.mark.parametrize(
    ("walls", "name"),
    [
        slow(walls, name)
        if name == "mixture" or (walls, name) in (("mesh", "scans"), ("mesh", "cone"), ("mesh", "cylinder"))
        else (walls, name)
        for walls in ("box", "cylinder", "mesh", "cylinder side")
        for name in NAMES
    ],
)
def test_a_grain_pushed_through_a_wall_is_found_by_number(sets, name, walls):
    container = {"box": Box((9, 9, 9)), "mesh": ClosedMesh(Shape.from_mesh(*Box((9, 9, 9)).mesh()))}
    container = container.get(walls, Cylinder(4.5, 9, origin=(4.5, 4.5, 0)))
    way = np.array([1.0, 0, 0]) if walls in ("cylinder side", "mesh") else np.array([0, 0, 1.0])
    shapes = sets[name]
    count = max(2, len(shapes))
    angle = 2 * np.pi * np.arange(count) / count
    position = 4.5 + 2.2 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    good = Assembly.of(
        shapes,
        container,
        position=position,
        shape_id=np.arange(count) % len(shapes),
        orientation=rotations(count, 3, 7),
    )
    mean = good.diameters.mean()
    for grain in range(count):
        low, high = 0.0, 9.0
        while high - low > 1e-11:
            middle = (low + high) / 2
            out = escape_depths(pushed(good, grain, middle * way))[grain]
            low, high = (low, middle) if out > 0 else (middle, high)
        near = pushed(good, grain, (low - 1e-9) * way)
        assert escape_depths(near)[grain] == pytest.approx(0, abs=1e-8)
        assert verify(near).ok, verify(near).summary()
        bad = verify(pushed(near, grain, PUSH * way))
        assert [item.grain for item in bad.escapes] == [grain]
        assert bad.escaped == 1
        assert 0.2 * PUSH < bad.largest_escape < 1.01 * PUSH
        assert (
            bad.escapes[0].depth
            == bad.largest_escape
            == pytest.approx(escape_depths(pushed(near, grain, PUSH * way))[grain] / mean)
        )


@pytest.mark.parametrize("name", PLANE)
def test_a_grain_pushed_through_a_side_in_the_plane_is_found_by_number(sets, name):
    shapes = sets[name]
    turns = rotations(2, 2, 8)
    probe = Assembly.of(
        shapes, Rectangle((6, 6)), position=[(2, 3, 0), (4.5, 3, 0)], shape_id=[0, len(shapes) - 1], orientation=turns
    )
    inside = -escape_depths(probe)[1] / probe.diameters.mean()
    near = pushed(probe, 1, [inside - 1e-9, 0, 0])
    assert verify(near).ok
    bad = verify(pushed(near, 1, [PUSH, 0, 0]))
    assert [item.grain for item in bad.escapes] == [1]
    assert bad.largest_escape == pytest.approx(PUSH, rel=1e-2)


@pytest.mark.parametrize("name", [slow(name) if name in ("scans", "mixture") else name for name in [*NAMES, *PLANE]])
def test_a_grain_pushed_across_a_periodic_face_is_found_by_number(sets, name):
    """The chain is closed to a ring: the first grain touches the image of the last one."""
    open_chain = chain(sets[name], 3 if len(sets[name]) < 3 else None)
    last = open_chain.count - 1

    def closed(length):
        plane = open_chain.dimension == 2
        container = Rectangle((length, 6), ["x"]) if plane else Box((length, 6, 6), ["x"])
        return Assembly.of(
            open_chain.shapes,
            container,
            position=open_chain.position,
            shape_id=open_chain.shape_id,
            orientation=open_chain.orientation,
        )

    low, high = float(np.ptp(open_chain.position[:, 0])) + 0.1, 30.0
    while high - low > 1e-10:
        middle = (low + high) / 2
        low, high = (middle, high) if overlaps(closed(middle)).count else (low, middle)
    good = closed(high + 1e-9)
    assert verify(good).ok, verify(good).summary()
    bad = verify(pushed(good, last, [PUSH, 0, 0]))
    assert (0, last, (-1, 0, 0)) in found_pairs(bad)
    assert bad.overlapping_pairs == 1


def test_a_grain_that_meets_its_own_image_is_found(sets):
    good = Assembly.of(sets["sphere"], Box((1.0, 4, 4), ["x"]), position=[(0.3, 2, 2)])
    assert verify(good).ok
    bad = verify(Assembly.of(sets["sphere"], Box((1 - 1e-6, 4, 4), ["x"]), position=[(0.3, 2, 2)]))
    assert found_pairs(bad) == {(0, 0, (1, 0, 0))}
    assert bad.deepest == pytest.approx(1e-6, rel=1e-6)


@pytest.mark.parametrize("inner", NAMES[:-1])
@pytest.mark.parametrize(
    "outer", ["sphere", "box", "cone", "clump", "mesh box", slow("ellipsoid"), slow("cylinder"), slow("scans")]
)
def test_a_small_grain_inside_a_large_one_is_found(sets, inner, outer):
    shapes = [sets[outer][0], sets[inner][0]]
    bad = verify(
        Assembly.of(
            shapes, Box((20, 20, 20)), position=[(10, 10, 10), (10.1, 10.1, 10)], shape_id=[0, 1], scale=[4, 0.2]
        )
    )
    assert found_pairs(bad) == {(0, 1, (0, 0, 0))}
    assert bad.deepest * bad.mean_diameter > 0.45


def test_a_grain_free_in_a_cavity_is_no_overlap(sets):
    def packing(x):
        small = [sets[name][0] for name in ("sphere", "cone", "mesh box", "clump")]
        position = [(5, 5, 5), (x, 5, 5), (5, 5, 5.4), (5, 4.4, 4.5), (4.5, 5.5, 4.6)]
        return Assembly.of(
            [hollow(), *small],
            Box((10, 10, 10)),
            position=position,
            shape_id=np.arange(5),
            scale=[1, 0.5, 0.3, 0.3, 0.3],
        )

    assert verify(packing(5.75 - 1e-9)).ok, verify(packing(5.75 - 1e-9)).summary()
    bad = packing(5.75)
    bad = verify(pushed(bad, 1, [PUSH, 0, 0]))
    assert found_pairs(bad) == {(0, 1, (0, 0, 0))}


def test_the_worst_come_first_and_no_more_than_twenty():
    sphere = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
    x = np.cumsum(1 - 1e-3 * np.arange(30))
    proof = verify(
        Assembly.of([sphere], Box((40, 1, 1)), position=np.column_stack([x, np.full(30, 0.5), np.full(30, 0.55)]))
    )
    assert proof.overlapping_pairs == 29
    assert len(proof.pairs) == len(proof.escapes) == 20
    assert (proof.pairs[0].i, proof.pairs[0].j) == (28, 29)
    depths = [pair.depth for pair in proof.pairs]
    assert depths == sorted(depths, reverse=True)
    assert proof.deepest == depths[0] == pytest.approx(0.029)
    assert proof.escaped == 30
    assert proof.largest_escape == pytest.approx(0.05)
    assert "grains 28 and 29: 0.029 deep" in proof.summary()
    assert proof.summary().startswith("not ok: 29 overlapping pairs")


def test_depths_are_in_mean_diameters_and_the_tolerance_too():
    sphere = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
    pair = Assembly.of([sphere], Box((9, 9, 9)), position=[(2, 4, 4), (4.5 - 3e-3, 4, 4)], scale=[2.0, 3.0])
    proof = verify(pair)
    assert proof.mean_diameter == 2.5
    assert proof.deepest == pytest.approx(3e-3 / 2.5, rel=1e-9)
    assert verify(pair, tolerance=1.3e-3).ok
    assert not verify(pair, tolerance=1.1e-3).ok


def test_no_grains_are_a_valid_packing(sets):
    proof = verify(Assembly.of(sets["scans"], Box((1, 1, 1)), position=np.zeros((0, 3))))
    assert proof.ok
    assert (proof.count, proof.pair_tests, proof.deepest, proof.largest_escape) == (0, 0, 0.0, 0.0)
    assert proof.summary().startswith("ok: no overlap, no escape (0 grains")


def test_positions_that_are_not_finite_are_refused(sets):
    good = Assembly.of(sets["sphere"], Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)])
    for name, value in (("position", np.nan), ("scale", np.inf), ("orientation", np.nan)):
        arrays = {key: getattr(good, key).copy() for key in ("shape_id", "scale", "position", "orientation")}
        arrays[name][1] = value
        broken = Assembly(good.shapes, container=good.container, **arrays)
        with pytest.raises(InputError, match=name):
            verify(broken)
    with pytest.raises(InputError, match="tolerance"):
        verify(good, tolerance=-1e-9)


def test_it_knows_nothing_of_the_method():
    """What is checked are shapes, poses and container; the same grains in another order give the same numbers."""
    generator = stream(9, "verify")
    sphere = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
    position = generator.uniform(0.4, 5.6, (60, 3))
    one = verify(Assembly.of([sphere], Box((6, 6, 6)), position=position))
    order = generator.permutation(60)
    two = verify(Assembly.of([sphere], Box((6, 6, 6)), position=position[order]))
    assert one.overlapping_pairs == two.overlapping_pairs > 0
    assert one.escaped == two.escaped > 0
    assert one.deepest == pytest.approx(two.deepest, rel=1e-14)
    assert {(order[p.i], order[p.j]) for p in two.pairs} | {(order[p.j], order[p.i]) for p in two.pairs} >= {
        (p.i, p.j) for p in one.pairs
    }
    assert math.isfinite(one.largest_escape)


def test_disks_off_the_plane_are_refused():
    disk = Shape.of(Outline("disk", radius=0.5), name="disk")
    with pytest.raises(InputError, match=r"grain 1 has z = 0\.5"):
        Assembly.of([disk], Rectangle((4, 4)), position=[(1, 1, 0), (2, 2, 0.5)])
