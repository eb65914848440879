"""Random sequential addition on lattices to exact saturation, against published and measured coverages."""

import math

import numpy as np
import pytest
from kit import references, slow

import voxgran as vg
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

VALUES = references("rsa_lattice")


def coverages(shape, container, runs, **parameters):
    """Return the share of voxels that is taken at saturation, by seed."""
    found = []
    for seed in range(runs):
        packing = vg.pack(
            shape, container, method="digital_rsa", seed=seed, voxel_size=1.0, cover="center", **parameters
        )
        assert packing.stop_reason == "saturated"
        assert packing.provenance["candidates_left"] == 0
        assert packing.provenance["voxel_solid_fraction"] == pytest.approx(packing.solid_fraction, rel=1e-9)
        found.append(packing.solid_fraction)
    return np.array(found)


def check(found, value, error=0.0):
    """Hold the mean within four standard errors, of the runs and of the reference together."""
    own = found.std(ddof=1) / math.sqrt(len(found))
    assert abs(found.mean() - value) < 4 * math.hypot(own, error), (found.mean(), own, value, error)
    # and the runs are not so noisy that this says nothing
    assert own < 0.02 * value


def rectangle(a, b):
    corners = np.array([[0, 0], [a, 0], [a, b], [0, b]], dtype=float)
    return Shape.of(Outline("polygon", vertices=corners), name="rectangle")


def rows(quick):
    """Return the rows of a table, of which `make test` runs one."""
    return [row if row == quick else slow(row) for row in range(5)]


@pytest.mark.slow
@pytest.mark.parametrize("row", rows(3))
def test_k_mers_in_one_dimension(row):
    values = VALUES["kmers_1d"]
    k = values["k"][row]
    line = vg.Rectangle((2000.0 * k, 1.0), periodic=(True, False))
    check(coverages(rectangle(k, 1), line, 12, turned=False), values["value"][row])


@pytest.mark.parametrize("row", rows(4))
def test_squares(row):
    values = VALUES["squares_2d"]
    k, edge = values["k"][row], 512 + 512 % values["k"][row]
    plane = vg.Rectangle((float(edge), float(edge)), periodic=(True, True))
    check(coverages(rectangle(k, k), plane, 6, turned=False), values["value"][row], values["error"][row])


@pytest.mark.slow
@pytest.mark.parametrize("row", rows(1))
def test_cubes(row):
    values = VALUES["cubes_3d"]
    k = values["k"][row]
    cube = Shape.of(Primitive("box", (float(k),) * 3), name="cube")
    room = vg.Box((96.0, 96.0, 96.0), periodic=(True, True, True))
    check(coverages(cube, room, 6 if k < 8 else 14, turned=False), values["value"][row], values["error"][row])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*pairs of grains")
def test_dimers_in_two_dimensions():
    value = VALUES["dimers_2d"]
    plane = vg.Rectangle((500.0, 500.0), periodic=(True, True))
    check(coverages(rectangle(2, 1), plane, 6), value["value"], value["error"])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*pairs of grains")
def test_dimers_in_three_dimensions():
    value = VALUES["dimers_3d"]
    dimer = Shape.of(Primitive("box", (2.0, 1.0, 1.0)), name="dimer")
    room = vg.Box((40.0, 40.0, 40.0), periodic=(True, True, True))
    check(coverages(dimer, room, 6), value["value"], value["error"])
