"""Ways to enter and to shake that no walk takes."""

import kit
import pytest

import voxgran as vg
from voxgran._base.errors import InputError

BOTH = [
    ({"gravity": (0.0, 0.0, 0.0)}, "gravity"),
    ({"gravity": (1.0, 0.0)}, "gravity"),
    ({"gravity": "none", "lid": True}, "lid is true"),
    ({"rate": 0.0}, "rate is 0"),
    ({"rate": 1.5}, "rate is 1.5"),
    ({"period": 0}, "period is 0"),
    ({"cycles": 0}, "cycles is 0"),
    ({"cycles": 8, "period": 50}, "cycles is 8 and period 50: each makes the number of cycles; leave one out"),
    ({"decay": 1.5}, "decay is 1.5"),
    ({"layer_sweeps": 0}, "layer_sweeps is 0"),
    ({"feed": "pour"}, "feed"),
]
DIGITAL = [
    ({"gravity": "none", "schedule": "sleeping"}, "sleeping"),
    ({"guided": -0.1}, "guided"),
    ({"schedule": "sort"}, "schedule"),
]


def start(method, container, **parameters):
    """Begin to pack spheres."""
    return kit.run(kit.task_of(method, vg.make_shape("sphere"), container, count=2, **parameters))


@pytest.mark.parametrize(
    ("method", "way", "words"),
    [*(("control_point", *row) for row in BOTH), *(("digital", *row) for row in BOTH + DIGITAL)],
)
def test_bad_ways_are_named(method, way, words):
    with pytest.raises(InputError, match=words):
        start(method, vg.Box((4, 4, 6)), **way)


@pytest.mark.parametrize("method", ["control_point", "digital"])
def test_gravity_along_a_periodic_axis_is_refused(method):
    with pytest.raises(InputError, match="periodic axis"):
        start(method, vg.Box((4, 4, 4), "x"), gravity=(0.1, 0.0, -1.0))
