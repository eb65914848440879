"""Grains that arrive one after the other, at a rate in time, with the velocity of a fall.

Each begins above the surface of the bed at a place of its own, with the velocity that it has after falling from the
fall height; it meets the bed, moves on and may move others, while the next ones arrive. Lengths are in median
diameters, times in sqrt(d / g).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran.contacts.manifolds.rows import PUSH
from voxgran.containers.model import periods_of
from voxgran.geometry.periods import nearest_turns
from voxgran.settling.bed import Bed
from voxgran.settling.impulses import STEP, Fall

#: distance of a grain that arrives from what it will meet, and of the levels at which it is tried
CLEAR, LEVELS = 0.05, 0.25
#: units of time after which no further grain arrives if none has found room since
PATIENCE = 10.0
#: velocity below which a grain lies still: less than it gains in the first step of its fall
STILL = 0.02
#: by how much grains may become faster within a step
FASTER = 1.25


@dataclass(frozen=True, slots=True)
class Rain:
    """How grains arrive.

    Parameters
    ----------
    speed : float
        Velocity with which they arrive.
    rate : float
        How many arrive in a unit of time.
    places : callable
        Numbers of a step and of a grain, and its bounding radius, to points (k, 3) above or below which it may arrive,
        the first ones preferred.
    level : float
        Level, against gravity, below which no grain begins.
    """

    speed: float
    rate: float
    places: Callable[[int, int, float], Floats]
    level: float


def speed_of_fall(height: float) -> float:
    """Return the velocity after a fall from a height, without resistance."""
    return math.sqrt(2.0 * height)


def steps_of_rain(rain: Rain, many: int, fall: Fall) -> int:
    """Return in how many steps about so many grains arrive."""
    return math.ceil(many / (rain.rate * _step(rain.speed, fall)))


def _step(speed: float, fall: Fall) -> float:
    """Return a step in which grains of a speed move no farther than grains may, though impacts make some faster."""
    return min(STEP, fall.most / (FASTER * speed + STEP))


def let_arrive(bed: Bed, rain: Rain, fall: Fall, progress: Any) -> tuple[Fall, bool]:
    """Let the grains arrive that are due; return how the next step is made, and whether it is the last one.

    progress: `stage_step`, and `owed` and `waited`, which are updated. The step is so short that no grain moves farther
    than grains may; it is the last one where no grain is held back any more, or none finds room, and all are slow.
    """
    came = _admit_grains(bed, rain, int(progress.owed), progress.stage_step)
    speed = math.sqrt(float((bed.bodies[: bed.count, :3] ** 2).sum(axis=1).max(initial=0.0)))
    step = _step(speed, fall)
    # what finds no room comes as soon as it does, and no faster than the rate
    progress.owed = min(progress.owed - came, 1.0) + rain.rate * step
    progress.waited = 0.0 if came else progress.waited + step
    full = bed.count == bed.assembly.count or progress.waited > PATIENCE + 1.0 / rain.rate
    return fall._replace(step=step), full and (step == STEP or not bed.count)


def _admit_grains(bed: Bed, rain: Rain, many: int, step: int) -> int:
    """Let up to `many` further grains arrive, as long as they find room; return how many have."""
    first, found, radii = bed.count, list[Floats](), bed.assembly.bounding_radii
    # the bed is what pushes or does not move; all else flies
    lies = linear.norm(bed.bodies[:first, :3], axis=1) < STILL
    pushing = bed.rows.row[: bed.m, PUSH] > 0.0
    lies[bed.rows.i[: bed.m][pushing]] = True
    partner = bed.rows.j[: bed.m][pushing]
    lies[partner[(partner >= 0) & (partner < bed.count)]] = True
    spheres = np.column_stack([bed.grains.position, bed.grains.radius, lies])
    for k in range(first, min(first + many, bed.assembly.count)):
        center = _arrival(bed, rain.places(step, k, radii[k]), radii[k], spheres, rain.level)
        if center is None:
            break
        found.append(center)
        spheres = np.vstack([spheres, [*center, radii[k], 0.0]])
    if found:
        bed.admit(np.array(found), rain.speed * bed.gravity)
    return len(found)


def _arrival(bed: Bed, places: Floats, radius: float, spheres: Floats, level: float) -> Floats | None:
    """Return where a sphere begins: upon the bed and the walls below the first of the places (k, 3) with room.

    spheres: (n, 5) centers and radii, and whether they are of the bed.  None if there is no room at any place.
    """
    up, container = -bed.gravity, bed.assembly.container
    lower, upper = (np.asarray(corner, dtype=np.float64) for corner in container.bounds)
    periods = periods_of(container)
    floor, top = (float(ends.sum()) for ends in np.sort([lower * up, upper * up], axis=0))
    for place in places:
        offset = spheres[:, :3] - place
        offset -= linear.matmul(nearest_turns(offset, periods), periods)
        along = linear.matmul(offset, up)
        # half the length of the line through the place on which the sphere would meet each of the others
        half = np.sqrt(np.maximum((spheres[:, 3] + radius) ** 2 - (offset**2).sum(axis=1) + along**2, 0.0))
        met = (half > 0.0) & (spheres[:, 4] > 0.0)
        surface = float((along + half)[met].max(initial=-math.inf)) + linear.matmul(place, up)
        start = max(surface, floor + radius, level) + CLEAR
        levels = np.arange(start, max(top - radius, start) + LEVELS, LEVELS)
        points = place + (levels - linear.matmul(place, up))[:, None] * up
        inside = np.asarray(container.signed_distance(points)) <= -radius
        if not inside.any():
            continue
        # of what lies within the walls the highest part, which is open to what falls into the container
        last = len(inside) - 1 - int(np.argmax(inside[::-1]))
        below = np.flatnonzero(~inside[:last])
        begin = below[-1] + 1 if len(below) else 0
        if (np.abs(along - (levels[begin] - linear.matmul(place, up))) >= half).all():
            return np.asarray(points[begin])
    return None
