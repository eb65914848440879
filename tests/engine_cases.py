"""Packings, programs and checks that the tests of all engines share."""

import dataclasses
import functools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import voxgran as vg
from voxgran.decks.engine import engine_registry
from voxgran.decks.engines import kratos
from voxgran.decks.write import described
from voxgran.shapes.spheres import Spheres

#: where `make engines` installs the engines that pip has
ENGINES_VENV = Path(__file__).parents[1] / ".venv-engines"


def falling(packing):
    """Return a packing with gravity downward."""
    return dataclasses.replace(packing, gravity=(0.0, 0.0, -1.0))


def spheres(count=6, *, unit="mm", periodic=False, seed=1):
    """Return a packing of spheres of several diameters."""
    sizes = vg.sizes.uniform(low=0.6, high=1.2)
    box = vg.Box((4, 4, 6), periodic=periodic)
    return falling(vg.pack(vg.make_shape("sphere"), box, "rsa", count=count, sizes=sizes, seed=seed, unit=unit))


def dumbbell():
    """Return a clump of three spheres without any symmetry."""
    geometry = Spheres([[0, 0, 0], [0.45, 0.05, 0], [0.1, 0.35, 0.2]], [0.4, 0.3, 0.25])
    return vg.Shape.of(geometry, name="three spheres")


def mixed(count=8, *, periodic=False, unit="mm", seed=2, container=None):
    """Return a packing of spheres and clumps of several sizes, at random orientations."""
    box = container or vg.Box((5, 5, 7), periodic=periodic)
    sizes = vg.sizes.uniform(low=0.6, high=1.0)
    shapes = [vg.make_shape("sphere"), dumbbell()]
    return falling(vg.pack(shapes, box, "rsa", count=count, sizes=sizes, seed=seed, unit=unit))


def sand_and_steel():
    """Return two materials for `mixed`, with another friction between them, and a floor of the second one."""
    return vg.Materials(
        {"sand": {"friction": 0.6, "stiffness": 1e3}, "steel": {"friction": 0.3, "stiffness": 3e3}},
        pairs={("sand", "steel"): {"friction": 0.15, "rolling_friction": 0.05}},
        shapes=["sand", "steel"],
        walls={"z_low": "steel", "others": "sand"},
    )


def rocks(count=4, *, unit="mm", seed=3):
    """Return a packing of convex and other rocks, which no engine of spheres holds as they are."""
    shapes = [vg.make_shape("convex_polyhedron", seed=1), vg.make_shape("solid_union", seed=2)]
    return falling(vg.pack(shapes, vg.Box((4, 4, 5)), "rsa", count=count, seed=seed, unit=unit))


def two_spheres(*, radii=(0.5, 0.5), gap=0.1, unit="mm"):
    """Return two spheres on a line along x, with a gap between them, in a large box without gravity."""
    reach = sum(radii) + gap
    scale = [2 * radius for radius in radii]
    centers = [[5 - reach / 2, 5, 5], [5 + reach / 2, 5, 5]]
    return vg.Packing.of(
        vg.make_shape("sphere"), vg.Box((10, 10, 10)), position=centers, scale=scale, unit=unit, gravity=None
    )


def simulation_of(packing, engine, **asked):
    """Return the simulation that an engine is given."""
    return described(packing, engine_registry().get(engine), asked.pop("material", None), **asked)[0]


def assert_holds(held, simulation, tolerance=1e-6):
    """Check masses, centroids, inertia tensors and spheres that were read back, each to a relative tolerance."""
    bodies = simulation.bodies
    size = simulation.diameter
    assert len(held.mass) == bodies.count
    np.testing.assert_allclose(held.mass, bodies.mass, rtol=tolerance)
    np.testing.assert_allclose(held.position, bodies.assembly.position, atol=tolerance * size, rtol=0)
    scale = np.abs(bodies.inertia).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(held.inertia / scale, bodies.inertia / scale, atol=tolerance)
    centers, radii, _ = bodies.spheres
    np.testing.assert_allclose(held.centers, centers, atol=tolerance * size, rtol=0)
    np.testing.assert_allclose(held.radii, radii, rtol=tolerance)


def program(name, remedy):
    """Return the path of an engine's program; skip the test where it is not installed."""
    places = [ENGINES_VENV / "bin" / name, Path(sys.executable).parent / name]
    found = next((str(place) for place in places if place.is_file()), shutil.which(name))
    if found is None:
        pytest.skip(f"{name} is not installed: {remedy}")
    return found


@functools.cache
def has_kratos(python):
    """Return whether a Python has Kratos, which takes half a second to load."""
    asked = [python, "-c", "import KratosMultiphysics.DEMApplication"]
    return not subprocess.run(asked, capture_output=True, check=False, timeout=120).returncode


def python_of_kratos():
    """Return the path of a Python that has Kratos; skip the test where there is none."""
    told = os.environ.get("VOXGRAN_ENGINES") or str(ENGINES_VENV / "bin" / "python")
    if not Path(told).is_file():
        pytest.skip("Kratos is not installed: set VOXGRAN_ENGINES to a Python that has it, or run make test-engines")
    if not has_kratos(told):
        pytest.skip(f"Kratos is not installed in {told}: {kratos.INSTALL}")
    return told
