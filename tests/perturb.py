"""Pytest plug-in: `--perturb SEED` moves every start of a packing, settling and compression by about 1e-12 d.

A run of grains that push each other enlarges a difference in the last bits until another bed results, as good as the
first one. A test that passes without this option and fails with it rests on one outcome of such a run.

Each grain is moved by a pseudo-random vector that follows from the seed and the bits of its place: two runs from one
start agree, and so does one that goes on from a checkpoint. Fixed grains stay. Modules are changed as they are
imported, here and in the processes that tests start; none is imported for this. These processes import this file
before pytest can rewrite it (PYTEST_DONT_REWRITE).
"""

import importlib.machinery
import os
import sys
import tempfile
from dataclasses import replace
from functools import wraps
from pathlib import Path

#: largest displacement along an axis, in median diameters: four digits above rounding, three below what `verify` allows
FAR = 1e-12
#: the seed, and the file that takes a line for each start that is moved, as the processes of tests are told of them
SEED, LOG = "VOXGRAN_TESTS_PERTURB", "VOXGRAN_TESTS_PERTURBED"
#: what a process of a test does first
AT_START = f"import sys\nsys.path.append({os.path.dirname(__file__)!r})\nimport perturb\nperturb.watch()\n"


def shares(values):
    """Return pseudo-random numbers from -1 to 1 for rows (n, k) of numbers, by their bits and the seed."""
    import numpy as np

    words = np.ascontiguousarray(values, dtype=np.float64).view(np.uint64)
    mixed = np.full(len(words), int(os.environ[SEED]), dtype=np.uint64)
    found = np.zeros(words.shape)
    for k in (*range(words.shape[1]), *range(words.shape[1])):
        # the steps of splitmix64, over all words of a row and then once more for each number
        mixed = (mixed ^ words[:, k]) + np.uint64(0x9E3779B97F4A7C15)
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed ^= mixed >> np.uint64(31)
        found[:, k] = (mixed >> np.uint64(11)) / 2.0**52 - 1.0
    if len(words) and LOG in os.environ:
        with open(os.environ[LOG], "a") as file:
            file.write(os.environ.get("PYTEST_CURRENT_TEST", "").split("::")[0] + "\n")
    return found


def _gone(assembly, position):
    """Return by how much grains of an assembly are moved from their places (n, 3), in the plane within it."""
    return FAR * shares(position) * ([1.0, 1.0, 1.0] if assembly.dimension == 3 else [1.0, 1.0, 0.0])


def moved(assembly):
    """Return grains, with lengths in median diameters, of which those that are not fixed are moved."""
    free = assembly.movable[:, None]
    return replace(assembly, position=assembly.position + free * _gone(assembly, assembly.position))


def _begin_moved(kind):
    """Let the objects of a class that are made of grains begin with these moved."""
    first = kind.__init__

    @wraps(first)
    def begin(self, assembly, *arguments, **keywords):
        first(self, moved(assembly), *arguments, **keywords)

    kind.__init__ = begin


def _settler(module):
    _begin_moved(module.Settler)


def _compressor(module):
    _begin_moved(module.Compressor)


def _soft_spheres(module):
    _begin_moved(module.SoftSpheres)


def _growing_solids(module):
    _begin_moved(module.GrowingSolids)


def _arriving(module):
    """Move the grains that fall upon a bed one after the other."""
    admit = module.Bed.admit

    def admitted(self, position, velocity):
        admit(self, position + _gone(self.assembly, position), velocity)

    module.Bed.admit = admitted


def _front(module):
    """Move the place where a front begins."""
    made = module.front_container

    def container(given, smallest):
        walls, widest = made(given, smallest)
        # less than the slack of walls between which a sphere just fits
        return walls, widest + 0.01 * FAR * shares(widest[None])[0] * (widest != 0.0)

    module.front_container = container


def _deposition(module):
    """Move the walls between which grains are dropped inward."""
    field = module.Field

    def made(spheres, cells, lengths, *others):
        return field(spheres, cells, lengths - FAR * abs(shares(lengths[None])[0]) * (lengths > 0.0), *others)

    module.Field = made


def _walk(module):
    """Shorten the steps of grains that walk, which follow from their sizes."""
    poses = module.GrainPoses

    def made(position, orientation, placed, step, shape, diameter, *others):
        smaller = diameter * (1.0 - FAR * abs(shares(diameter[:, None])[:, 0]))
        return poses(position, orientation, placed, step, shape, smaller, *others)

    module.GrainPoses = made


#: what is done to a module once it is imported; other methods draw places and never move a grain
WATCHED = {
    "voxgran.settling.stages": _settler,
    "voxgran.settling.compression": _compressor,
    "voxgran.settling.bed": _arriving,
    "voxgran.packing.jamming.spheres": _soft_spheres,
    "voxgran.packing.jamming.solids": _growing_solids,
    "voxgran.packing.advancing_front.method": _front,
    "voxgran.packing.deposition.method": _deposition,
    "voxgran.packing.control_point.precompute": _walk,
}


class Watcher:
    """Finder of the modules that are watched, for `sys.meta_path`."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        if name not in WATCHED:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        run = spec.loader.exec_module

        def executed(module):
            run(module)
            WATCHED[name](module)

        spec.loader.exec_module = executed
        return spec


def watch():
    """Change the modules that are watched: those that are imported now, and the others when they are."""
    sys.meta_path.insert(0, Watcher)
    for name in WATCHED.keys() & sys.modules.keys():
        WATCHED[name](sys.modules[name])


def pytest_addoption(parser):
    group = parser.getgroup("voxgran")
    group.addoption("--perturb", type=int, metavar="SEED", help="move every start of a run of grains by 1e-12 d")
    group.addoption("--perturbed", metavar="FILE", help="write the test files to it in which a start was moved")


def pytest_configure(config):
    seed, log = config.getoption("perturb"), config.getoption("perturbed")
    if seed is None:
        return
    os.environ[SEED] = str(seed)
    if log is not None:
        os.environ[LOG] = os.path.abspath(log)
    # processes that tests start: by the environment, or by the path of this one
    folder = tempfile.TemporaryDirectory()
    config.add_cleanup(folder.cleanup)
    (Path(folder.name) / "sitecustomize.py").write_text(AT_START)
    sys.path.append(folder.name)
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (folder.name, os.environ.get("PYTHONPATH"))))
    watch()


def pytest_collection_modifyitems(config, items):
    if config.getoption("perturb") is None:
        return
    import pytest

    for item in items:
        if mark := item.get_closest_marker("exact_start"):
            item.add_marker(pytest.mark.skip(reason=f"--perturb: {mark.args[0]}"))


def pytest_unconfigure(config):
    log = config.getoption("perturbed")
    if log is not None and not hasattr(config, "workerinput") and os.path.exists(log):
        with open(log) as file:
            names = sorted({*file.read().split()})
        with open(log, "w") as file:
            file.writelines(f"{name}\n" for name in names)
