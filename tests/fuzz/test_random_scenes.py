"""Random small scenes over all methods, containers and families: packed and verified, or refused in a sentence."""

import itertools
import time
import warnings

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import DirtyMeshError, InputError, LongRunWarning, PackingWarning
from voxgran._base.seeds import stream

#: scenes that are run, and the CPU time that one may take; one that is told to take long may take more
SCENES, SECONDS = 200, 180.0
METHODS = vg.packing_methods()
#: depth in diameters by which edges may overlap between control points: half of their spacing
BETWEEN_POINTS = vg.methods.ControlPoint().spacing / 2


class TooLongError(Exception):
    """Raised where a scene takes too long."""


def a_container(draw):
    lengths = draw.uniform(4, 9, 3)
    kind = int(draw.integers(8))
    if kind < 3:
        return vg.Box(np.round(lengths) if kind else lengths, periodic=("", "xy", "xyz")[kind])
    if kind == 3:
        return vg.Cylinder(lengths[0] / 2, lengths[1])
    if kind == 4:
        return vg.Sphere(lengths[0] / 2)
    if kind == 5:
        solid = vg.make_shape("solid_union", seed=int(draw.integers(99)), solids=3)
        return vg.ClosedMesh(solid.scaled(8.0 / np.ptp(solid.vertices, axis=0).max()))
    return vg.Rectangle(lengths[:2]) if kind == 6 else vg.Disk(lengths[0] / 2)


def some_shapes(draw, dimension):
    """Draw one or two closed shapes of unit diameter, of any family of a dimension."""
    found, families = [], vg.shape_families()
    for _ in itertools.repeat(None, 200):
        family = families[int(draw.integers(len(families)))]
        try:
            shape = vg.make_shape(family, seed=int(draw.integers(1000)))
        except InputError:
            # it has a parameter without a default
            continue
        if shape.dimension == dimension and not shape.is_open:
            found.append(shape.scaled(1.0 / shape.diameter))
        if len(found) == 1 + int(draw.integers(2)) or len(found) == 2:
            break
    return found


def some_sizes(draw):
    sigma = float(draw.uniform(0.1, 0.5))
    return (
        None,
        vg.sizes.uniform(0.8, 1.2),
        vg.sizes.lognormal(median=1.0, sigma=sigma, basis=("number", "volume")[int(draw.integers(2))]),
        vg.sizes.discrete([0.5, 1.0, 1.4], [1, 1, 1]),
    )[int(draw.integers(4))]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(SCENES))
def test_a_random_scene_is_packed_or_refused(seed, record_property):
    draw = stream(seed, "random scene").spawn(1)[0]
    method, container = METHODS[seed % len(METHODS)], a_container(draw)
    shapes, sizes = some_shapes(draw, container.dimension), some_sizes(draw)
    amount = {"count": int(draw.integers(3, 41))}
    if draw.random() < 0.4:
        amount = {"solid_fraction": float(draw.uniform(0.05, 0.4))}
    names = ", ".join(shape.name for shape in shapes)
    scene = f"scene {seed}: {method} of {names} in {container}, sizes {sizes}, {amount}"
    began = time.process_time()

    def look(_):
        """Stop a scene that takes too long."""
        if time.process_time() - began > SECONDS:
            raise TooLongError

    with warnings.catch_warnings(record=True, action="ignore", category=PackingWarning) as told:
        warnings.simplefilter("always", LongRunWarning)
        try:
            packing = vg.pack(shapes, container, method, seed=seed, sizes=sizes, on_step=look, **amount)
        except DirtyMeshError:
            raise
        except InputError:
            return
        except TooLongError:
            packing = None
    spent = time.process_time() - began
    record_property("cpu_seconds", spent)
    assert told or spent <= SECONDS, f"{spent:.0f} CPU seconds and no word of it before: {scene}"
    if packing is None:
        return
    proof = vg.verify(packing, tolerance=1e-9)
    sizes = packing.diameters
    allowed = BETWEEN_POINTS * sizes.max() / sizes.mean() if method == "control_point" and packing.count else 0.0
    assert proof.ok or max(proof.deepest, proof.largest_escape) <= allowed, f"{scene}: {proof}"
