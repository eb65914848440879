"""Grains that arrive one after the other upon a bed, through an inlet or over the whole container."""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.packing.beds.filling import usual_solid_fraction
from voxgran.packing.beds.inlet import column_below
from voxgran.packing.beds.seeds import container_levels
from voxgran.packing.problem import Problem
from voxgran.settling.rain import Rain, speed_of_fall

#: places that are tried for a grain
PLACES = 8
#: how fast the bed below rises where no rate is given, in sqrt(g d)
RISING = 0.3


def rain_of(problem: Problem, up: Floats) -> Rain | None:
    """Return how the grains of a problem arrive; None where they grow from seeds together.

    Raises
    ------
    InputError
        If there is a lid, or :func:`column_below` refuses the inlet.
    """
    settings, container, base = problem.parameters, problem.container, -math.inf
    inlet, column = settings.inlet, None
    if not settings.arrive_singly:
        return None
    if settings.lid is not None:
        raise InputError(
            "lid is given with a fall_height or a rate: grains arrive on a bed without a lid; leave it out, and settle "
            "the bed under a lid then"
        )
    lower, upper = (np.array(corner, dtype=np.float64) for corner in container.bounds)
    if inlet is not None:
        column, base = column_below(inlet, problem, up, np.zeros((0, 4)))
        lower, upper = column.bounds
    flat = np.arange(3) < problem.dimension

    def places(step: int, number: int, radius: float) -> Floats:
        points = lower + (upper - lower) * stream(problem.seed, "rain", number, step).random((4 * PLACES, 3)) * flat
        if column is not None:
            points = points[column.across(points) <= -radius]
        return points[:PLACES]

    rate = None if inlet is None else inlet.rate
    if rate is None:
        floor, top = container_levels(problem.container, up)
        solid = usual_solid_fraction(problem) * (column or container).volume / (top - floor)
        rate = RISING * solid / float(problem.volumes[problem.started :].mean())
    height = 0.0 if settings.fall_height is None else problem.length(settings.fall_height)
    return Rain(speed_of_fall(height), rate, places, base)
