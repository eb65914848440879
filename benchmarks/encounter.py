"""First contact of two grains: how far one comes towards the other before a test of contact refuses it.

This is what the tests of contact of control-point packing are measured by: the offset at which they say "too near"
against the one at which the true surfaces touch.
"""

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, as_floats
from voxgran._base.errors import InputError
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kinds.box import Box
from voxgran.geometry.rotation import normalized, write_matrix
from voxgran.packing.control_point.method import prepare
from voxgran.packing.control_point.neighbours import overlaps
from voxgran.packing.control_point.parameters import ControlPoint
from voxgran.packing.control_point.precompute import pairs_of, precomputed_of
from voxgran.packing.control_point.records import HALF_SPACING, HALF_THICKNESS, SDF, Pairs
from voxgran.packing.control_point.sdf_contact import threshold
from voxgran.packing.problem import Problem
from voxgran.shapes.model import Shape

#: halvings of the way on which contact is found
HALVINGS = 60


class Encounter:
    """Two grains and a test of contact between them.

    Parameters
    ----------
    standing, coming : Shape
        The grains; where both have a unit, the second is converted to that of the first.
    contact, ways, spacing, distance
        As in the parameters of the method ``control_point``; the distance in the unit of lengths.
    seed : int
        Seed of the control points.

    Raises
    ------
    InputError
        If a parameter is out of its range.
    """

    def __init__(
        self,
        standing: Shape,
        coming: Shape,
        *,
        contact: str = "sdf",
        ways: str = "both",
        spacing: float = 0.12,
        distance: float = 0.0,
        seed: int = 0,
    ) -> None:
        if standing.unit is not None and coming.unit is not None:
            coming = coming.to_unit(standing.unit)
        self._unit = unit = max(standing.diameter, coming.diameter)
        wide = 8.0 * (standing.bounding_radius + coming.bounding_radius) / unit + 4.0
        settings = ControlPoint(contact=contact, tested_points=ways, spacing=spacing, distance=distance)  # type: ignore[arg-type]
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
        self._state = prepare(problem)
        self._pairs = pairs_of(problem, self._state, precomputed_of(problem, self._state))

    @property
    def points(self) -> tuple[int, int]:
        """Control points of the standing grain and of the other."""
        one, other = np.diff(self._pairs.bodies.trees.start).tolist()
        return one, other

    @property
    def allowance(self) -> float:
        """By how much points are kept from the other surface, so that what bulges between them does not overlap; of
        points that are compared with points, how near these may come. In the unit of lengths.
        """
        extent = self._pairs.grains.extent
        if self._pairs.bodies.contact != SDF:
            return self._unit * float(extent[:, HALF_SPACING].sum())
        return self._unit * float(min(threshold(extent, 0, 1, 0.0), threshold(extent, 1, 0, 0.0)))

    def is_refused(self, offset: "ArrayLike", turns: "ArrayLike") -> bool:
        """Return whether the test refuses a pose.

        Parameters
        ----------
        offset : (3,) array_like of float
            From the centroid of the standing grain to that of the other, in the unit of lengths.
        turns : (2, 4) array_like of float
            Orientations of the two, unit quaternions (w, x, y, z).

        Raises
        ------
        InputError
            If an array has another shape or is not finite.
        """
        self._turn(turns)
        where = as_floats(offset, "offset", shape=(3,)) / self._unit
        return bool(_is_refused_at(self._pairs, np.zeros(3), where, 0.0))

    def _turn(self, turns: "ArrayLike") -> None:
        """Take over orientations."""
        quaternions = normalized(as_floats(turns, "turns", shape=(2, 4)))
        self._state.orientation[:] = quaternions
        write_matrix(quaternions[1], self._pairs.scratch.turn)

    def first_contact(
        self,
        direction: "ArrayLike",
        *,
        turns: "ArrayLike" = ((1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        aside: "ArrayLike" = (0.0, 0.0, 0.0),
    ) -> Floats:
        """Let the other grain come straight towards the standing one until the test refuses it.

        Parameters
        ----------
        direction : (3,) array_like of float
            From which side it comes: it moves against this direction; of any length.
        turns : (2, 4) array_like of float
            Orientations of the two, unit quaternions (w, x, y, z).
        aside : (3,) array_like of float
            By how much the line of the coming centroid passes the standing one, in the unit of lengths.

        Returns
        -------
        (3,) ndarray of float
            From the centroid of the standing grain to that of the other, at the last place that was not refused.

        Raises
        ------
        InputError
            If the direction has no length, or the grains do not meet on this way.
        """
        way, beside = as_floats(direction, "direction", shape=(3,)), as_floats(aside, "aside", shape=(3,))
        length = float(linear.norm(way))
        if length == 0.0:
            raise InputError("direction is (0, 0, 0): a grain comes from somewhere; give a vector with a length")
        self._turn(turns)
        extent = self._pairs.grains.extent
        far = float(extent[:, :2].sum()) + self._pairs.gap + 1e-3
        step = 0.25 * float(extent[:, HALF_THICKNESS].min())
        place = _come(self._pairs, way / length, beside / self._unit, far, step)
        if place <= -far:
            raise InputError(f"aside is {beside.tolist()}: the grains pass each other on this way; bring them nearer")
        return np.asarray(self._unit * place * way / length + beside)


@bare_kernel
def _come(pairs: Pairs, way: Floats, aside: Floats, far: float, step: float) -> float:
    """Return the place along a way at which the second grain is first refused; where it never is, the far end."""
    free, place = far, far
    while place > -far:
        place = max(place - step, -far)
        if _is_refused_at(pairs, way, aside, place):
            break
        free = place
    if free <= -far:
        return -far
    for _ in range(HALVINGS):
        middle = 0.5 * (free + place)
        if _is_refused_at(pairs, way, aside, middle):
            place = middle
        else:
            free = middle
    return free


@bare_kernel
def _is_refused_at(pairs, way, aside, place):  # type: ignore[no-untyped-def]
    """Return whether the second grain meets the first at a place along its way."""
    offset = (place * way[0] + aside[0], place * way[1] + aside[1], place * way[2] + aside[2])
    return overlaps(pairs, 1, 0, offset, np.inf)
