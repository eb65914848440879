"""Lengths of control-point packing against the grains and the container."""

import numpy as np

from voxgran._base.errors import InputError
from voxgran.packing.problem import Problem


def check_distance(problem: Problem) -> None:
    """Refuse a distance that no two grains can keep in the container.

    Raises
    ------
    InputError
        If it is too large.
    """
    distance, (lower, upper) = problem.length(problem.parameters.distance), problem.container.bounds
    if distance == 0.0 or problem.count < 2:
        return
    # two smallest grains in opposite corners; a grain reaches half its volume over its surface at least
    inner = [shape.volume / shape.surface_area for shape in problem.shapes]
    least = float(np.partition(np.array(inner)[problem.shape_id] * problem.diameter, 1)[:2].sum())
    room = float(np.linalg.norm((upper - lower)[: problem.dimension])) - least
    if distance >= room:
        raise InputError(
            f"distance is {distance * problem.unit_length:g}: the container has room for less than "
            f"{room * problem.unit_length:g} between two grains; make it smaller or the container larger"
        )


def check_overlap(problem: Problem) -> None:
    """Refuse an overlap that is as deep as a grain: such grains would no longer be in each other's way.

    Raises
    ------
    InputError
        If it is too deep.
    """
    inner = np.array([shape.volume / shape.surface_area for shape in problem.shapes])
    room = float((inner[problem.shape_id] * problem.diameter).min(initial=np.inf))
    overlap = problem.length(problem.parameters.overlap)
    if overlap > room:
        raise InputError(
            f"overlap is {overlap * problem.unit_length:g}: it must be at most {room * problem.unit_length:g}, the "
            "volume of the thinnest grain over its surface; make it smaller"
        )
