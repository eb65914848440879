"""First contact of two grains: how far one comes towards the other before a test of contact refuses it.

This is what the tests of contact of control-point packing are measured by: the offset at which they say "too near"
against the one at which the true surfaces touch.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, as_floats
from voxgran._base.errors import InputError
from voxgran._base.kernels import bare_kernel
from voxgran._base.rotation import normalized
from voxgran.containers.box import Box
from voxgran.packing.control_near import compare
from voxgran.packing.control_records import Bed, Bodies, Memory, Scratch
from voxgran.packing.control_setting import bed_of, setting_of
from voxgran.packing.field_contacts import threshold
from voxgran.packing.methods.control_point import ControlPoint, prepare
from voxgran.packing.poses import write_matrix
from voxgran.packing.problem import Problem
from voxgran.shapes.model import Shape

#: halvings of the way on which contact is found
HALVINGS = 60


@dataclass(frozen=True, slots=True)
class Approach:
    """Where one grain is when it first meets another, which stands at the origin.

    Attributes
    ----------
    offset : (3,) ndarray of float
        From the centroid of the standing grain to that of the other, in the unit of lengths.
    allowance : float
        By how much the test keeps points from the other surface, so that what bulges between them does not overlap.
    points : tuple of int
        Control points of the standing grain and of the other.
    """

    offset: Floats
    allowance: float
    points: tuple[int, int]


def first_contact(
    standing: Shape,
    coming: Shape,
    direction: ArrayLike,
    *,
    turns: ArrayLike = ((1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
    aside: ArrayLike = (0.0, 0.0, 0.0),
    contact: str = "sdf",
    ways: str = "both",
    spacing: float = 0.12,
    distance: float = 0.0,
    seed: int = 0,
) -> Approach:
    """Let a grain come straight towards another until a test of contact refuses it.

    Parameters
    ----------
    standing, coming : Shape
        The grains.
    direction : (3,) array_like of float
        From which side the other comes: it moves against this direction; of any length.
    turns : (2, 4) array_like of float
        Orientations of the two, unit quaternions (w, x, y, z).
    aside : (3,) array_like of float
        By how much the line of the coming centroid passes the standing one, in the unit of lengths.
    contact, ways, spacing, distance
        As in the parameters of the method ``control_point``; the distance in the unit of lengths.
    seed : int
        Seed of the control points.

    Returns
    -------
    Approach

    Raises
    ------
    InputError
        If a parameter is out of its range, the direction has no length, or the grains do not meet on this way.
    """
    way, beside = as_floats(direction, "direction", shape=(3,)), as_floats(aside, "aside", shape=(3,))
    length = float(np.linalg.norm(way))
    if length == 0.0:
        raise InputError("direction is (0, 0, 0): a grain comes from somewhere; give a vector with a length")
    quaternions = normalized(as_floats(turns, "turns", shape=(2, 4)))
    unit = max(standing.diameter, coming.diameter)
    wide = 8.0 * (standing.bounding_radius + coming.bounding_radius) / unit + 4.0
    settings = ControlPoint(contact=contact, ways=ways, spacing=spacing, distance=distance)  # type: ignore[arg-type]
    problem = Problem(
        shapes=tuple(shape.scaled(1 / shape.diameter) for shape in (standing, coming)),
        shape_id=np.arange(2),
        diameter=np.array([standing.diameter, coming.diameter]) / unit,
        container=Box((wide, wide, wide)),
        parameters=settings,
        seed=seed,
        unit_length=unit,
        original=(standing, coming),
    )
    state = prepare(problem)
    state.arrays["orientation"][:] = quaternions
    setting, gap = setting_of(problem, state), problem.length(distance)
    setting.scratch.quaternion[:] = quaternions[1]
    bed, far = bed_of(problem, state, setting), float(setting.extent[:, :2].sum()) + gap + 1e-3
    step = 0.25 * float(setting.extent[:, 2].min())
    kept = (bed, setting.bodies, setting.memory, setting.scratch)
    place = _come(*kept, gap, way / length, beside / unit, far, step)
    if place <= -far:
        raise InputError(f"aside is {beside.tolist()}: the grains pass each other on this way; bring them nearer")
    extent, counts = setting.extent, np.diff(setting.bodies.trees.start).tolist()
    kept_apart = min(threshold(extent, 0, 1, 0.0), threshold(extent, 1, 0, 0.0)) if contact == "sdf" else 0.0
    if contact != "sdf":
        kept_apart = float(extent[:, 1].sum())
    return Approach(unit * place * way / length + beside, unit * kept_apart, (counts[0], counts[1]))


@bare_kernel
def _come(
    bed: Bed,
    bodies: Bodies,
    memory: Memory,
    scratch: Scratch,
    gap: float,
    way: Floats,
    aside: Floats,
    far: float,
    step: float,
) -> float:
    """Return the place along a way at which the second grain is first refused; where it never is, the far end."""
    write_matrix(scratch.quaternion, scratch.turn)
    free, place = far, far
    while place > -far:
        place = max(place - step, -far)
        if _is_refused_at(bed, bodies, memory, scratch, gap, way, aside, place):
            break
        free = place
    if free <= -far:
        return -far
    for _ in range(HALVINGS):
        middle = 0.5 * (free + place)
        if _is_refused_at(bed, bodies, memory, scratch, gap, way, aside, middle):
            place = middle
        else:
            free = middle
    return free


@bare_kernel
def _is_refused_at(bed, bodies, memory, scratch, gap, way, aside, place):  # type: ignore[no-untyped-def]
    """Tell whether the second grain meets the first at a place along its way."""
    dx, dy, dz = place * way[0] + aside[0], place * way[1] + aside[1], place * way[2] + aside[2]
    return compare(bed, bodies, memory, scratch, 1, 0, gap, dx, dy, dz, np.inf)
