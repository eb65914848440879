"""Contacts where digits are scarce: tiny and huge units, far from the origin, very different sizes."""

import numpy as np
import pytest
from kit import slow

from voxgran._base.seeds import stream
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.find import find_contacts
from voxgran.contacts.verify import verify
from voxgran.contacts.walls import escape_depths
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import sphere


def shapes():
    vertices, faces, _ = sphere(1)
    clump = Spheres(np.array([[0.0, 0, 0], [0.4, 0, 0]]), np.array([0.4, 0.3]))
    geometries = [
        *(Primitive("sphere", (0.5,)), Primitive("ellipsoid", (0.6, 0.5, 0.3)), Primitive("box", (0.8, 0.9, 0.7))),
        *(Primitive("cylinder", (0.4, 0.8)), Primitive("cone", (0.5, 0.9)), Primitive("spherocylinder", (0.3, 0.5))),
        *(clump, Mesh(0.5 * vertices, faces)),
    ]
    return [Shape.of(geometry, name=f"shape {k}") for k, geometry in enumerate(geometries)]


def scene(factor=1.0, shift=(0.0, 0.0, 0.0), container=None):
    """Forty grains of all kinds, some in contact, in a box of edge 4; scaled and moved as a whole."""
    generator = stream(1, "stability")
    count = 40
    kinds = shapes()
    return Assembly.of(
        kinds,
        container or Box(np.full(3, 4 * factor), ("x", "y"), origin=np.array(shift) * factor),
        position=(generator.uniform(0.2, 3.8, (count, 3)) + shift) * factor,
        shape_id=np.arange(count) % len(kinds),
        scale=generator.uniform(0.6, 0.9, count) * factor,
        orientation=random_rotations(generator, count),
    )


@pytest.fixture(scope="module")
def plain():
    return find_contacts(scene(), 0.1), verify(scene()), escape_depths(scene())


def test_the_scene_has_gaps_overlaps_and_escapes(plain):
    contacts, proof, _ = plain
    assert (contacts.gap > 0).sum() > 5
    assert proof.overlapping_pairs > 5
    assert proof.escaped > 0


@pytest.mark.parametrize("power", [-40, slow(20), slow(40)])
def test_scaling_by_a_power_of_two_gives_the_same_bits(plain, power):
    contacts, proof, escape = plain
    factor = 2.0**power
    found = find_contacts(scene(factor), 0.1 * factor)
    for name in ("i", "j", "image", "normal"):
        np.testing.assert_array_equal(getattr(found, name), getattr(contacts, name))
    np.testing.assert_array_equal(found.gap, contacts.gap * factor)
    np.testing.assert_array_equal(found.point, contacts.point * factor)
    np.testing.assert_array_equal(escape_depths(scene(factor)), escape * factor)
    assert verify(scene(factor)).deepest == proof.deepest


@pytest.mark.parametrize("factor", [1e-12, slow(1e-6), slow(1e6), 1e12])
def test_scaling_by_any_factor_gives_the_same_contacts(plain, factor):
    contacts, proof, escape = plain
    found = find_contacts(scene(factor), 0.1 * factor)
    np.testing.assert_array_equal(np.column_stack([found.i, found.j]), np.column_stack([contacts.i, contacts.j]))
    apart = contacts.gap > 0
    np.testing.assert_allclose(found.gap[apart] / factor, contacts.gap[apart], rtol=1e-9)
    np.testing.assert_allclose(found.gap[~apart] / factor, contacts.gap[~apart], rtol=3e-3)
    np.testing.assert_allclose(escape_depths(scene(factor)) / factor, escape, atol=1e-9)
    assert verify(scene(factor)).overlapping_pairs == proof.overlapping_pairs


def test_far_from_the_origin_only_the_digits_of_the_positions_are_lost(plain):
    contacts, proof, escape = plain
    shift = np.array([1e6, -2e6, 3e6])
    far = scene(shift=shift)
    found = find_contacts(far, 0.1)
    np.testing.assert_array_equal(np.column_stack([found.i, found.j]), np.column_stack([contacts.i, contacts.j]))
    apart = contacts.gap > 0
    np.testing.assert_allclose(found.gap[apart], contacts.gap[apart], atol=2e-9)
    np.testing.assert_allclose(escape_depths(far), escape, atol=2e-9)
    assert verify(far).overlapping_pairs == proof.overlapping_pairs


@pytest.mark.parametrize("shape", shapes(), ids=lambda s: type(s.geometry).__name__)
def test_a_grain_larger_than_half_a_periodic_box_meets_its_images(shape):
    turn = random_rotations(stream(2, "stability"), 1)
    alone = Assembly.of(
        [shape], Box((1, 1, 1), (True, True, True)), position=[(0.9, 0.1, 0.5)], orientation=turn, scale=[0.95]
    )
    found = find_contacts(alone, 0.3)
    assert found.count > 0
    assert (found.i == 0).all()
    steps = found.image
    for step, gap in zip(steps, found.gap, strict=True):
        two = Assembly.of(
            [shape],
            Box((20, 20, 20)),
            position=[(10, 10, 10), np.array([10, 10, 10]) + step],
            scale=[0.95, 0.95],
            orientation=np.repeat(turn, 2, axis=0),
        )
        assert find_contacts(two, 0.3).gap[0] == pytest.approx(gap, rel=2e-3, abs=1e-12)
    # one of a step and its reverse
    assert not {tuple(-s) for s in steps} & {tuple(s) for s in steps}


@pytest.mark.parametrize("gap", [1e-4, -1e-5])
@pytest.mark.parametrize("large", shapes(), ids=lambda s: type(s.geometry).__name__)
def test_sizes_in_the_ratio_of_a_thousand(large, gap):
    """A small sphere at a known distance from the deepest support plane of a large grain."""
    small = shapes()[0]
    assembly = Assembly.of(
        [large, small],
        Box((8000, 8000, 8000)),
        position=[(4000, 4000, 4000), (4000, 4000, 5200)],
        shape_id=[0, 1],
        scale=[1000, 1],
    )
    first = find_contacts(assembly, 1000.0)
    assert first.gap[0] > 1
    step = (first.gap[0] - gap) * first.normal[0]
    near = Assembly.of(
        [large, small],
        assembly.container,
        position=[(4000, 4000, 4000), assembly.position[1] - step],
        shape_id=[0, 1],
        scale=[1000, 1],
    )
    assert find_contacts(near, 1.0).gap[0] == pytest.approx(gap, rel=1e-5, abs=1e-8)


def test_needles_and_plates():
    """Flat and long solids keep the same gap as the boxes or spheres that bound them where they touch."""
    plate = Shape.of(Primitive("cylinder", (100.0, 1e-3)), name="plate")
    needle = Shape.of(Primitive("ellipsoid", (1e-3, 1e-3, 10.0)), name="needle")
    for gap in (1e-3, 1e-6, -1e-6):
        height = 5e-4 + 10.0 + gap
        pair = Assembly.of(
            [plate, needle], Box((500, 500, 500)), position=[(250, 250, 250), (260, 250, 250 + height)], shape_id=[0, 1]
        )
        assert find_contacts(pair, 0.1).gap[0] == pytest.approx(gap, rel=1e-6, abs=1e-12)


def test_walls_far_larger_than_the_grains():
    grains = shapes()
    small = Assembly.of(
        grains, Cylinder(1e6, 1e6), position=np.tile([0.0, 0, 5e5], (len(grains), 1)), shape_id=np.arange(len(grains))
    )
    escape = escape_depths(small)
    assert (escape < -4.9e5).all()
    assert np.isfinite(escape).all()


#: solids of length 1 and a width, as kinds with their dimensions
THIN = {
    "box": lambda w: (w, w, 1.0),
    "cylinder": lambda w: (w / 2, 1.0),
    "cone": lambda w: (w / 2, 1.0),
    "ellipsoid": lambda w: (w / 2, w / 2, 0.5),
    "spherocylinder": lambda w: (w / 2, 1.0),
}


def reach_of_needle(kind, width, axes, normal):
    """Return how far a needle reaches along a normal across its axis, at a place of 0.2 on it."""
    if kind == "box":
        return sum(0.5 * width * abs(axis @ normal) for axis in axes)
    return 0.5 * width * {"cone": 0.75 - 0.2, "ellipsoid": np.sqrt(1.0 - 0.4**2)}.get(kind, 1.0)


@pytest.mark.parametrize("kind", list(THIN))
@pytest.mark.parametrize("width", [1e-9, 1e-7, 1e-4])
def test_needles_that_cross_by_a_tenth_of_their_width_are_told_from_those_a_tenth_apart(kind, width):
    """Needles of any aspect: a search by support points in space as it is loses the width of those of 1e-9."""
    needle = Shape.of(Primitive(kind, THIN[kind](width)), name="needle")
    for seed in range(12):
        generator = stream(seed, "needles")
        turns = random_rotations(generator, 2)
        (*one, along), (*two, across) = (matrix.T for matrix in rotation_matrices(turns))
        normal = np.cross(along, across) / np.linalg.norm(np.cross(along, across))
        reach = sum(reach_of_needle(kind, width, axes, normal) for axes in (one, two))
        for depth in (0.1 * width, -0.1 * width):
            centers = [-0.2 * along, (reach - depth) * normal - 0.2 * across]
            pair = Assembly.of([needle], Box((6, 6, 6), origin=(-3, -3, -3)), position=centers, orientation=turns)
            found = verify(pair)
            assert found.ok == (depth < 0), (seed, depth)
            # cones and ellipsoids are nearest beside that place, and the depth of edges is less than the way apart
            least = 0.5 if kind == "box" else 0.95
            assert least * max(depth, 0.0) <= found.deepest * found.mean_diameter <= 1.05 * max(depth, 0.0)


@pytest.mark.parametrize("shift", [(0.9, 0.3), (0.0, 1.0 - 1e-10)], ids=["side by side", "end to end"])
def test_parallel_needles_and_flat_disks_overlap_by_how_far_they_would_be_moved_apart(shift):
    needle, disk = (Shape.of(Primitive("cylinder", size), name="thin") for size in ((5e-10, 1.0), (0.5, 1e-9)))
    for seed in range(6):
        turn = random_rotations(stream(seed, "thin"), 1)
        axes = rotation_matrices(turn)[0].T
        apart = 1e-9 * shift[0] * axes[0] + shift[1] * axes[2]
        flush = 0.3 * axes[0] + 0.9e-9 * axes[2]
        for shape, away in ((needle, apart), (disk, flush)):
            box = Box((6, 6, 6), origin=(-3, -3, -3))
            pair = Assembly.of([shape], box, position=[0 * away, away], orientation=np.repeat(turn, 2, axis=0))
            found = verify(pair, tolerance=0.0)
            assert found.deepest * found.mean_diameter == pytest.approx(1e-10, rel=1e-3)
