"""What every packing method must keep, run over the registry: a new file is tested the moment it exists."""

import dataclasses
import functools
import zlib

import numpy as np
import pytest

import voxgran as vg
from voxgran.packing.driver import Drive, drive
from voxgran.packing.method import method_registry
from voxgran.testing import PackingMethodSuite
from voxgran.testing.packing_methods import bits_of

#: methods, and what else of a method has to keep it all, by name
VARIANTS = {
    "random_apollonian, rotated": {"rotate": 4, "shift": 1},
    "control_point, kdtree": {"contact": "kdtree"},
    "control_point, one way": {"tested_points": "one"},
    "control_point, open surfaces": {"contact": "kdtree"},
}
#: what else goes on after a stop
STAGES = {
    "advancing_front, dense": {"mode": "dense"},
    "digital_fill, contact": {"place": "contact"},
    "rsa, saturated": {"until": "saturated", "tries": 20},
}
#: what makes a method quick here; anything else is its default
QUICK = {"sweeps": 120, "cycles": 2, "voxel_size": 0.1, "spacing": 0.25, "orientations": 6}
#: what makes one method quick
QUICKER = {"digital_fill": {"voxel_size": 0.2}, "multilayer": {"layers": 2}}
#: methods that pack spheres only
SPHERES_ONLY = ("multilayer",)
#: methods that move and resize the grains of a start, so that each has tests of its own
RESIZING = ("expand", "jam")
#: methods for which the container of the suite will not do, with another
CONTAINERS = {"apollonian": vg.Sphere(2.0)}
#: methods that `make test` kills, too: one of each way to walk on, which is all that a checkpoint depends on
KILLED = ("digital", "gravity", "rsa")
#: what of the suite is about grains of a start that stay
STAYING = ("test_a_start_stays_in_order_and_goes_on", "test_a_start_that_has_no_place_is_refused")
#: what is done between two looks whether to stop, made little
SHORTENED = {
    "voxgran.contacts.surface_pairs.AT_ONCE": 3,
    "voxgran.packing.rsa.available_boxes.AT_ONCE": 5,
    "voxgran.packing.digital.feasible_places.JOINED_WORDS": 1,
    "voxgran.packing.digital.feasible_places.FEWEST_RUNS": 7,
    "voxgran.packing.digital.fill_method.SLAB_WORDS": 1,
}
#: what of the suite is about the end of a run and what comes after it, not about stopping in its midst
NOT_OF_STAGES = [
    name
    for name in dir(PackingMethodSuite)
    if name.startswith("test_") and "stopped_at" not in name and "no_attempts" not in name
]


def quick(name):
    method = name.partition(",")[0]
    known = {field.name for field in dataclasses.fields(method_registry().get(method).parameters)}
    usual = {key: value for key, value in QUICK.items() if key in known}
    return usual | QUICKER.get(method, {}) | {**VARIANTS, **STAGES}.get(name, {})


class OwnSuite(PackingMethodSuite):
    """What voxgran's own methods keep beyond what all must."""

    shortened = SHORTENED
    title = ""

    @classmethod
    def shapes(cls):
        box, sphere = super().shapes()
        if cls.method in SPHERES_ONLY:
            return [sphere.scaled(1.4), sphere]
        return [vg.make_shape("sheet", roll=150) if "open surfaces" in cls.title else box, sphere]

    @classmethod
    def container(cls):
        return CONTAINERS.get(cls.method, super().container())

    def test_what_follows_from_the_problem_is_made_without_attempts(self):
        """Before signals are noted, so that a signal ends it at once."""
        task = self.task()
        state = task.method.advance(task.problem, task.method.prepare(task.problem), 0)
        # seeds are drawn, and all that settling needs is made, when the state is
        assert state.derived or self.method == "gravity"

    def check_stops(self, stops):
        can_stop = self.title in ("digital_fill", *STAGES) and self.title != "advancing_front, dense"
        assert stops or not can_stop

    @pytest.mark.slow
    def test_killed_at_twenty_moments_and_resumed_to_the_same_bits(self, tmp_path):
        """SIGKILL over the whole length of a run, while it prepares, walks and writes."""
        task = self.task(count=30)
        whole = task.method.finish(task.problem, drive(task.method, task.problem, Drive()))
        shares = np.random.Generator(np.random.Philox([4, zlib.crc32(self.title.encode())])).uniform(0, 0.4, 20)
        again = self.killed_and_resumed(tmp_path / "run", shares.tolist(), count=30, chunk=None)
        assert bits_of(again) == bits_of(whole)
        assert again.stop_reason == whole.stop_reason


def slowly(test):
    """Return a test that is marked slow, for one class only."""

    @functools.wraps(test)
    def same(*arguments, **options):
        return test(*arguments, **options)

    return pytest.mark.slow(same)


def suite_of(title):
    """Return the class of tests of a method, a variant or a stage."""
    members = {"title": title, "method": title.partition(",")[0], "parameters": quick(title), "__module__": __name__}
    if title not in KILLED:
        killed = slowly(PackingMethodSuite.test_killed_and_resumed_to_the_same_bits)
        members["test_killed_and_resumed_to_the_same_bits"] = killed
    if title in VARIANTS:
        # a checkpoint holds the same as that of the method; the slow test kills these too
        members["test_killed_and_resumed_to_the_same_bits"] = None
    if title == "control_point, one way":
        # a sharp edge may enter another grain between the control points of that
        members |= dict.fromkeys(
            ["test_a_start_stays_in_order_and_goes_on", "test_true_shapes_do_not_overlap_or_escape"]
        )
    if title in RESIZING:
        members |= dict.fromkeys(STAYING)
    if title in STAGES:
        members |= dict.fromkeys(NOT_OF_STAGES) | {"count": 80 if title == "rsa, saturated" else 10}
    return type("Test" + title.title().replace("_", "").replace(", ", "").replace(" ", ""), (OwnSuite,), members)


for name in [*vg.packing_methods(), *VARIANTS, *STAGES]:
    globals()[suite_of(name).__name__] = suite_of(name)
