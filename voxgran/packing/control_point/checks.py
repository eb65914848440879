"""Lengths and shapes of control-point packing against what they ask for."""

import numpy as np

from voxgran._base.errors import InputError
from voxgran.packing.problem import Problem

#: least spacing of open surfaces, in diameters of the grain
FINEST = 0.02


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


def check_surfaces(problem: Problem) -> None:
    """Refuse open surfaces where signed distances are asked for.

    Raises
    ------
    InputError
        If grains are compared by signed distances, or the spacing is so fine that the shortest step is too long.
    """
    names = [shape.name for shape in problem.original if shape.is_open]
    settings = problem.parameters
    if names and settings.contact == "sdf":
        raise InputError(
            f"shape {names[0]!r} is an open surface and contact 'sdf': it has no inside and so no signed distance; use "
            "contact 'kdtree'"
        )
    if names and settings.spacing < FINEST:
        raise InputError(
            f"spacing is {settings.spacing:g} and shape {names[0]!r} an open surface: it must be at least {FINEST:g}, "
            "since no step may be longer than points are apart; make it larger"
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
