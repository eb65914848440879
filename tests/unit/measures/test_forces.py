"""Numbers of forces, against assemblies whose forces are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from kit import column

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.contacts.forces import ContactForces
from voxgran.containers.kinds.box import Box
from voxgran.measures.model import measure, measure_registry
from voxgran.measures.registered.forces import force_statistics
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")


def row(forces, **changes):
    """Return spheres in a row along x, with normal forces (m,) between the neighbours."""
    count = len(forces) + 1
    position = np.column_stack([np.arange(count) + 0.5, np.ones(count), np.ones(count)])
    normal = np.tile([1.0, 0.0, 0.0], (count - 1, 1))
    given = {
        "i": np.arange(count - 1),
        "j": np.arange(1, count),
        "point": position[1:] - [0.5, 0, 0],
        "normal": normal,
        "force": np.asarray(forces)[:, None] * normal,
        "gap": np.zeros(count - 1),
        "residual": np.zeros(count),
        "rattler": np.zeros(count, dtype=bool),
        "friction": 0.5,
    }
    return Packing.of([BALL], Box((count, 2, 2)), position=position, forces=ContactForces(**{**given, **changes}))


def test_a_column_bears_its_weight():
    packing = column(5)
    found = force_statistics(packing)
    carried = np.array([1.0, 2.0, 3.0, 4.0])  # between the grains; the wall bears 5
    assert found.pairs == 4
    assert found.mean == pytest.approx(2.5)
    assert found.participation == pytest.approx(carried.mean() ** 2 / np.square(carried).mean())
    assert found.coordination == pytest.approx(2 * 4 / 5)
    assert found.sliding == 0.0
    assert math.isnan(found.decay)
    tree = measure(packing, "forces")
    assert float(tree.share_at_rest) == 1.0
    assert float(tree.share_of_rattlers) == 0.0
    assert tree["grains"].largest_force.values.tolist() == [5.0, 4.0, 3.0, 2.0, 1.0]


def test_the_histogram_is_a_density():
    forces = stream(3, "forces").exponential(size=4000)
    found = force_statistics(row(forces))
    width = np.diff(found.edges)
    relative = forces[forces > 1e-4 * forces.mean()]
    relative = relative / relative.mean()
    assert (found.density * width).sum() == pytest.approx((relative <= found.edges[-1]).mean(), abs=1e-12)
    # the mean of the first bin of exp(-f)
    assert found.density[0] == pytest.approx((1 - np.exp(-width[0])) / width[0], rel=0.1)
    assert found.decay == pytest.approx(1.0, rel=0.1)
    assert found.participation == pytest.approx(0.5, rel=0.1)


def test_equal_forces():
    found = force_statistics(row(np.full(30, 2.0)))
    assert found.participation == pytest.approx(1.0)
    assert math.isnan(found.decay)
    assert (found.density * np.diff(found.edges)).sum() == pytest.approx(1.0)


def test_contacts_at_the_limit_of_friction():
    force = [[1.0, 0.5, 0.0], [1.0, 0.3, 0.4], [1.0, 0.49, 0.0], [0.0, 0.0, 0.0]]
    packing = row(np.ones(4), force=force)
    assert force_statistics(packing).sliding == pytest.approx(2 / 3)
    for friction in (None, 0.0):
        unknown = replace(packing, forces=replace(packing.forces, friction=friction))
        assert math.isnan(force_statistics(unknown).sliding)


def test_rattlers_do_not_count_as_partners():
    packing = row([1.0, 1.0, 1e-3], rattler=[False, False, False, True])
    found = force_statistics(packing)
    assert found.coordination == pytest.approx(2 * 2 / 3)
    assert found.pairs == 3
    alone = row([1.0], rattler=[True, True])
    assert math.isnan(force_statistics(alone).coordination)


def test_points_of_one_pair_are_added():
    one = row([1.0, 1.0])
    two = {"i": [0, 1, 1], "j": [1, 0, 2], "normal": [[1, 0, 0], [-1, 0, 0], [1, 0, 0]], "gap": [0, 0, 0]}
    packing = row([1.0, 1.0], **two, point=one.forces.point[[0, 0, 1]], force=[[1, 0, 0], [-2, 0, 0], [3, 0, 0]])
    found = force_statistics(packing)
    assert (found.pairs, found.mean) == (2, 3.0)


def test_images_of_one_partner_are_two_pairs():
    box = Box((2, 4, 4), periodic="x")
    normal = [[1.0, 0, 0], [-1.0, 0, 0]]
    forces = ContactForces(
        i=[0, 0],
        j=[1, 1],
        point=[[1, 1, 1], [0, 1, 1]],
        normal=normal,
        force=normal,
        gap=[0, 0],
        residual=[0, 0],
        rattler=[False, False],
    )
    packing = Packing.of([BALL], box, position=[[0.5, 1, 1], [1.5, 1, 1]], forces=forces)
    assert force_statistics(packing).pairs == 2
    assert force_statistics(packing).coordination == 2.0


def test_forces_that_are_not_known():
    packing = replace(column(3), forces=None)
    assert not measure_registry().get("forces").applies(packing)
    assert measure_registry().get("forces").applies(column(3))
    with pytest.raises(InputError, match="forces of the packing are None"):
        measure(packing, "forces")


def test_nothing_carries():
    found = force_statistics(row([0.0, 0.0]))
    assert found.pairs == 0
    assert np.isnan([found.mean, found.participation, found.sliding, found.decay]).all()
    assert np.isnan(found.density).all()
    assert found.coordination == 0.0
