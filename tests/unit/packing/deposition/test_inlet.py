"""Grains that are deposited below an inlet."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError

BALL = vg.shapes.sphere()


def test_grains_fall_below_the_inlet():
    box, inlet = vg.Box((12, 12, 12)), vg.Inlet(radius=2.0, center=(4.0, 5.0, 0.0))
    heap = vg.pack(BALL, box, "deposition", count=120, inlet=inlet, seed=1)
    assert heap.count == 120
    assert vg.verify(heap).ok
    assert heap.position[:, :2].mean(axis=0) == pytest.approx((4.0, 5.0), abs=0.6)
    # they stay where they arrive, if they stick
    stuck = vg.pack(BALL, box, "deposition", count=40, inlet=inlet, sticking=1.0)
    assert np.hypot(*(stuck.position[:, :2] - (4.0, 5.0)).T).max() <= 1.5 + 1e-9
    poured = vg.pour(BALL, box, 120, inlet=inlet, method="deposition", seed=1)
    assert poured.position.tobytes() == heap.position.tobytes()


def test_a_rectangle_and_two_dimensions():
    wide = vg.pack(BALL, vg.Box((9, 9, 9)), "deposition", count=40, inlet=vg.Inlet(lengths=(3, 6)), sticking=1.0)
    away = np.abs(wide.position[:, :2] - 4.5).max(axis=0)
    assert away[0] <= 1.0 + 1e-9
    assert 1.5 < away[1] <= 2.5 + 1e-9
    flat = vg.pack(
        vg.make_shape("disk"), vg.Rectangle((12, 20)), "deposition", count=15, inlet=vg.Inlet(radius=1), sticking=1.0
    )
    assert np.abs(flat.position[:, 0] - 6.0).max() <= 0.5 + 1e-9


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"inlet": vg.Inlet(radius=1, rate=3)}, "rate of inlet is 3: by deposition grains come one by one"),
        ({"inlet": vg.Inlet(radius=1, height=3)}, "height of inlet is 3: by deposition grains come one by one"),
        ({"inlet": vg.Inlet(radius=1), "toward": "center"}, "inlet is given with toward='center'"),
        ({"inlet": vg.Inlet(radius=0.3)}, "inlet is 0.6 wide, and the largest grain is 1"),
    ],
)
def test_inlets_that_cannot_be(more, sentence):
    with pytest.raises(InputError, match=sentence):
        vg.pack(BALL, vg.Box((6, 6, 6)), "deposition", count=5, **more)
