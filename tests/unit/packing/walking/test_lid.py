"""A lid is one more wall."""

from dataclasses import replace

import numpy as np
import pytest

import voxgran as vg
from voxgran.contacts.assembly import Assembly, Lid
from voxgran.contacts.manifolds.rows import GAP, WALL
from voxgran.contacts.walls import beyond_lid, escape_depths
from voxgran.settling.bed import Bed
from voxgran.settling.fall import fall_step
from voxgran.settling.impulses import Fall

UP = np.array([0.0, 0.0, 1.0])


def wall_gaps(assembly):
    """Gaps of the contacts at walls and at the lid, sorted."""
    bed = Bed(assembly, -UP)
    bed.find(0.4, 0.0)
    partner = bed.rows.j[: bed.m]
    return np.sort(bed.rows.row[: bed.m, GAP][(partner == WALL) | (partner == bed.count)])


@pytest.mark.parametrize("name", ["sphere", "cube", "ellipsoid"])
def test_a_lid_is_one_more_wall(name):
    """Reach and nearness at a lid are those at the ceiling of a box that ends there."""
    shape = vg.make_shape("platonic", solid="cube") if name == "cube" else vg.make_shape(name)
    turn = np.array([[0.8, 0.36, 0.48, 0.0], [0.6, 0.0, 0.0, 0.8]])
    tall = Assembly.of(
        [shape], vg.Box((4, 4, 9)), position=[[1.2, 1.2, 2.4], [2.8, 2.8, 2.6]], orientation=turn, scale=[1.0, 1.3]
    )
    lidded, low = replace(tall, lid=Lid(UP, 3.0)), replace(tall, container=vg.Box((4, 4, 3)))
    assert escape_depths(lidded) == pytest.approx(escape_depths(low), abs=1e-15)
    assert beyond_lid(lidded) == pytest.approx(escape_depths(low), abs=1e-15)
    assert (beyond_lid(tall) == -np.inf).all()
    gaps = wall_gaps(lidded)
    assert gaps == pytest.approx(wall_gaps(low), abs=1e-12)
    assert len(gaps) > len(wall_gaps(tall))


def test_grains_do_not_rise_through_a_lid():
    """Pulled upward, a sphere comes to rest at a lid that is too heavy to move."""
    one = Assembly.of([vg.make_shape("sphere")], vg.Box((3, 3, 6)), position=[[1.5, 1.5, 3.0]])
    bed = Bed(replace(one, lid=Lid(UP, 3.8)), UP, lid_weight=np.inf)
    how = Fall(0.0)
    for _ in range(80):
        fall_step(bed, how, 0.0)
        assert beyond_lid(bed.moved_assembly())[0] <= 0.0
    assert beyond_lid(bed.moved_assembly())[0] == pytest.approx(-how.rest, abs=5e-4)
