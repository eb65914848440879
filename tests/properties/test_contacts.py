"""What holds for all contacts: either order, any motion of the whole, any power of two as unit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxgran._base.seeds import stream
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.find import find_contacts
from voxgran.containers.kinds.box import Box
from voxgran.geometry.rotation import product, random_rotations, rotation_matrices
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import revolved

CLUMP = Spheres(np.array([[0.0, 0, 0], [0.4, 0, 0.1]]), np.array([0.4, 0.3]))
SHAPES = [
    Shape.of(geometry, name=f"shape {k}")
    for k, geometry in enumerate(
        [
            *(Primitive("sphere", (0.5,)), Primitive("ellipsoid", (0.6, 0.5, 0.3)), Primitive("box", (0.8, 0.9, 0.7))),
            *(Primitive("cylinder", (0.4, 0.8)), Primitive("cone", (0.5, 0.9)), CLUMP),
            Primitive("spherocylinder", (0.3, 0.5)),
            Mesh(*revolved([(-0.4, 0.5), (0.3, 0.2)], sides=12)[:2]),
        ]
    )
]

kinds = st.integers(0, len(SHAPES) - 1)
seeds = st.integers(0, 2**32)


def pair(one, other, seed):
    """Two grains at random, near enough for a gap of 2."""
    generator = stream(seed, "property")
    way = generator.normal(size=3)
    offset = generator.uniform(0.3, 1.6) * way / np.linalg.norm(way)
    turns = random_rotations(generator, 2)
    scale = generator.uniform(0.5, 1.5, 2)
    return lay(one, other, offset, turns, scale), generator


def lay(one, other, offset, turns, scale, *, base=(50.0, 50.0, 50.0), unit=1.0):
    return Assembly.of(
        [SHAPES[one], SHAPES[other]],
        Box(np.full(3, 100 * unit)),
        position=np.array([base, np.array(base) + offset]) * unit,
        shape_id=[0, 1],
        orientation=turns,
        scale=scale * unit,
    )


def near(gap, other):
    """Gaps agree to many digits, depths to the thousandth that searches are good for."""
    return (
        other == pytest.approx(gap, rel=1e-9, abs=1e-11)
        if gap > 0
        else other == pytest.approx(gap, rel=5e-3, abs=1e-10)
    )


@given(kinds, kinds, seeds)
def test_the_gap_is_the_same_in_both_orders(one, other, seed):
    there, _ = pair(one, other, seed)
    step = there.position[1] - there.position[0]
    back = lay(other, one, -step, there.orientation[::-1], there.scale[::-1])
    a, b = find_contacts(there, 3.0), find_contacts(back, 3.0)
    assert near(a.gap[0], b.gap[0])
    if a.gap[0] > 1e-6:
        np.testing.assert_allclose(a.normal, -b.normal, atol=1e-5)


@given(kinds, kinds, seeds)
def test_the_gap_does_not_change_when_both_are_moved_and_turned(one, other, seed):
    first, generator = pair(one, other, seed)
    turn = random_rotations(generator, 1)
    matrix = rotation_matrices(turn)[0]
    step = first.position[1] - first.position[0]
    second = lay(
        one, other, matrix @ step, product(turn, first.orientation), first.scale, base=generator.uniform(20, 80, 3)
    )
    a, b = find_contacts(first, 3.0), find_contacts(second, 3.0)
    assert near(a.gap[0], b.gap[0])
    if a.gap[0] > 1e-6:
        np.testing.assert_allclose(a.normal @ matrix.T, b.normal, atol=1e-5)


@given(kinds, kinds, seeds, st.sampled_from([-20, 20]))
def test_a_power_of_two_as_unit_changes_no_bit(one, other, seed, power):
    first, _ = pair(one, other, seed)
    unit = 2.0**power
    step = first.position[1] - first.position[0]
    again = lay(one, other, step, first.orientation, first.scale)
    second = lay(one, other, step, first.orientation, first.scale, unit=unit)
    a, b = find_contacts(again, 3.0), find_contacts(second, 3.0 * unit)
    np.testing.assert_array_equal(a.gap * unit, b.gap)
    np.testing.assert_array_equal(a.normal, b.normal)
    np.testing.assert_array_equal(a.point * unit, b.point)


@given(kinds, kinds, seeds, st.floats(1e-9, 0.05))
def test_the_gap_changes_by_no_more_than_the_path(one, other, seed, path):
    first, generator = pair(one, other, seed)
    way = generator.normal(size=3)
    step = first.position[1] - first.position[0]
    second = lay(one, other, step + path * way / np.linalg.norm(way), first.orientation, first.scale)
    a, b = find_contacts(first, 3.0).gap[0], find_contacts(second, 3.0).gap[0]
    assert abs(a - b) <= path * (1 + 1e-6) + 1e-9 + 5e-3 * max(-a, -b, 0.0)


@given(kinds, kinds, seeds)
def test_the_point_of_a_gap_lies_halfway_along_the_normal(one, other, seed):
    assembly, _ = pair(one, other, seed)
    found = find_contacts(assembly, 3.0)
    assert np.linalg.norm(found.normal[0]) == pytest.approx(1.0, rel=1e-9)
    if found.gap[0] > 1e-6:
        # a sphere of half the gap about the point touches both grains
        reach = found.gap[0] / 2
        sphere = Shape.of(Primitive("sphere", (reach,)), name="sphere")
        for grain in range(2):
            alone = Assembly.of(
                [assembly.shapes[grain], sphere],
                assembly.container,
                position=[assembly.position[grain], found.point[0]],
                shape_id=[0, 1],
                orientation=[assembly.orientation[grain], (1, 0, 0, 0)],
                scale=[assembly.scale[grain], 1.0],
            )
            assert find_contacts(alone, 1.0).gap[0] == pytest.approx(0.0, abs=2e-8)
