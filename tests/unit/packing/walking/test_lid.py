"""A lid is one more wall."""

from dataclasses import replace

import numpy as np
import pytest
from voxgran.settling.contact_points import near_walls
from voxgran.settling.settle import follow
from voxgran.settling.trial_motion import free_fall

import voxgran as vg
from voxgran.contacts.assembly import Assembly, Lid
from voxgran.contacts.walls import beyond_lid, escape_depths

UP = np.array([0.0, 0.0, 1.0])


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
    ours, theirs = near_walls(lidded, 0.4), near_walls(low, 0.4)
    assert np.sort(ours.gap) == pytest.approx(np.sort(theirs.gap), abs=1e-15)
    assert len(ours.gap) > len(near_walls(tall, 0.4).gap)


def test_grains_do_not_rise_through_a_lid():
    """Pulled upward, a sphere comes to rest at the lid, from above and from below."""
    for sign in (1.0, -1.0):
        one = Assembly.of([vg.make_shape("sphere")], vg.Box((3, 3, 6)), position=[[1.5, 1.5, 3.0]])
        one = replace(one, lid=Lid(sign * UP, sign * (3.0 + sign * 0.8)))
        for _ in range(30):
            one = follow(one, free_fall(one, sign * 0.02 * UP))[0]
        assert beyond_lid(one)[0] <= 0.0
        assert beyond_lid(one)[0] == pytest.approx(0.0, abs=4e-3)
