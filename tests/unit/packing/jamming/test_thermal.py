"""Thermal motion of grains: temperature, pressure, and growth that is left."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.contacts.assembly import Assembly
from voxgran.packing.jamming import thermal
from voxgran.packing.jamming.thermal import SPEED, Motion, stop_moving, thermal_step
from voxgran.settling.bed import Bed


def bed_of(shape, container, positions, scale=1.0):
    n = len(positions)
    arrays = {"position": np.array(positions, float), "scale": np.full(n, scale), "shape_id": np.zeros(n, int)}
    arrays["orientation"] = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    down = np.eye(3)[container.dimension - 1] * -1.0
    return Bed(Assembly.of((shape,), container, **arrays), down)


def lattice(side, spacing, dimension=3):
    places = np.indices((side,) * dimension).reshape(dimension, -1).T * spacing + 0.5 * spacing
    return places if dimension == 3 else np.column_stack([places, np.zeros(len(places))])


def moved(bed, steps, motion=None, generator=None):
    motion, generator = motion or Motion(), generator or np.random.default_rng(1)
    for _ in range(steps):
        motion, way = thermal_step(bed, motion, generator, kept=1e-3)
    return motion, way


def test_all_freedoms_have_the_temperature_and_gravity_moves_nothing():
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    bed = bed_of(cube, vg.Box((160, 160, 160), "xyz"), lattice(8, 20.0), scale=1.0)
    # short steps, in which no grain is fast enough to be slowed down
    for step in range(40):
        thermal_step(bed, Motion(0.02), np.random.default_rng(step), kept=1e-3)
    n = bed.count
    squares = (bed.bodies[:n, :6] ** 2).mean(axis=0) / bed.bodies[0, [6, 6, 6, 7, 7, 7]]
    # 512 samples of each: the standard error of a mean square is 0.06 of it
    assert squares == pytest.approx(SPEED**2, rel=0.25)
    assert squares.mean() == pytest.approx(SPEED**2, rel=0.08)
    assert abs(bed.bodies[:n, :3].mean()) < 0.03
    stop_moving(bed)
    assert not bed.bodies[:n, :6].any()


def test_outlines_stay_in_their_plane():
    triangle = vg.make_shape("polygon", corners=3)
    bed = bed_of(triangle, vg.Rectangle((5, 5), "xy"), lattice(5, 1.0, 2), scale=0.6)
    moved(bed, 20)
    assert not bed.grains.position[:, 2].any()
    assert not bed.orientation[:, 1:3].any()
    assert np.abs(bed.orientation[:, 3]).min() > 0.0


def test_less_growth_is_left_in_denser_grains():
    octahedron = vg.make_shape("platonic", solid="octahedron")
    left = []
    for scale in (0.5, 0.75, 1.0):
        bed = bed_of(octahedron, vg.Box((5, 5, 5), "xyz"), lattice(5, 1.0), scale=scale)
        left.append(moved(bed, 80)[0].free)
    assert left[0] > left[1] + 0.05 > 2.0 * left[2]


def test_the_pressure_is_the_virial_of_the_impulses():
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    bed = bed_of(cube, vg.Box((6, 6, 6), "xyz"), lattice(4, 1.5), scale=1.1)
    motion, way = moved(bed, 30)
    row, substep = bed.rows.row[: bed.m], way / SPEED / thermal.SUBSTEPS
    total = sum(r[10] * np.dot(r[:3], r[3:6] - r[6:9]) for r in row)
    expected = total / (substep * 3 * 64 * SPEED**2)
    assert expected > 0.0
    assert thermal._excess_pressure(bed, substep) == pytest.approx(expected)
    assert motion.substep == pytest.approx(substep)


def test_motion_gets_shorter_with_the_growth_that_is_left():
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    bed = bed_of(cube, vg.Box((40, 40, 40), "xyz"), lattice(2, 20.0))
    assert moved(bed, 1, Motion(0.01))[1] == pytest.approx(thermal.OF_FREE * 0.01)
    assert moved(bed, 1, Motion(1.0))[1] == thermal.LONGEST
    # nothing touches: the running mean goes to that of an ideal gas
    assert moved(bed, 1, Motion(0.5))[0].free == pytest.approx(0.5 + thermal.NEW * 0.5)
