"""What the tests stand on: starts that are moved, and what is told of tests that are skipped."""

import importlib
import importlib.util
import sys

import numpy as np
import perturb
import pytest
from kit import wanted

import voxgran as vg
from voxgran.contacts.assembly import Assembly
from voxgran.settling.parameters import Settling

SPHERE = vg.make_shape("sphere")


@pytest.fixture
def seed(monkeypatch):
    """Return what sets the seed of the displacements."""
    monkeypatch.delenv(perturb.LOG, raising=False)
    return lambda number: monkeypatch.setenv(perturb.SEED, str(number))


def grains(count=20, **more):
    points = np.random.default_rng(1).random((count, 3)) * 9
    return Assembly.of([SPHERE], vg.Box((9, 9, 9)), position=points, **more)


def test_each_grain_is_moved_by_rounding_as_its_place_and_the_seed_say(seed):
    given, gone = grains(), {}
    for number in (1, 2):
        seed(number)
        gone[number] = perturb.moved(given).position - given.position
        assert np.array_equal(perturb.moved(given).position - given.position, gone[number])
        # those of other grains do not matter
        part = Assembly.of([SPHERE], given.container, position=given.position[7:9])
        assert np.array_equal(perturb.moved(part).position - part.position, gone[number][7:9])
        assert 0.4e-12 < np.abs(gone[number]).mean() < 0.6e-12
        assert np.abs(gone[number]).max() < 1.1e-12
    assert (gone[1] != gone[2]).mean() > 0.9


def test_fixed_grains_and_those_of_the_plane_stay_where_they_are(seed):
    seed(1)
    given = grains()
    fixed = perturb.replace(given, fixed=np.arange(20) < 5)
    assert ((perturb.moved(fixed).position == given.position).all(axis=1) == fixed.fixed).all()
    flat = Assembly.of([vg.make_shape("disk")], vg.Rectangle((9, 9)), position=[(3, 3, 0), (6, 6, 0)])
    assert (perturb.moved(flat).position[:, 2] == 0.0).all()


@pytest.mark.parametrize("name", perturb.WATCHED)
def test_every_place_where_starts_are_moved_is_there(name):
    standing = importlib.import_module(name)
    spec = perturb.Watcher.find_spec(name, importlib.import_module(name.rpartition(".")[0]).__path__)
    copy = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(copy)
    changed = [key for key, value in vars(copy).items() if getattr(value, "__module__", "") == "perturb"]
    begun = [key for key, value in vars(copy).items() if hasattr(getattr(value, "__init__", None), "__wrapped__")]
    assert sys.modules[name] is standing
    assert changed or begun or copy.Bed.admit.__module__ == "perturb"


def test_a_bed_begins_with_moved_grains(seed):
    name = "voxgran.settling.stages"
    spec = perturb.Watcher.find_spec(name, importlib.import_module("voxgran.settling").__path__)
    stages = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(stages)
    seed(3)
    given = grains()
    bed = stages.Settler(given, Settling(), np.array([0.0, 0.0, -1.0])).bed
    gone = bed.in_order(bed.grains.position) - given.position
    assert 0.0 < np.abs(gone).max() < 1.1e-12


def test_what_tests_are_skipped_for_is_counted():
    reasons = ["Skipped: yade is not installed: make test-engines", "Skipped: could not import 'trame.app': No module"]
    assert wanted([*reasons, reasons[0], "Skipped: only root can mount a small disk"]) == [("yade", 2), ("trame", 1)]
