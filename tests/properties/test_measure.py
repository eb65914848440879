"""What holds for any grains in any window."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.geometry.halfspaces import cut_spheres
from voxgran.geometry.rotation import random_rotations
from voxgran.measures.registered.coordination import coordination_number
from voxgran.measures.registered.density import window_solid_fraction
from voxgran.measures.slices import cut_mesh
from voxgran.measures.window import Solids
from voxgran.packing.model import Packing
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import sphere

KINDS = {
    "sphere": Primitive("sphere", (0.5,)),
    "ellipsoid": Primitive("ellipsoid", (0.7, 0.5, 0.3)),
    "box": Primitive("box", (0.9, 0.6, 0.7)),
    "clump": Spheres(np.array([[0.0, 0, 0], [0.4, 0.1, 0]]), np.array([0.4, 0.3])),
    "mesh": Mesh(*sphere(1)[:2]),
}
number = st.floats(-1.5, 1.5, allow_nan=False)
corner = st.tuples(number, number, number)
seeds = st.integers(0, 2**20)


def box_of(lower, upper):
    """Return the corners of a box as arrays."""
    return {"lower": np.array(lower, dtype=float), "upper": np.array(upper, dtype=float)}


def sphere_box_volume(centers, radii, *, lower, upper):
    """Return the volume of each sphere inside a box."""
    return cut_spheres(np.array(centers, dtype=float), np.array(radii), **box_of(lower, upper))


def mesh_box_volume(vertices, faces, *, lower, upper):
    """Return the volume of a closed mesh inside a box."""
    return cut_mesh(vertices, faces, np.eye(3)[None], np.zeros((1, 3)), **box_of(lower, upper))[0]


def apart(kind, seed):
    """Return eight turned grains that do not overlap in a periodic box."""
    generator = stream(seed, "apart")
    shape = Shape.of(KINDS[kind], name=kind)
    position = np.stack(np.meshgrid(*[[1.0, 3.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    scale = generator.uniform(0.5, 0.95, 8) / shape.bounding_radius
    orientation = random_rotations(generator, 8)
    box = Box((4, 4, 4), periodic="xyz")
    return Packing.of([shape], box, position=position, scale=scale, orientation=orientation)


@given(center=corner, one=corner, other=corner, share=st.floats(0.0, 1.0), axis=st.integers(0, 2))
def test_a_window_that_is_cut_holds_the_sum_of_its_parts(center, one, other, share, axis):
    low, high = np.minimum(one, other), np.maximum(one, other)
    middle_low, middle_high = low.copy(), high.copy()
    middle_low[axis] = middle_high[axis] = low[axis] + share * (high[axis] - low[axis])
    whole, *parts = (
        sphere_box_volume([center], [1.0], lower=a, upper=b)[0]
        for a, b in [(low, high), (low, middle_high), (middle_low, high)]
    )
    assert sum(parts) == pytest.approx(whole, abs=5e-15)
    assert 0 <= whole <= min(4 * math.pi / 3, np.prod(high - low)) + 1e-14


@given(
    center=corner,
    one=corner,
    other=corner,
    turn=st.permutations([0, 1, 2]),
    flip=st.tuples(*[st.sampled_from([-1, 1])] * 3),
)
def test_a_sphere_has_no_direction(center, one, other, turn, flip):
    points = np.array([center, one, other])
    turned = points[:, turn] * np.array(flip)
    found = [
        sphere_box_volume([p[0]], [1.0], lower=np.minimum(p[1], p[2]), upper=np.maximum(p[1], p[2]))[0]
        for p in (points, turned)
    ]
    assert found[0] == pytest.approx(found[1], abs=5e-15)


@given(one=corner, other=corner, seed=seeds)
def test_a_mesh_in_a_sphere_fills_less_of_a_window(one, other, seed):
    vertices, faces, error = sphere(2)
    low, high = np.minimum(one, other), np.maximum(one, other)
    inner = mesh_box_volume(vertices, faces, lower=low, upper=high)
    outer = sphere_box_volume([[0, 0, 0]], [1.0], lower=low, upper=high)[0]
    assert -1e-14 <= inner <= outer + 1e-14
    assert outer - inner <= 4 * math.pi * error


@given(kind=st.sampled_from(sorted(KINDS)), seed=seeds, low=corner)
def test_every_window_of_one_period_holds_the_solid_fraction(kind, seed, low):
    packing = apart(kind, seed)
    found = window_solid_fraction(packing, low, np.array(low) + 4.0)
    assert found == pytest.approx(packing.solid_fraction, rel=1e-12)


@given(
    kind=st.sampled_from(sorted(KINDS)),
    seed=seeds,
    one=corner,
    other=corner,
    turns=st.tuples(*[st.integers(-3, 3)] * 3),
)
def test_a_window_moved_by_periods_holds_the_same(kind, seed, one, other, turns):
    low, high = np.minimum(one, other) - 0.1, np.maximum(one, other) + 0.1
    packing, shift = apart(kind, seed), 4.0 * np.array(turns)
    first = window_solid_fraction(packing, low, high)
    assert window_solid_fraction(packing, low + shift, high + shift) == pytest.approx(first, abs=1e-12)


@given(seed=seeds, count=st.integers(1, 12), one=corner, other=corner)
def test_overlapping_spheres_never_fill_more_than_the_window(seed, count, one, other):
    generator = stream(seed, "overlap")
    shape = Shape.of(KINDS["sphere"], name="sphere")
    packing = Packing.of(
        [shape],
        Box((1.5, 1.5, 1.5), periodic="xyz"),
        position=generator.uniform(0, 1.5, (count, 3)),
        scale=generator.uniform(0.5, 1.4, count),
    )
    solids = Solids(packing)
    low, high = np.minimum(one, other), np.maximum(one, other) + 0.01
    found = solids.volume(low, high)
    assert -1e-13 <= found <= np.prod(high - low) + 1e-13
    assert solids.volume(np.zeros(3), np.full(3, 1.5)) <= packing.volumes.sum() * (1 + 1e-12)


@given(seed=seeds, count=st.integers(0, 30))
def test_the_neighbours_of_all_grains_are_twice_the_pairs(seed, count):
    generator = stream(seed, "pairs")
    shape = Shape.of(KINDS["sphere"], name="sphere")
    box = Box((3, 3, 3), periodic=(True, False, True))
    packing = Packing.of([shape], box, position=generator.uniform(0, 3, (count, 3)))
    found = coordination_number(packing, [0.0, 0.1, 0.5], reference_gap=0.1)
    assert (np.diff(found.mean) >= 0).all() or count == 0
    if count:
        assert found.of_grain.mean() == pytest.approx(found.mean[1])
