"""Random Apollonian packing of true shapes: a random point gets the largest copy of a shape that fits there.

Each copy has a random orientation, or the one that is asked for. It may be moved away from what it touches while it
grows (`shift`), and, from a random orientation, rotated to where it can grow further (`rotate`): each try rotates the
best orientation by a random angle about a random axis, and is kept if the grain becomes larger. The range of the angles
widens with each success and narrows with each failure.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers, Words
from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.seeds import philox_block, unit_float
from voxgran.contacts.overlap.true_shapes import inner_radius, part_count, true_shapes
from voxgran.containers.kernel_container import kernel_container
from voxgran.geometry.rotation import draw_quaternion, write_matrix
from voxgran.packing.method import State
from voxgran.packing.problem import Problem
from voxgran.packing.space_filling.largest_scale import Surroundings, fits, largest_scale
from voxgran.packing.space_filling.reach_cells import cells_with, list_sphere, with_room, wrapped

#: relative growth that counts
GAIN = 1e-9
#: factors on the range of the angles after a try that succeeded and one that failed
WIDER, NARROWER = 1.5, 0.85
#: moves that are tried along a direction, and the first one, in scales
MOVES, FIRST = 24, 0.25
#: numbers of the random blocks of an attempt: orientation, and the first try of a rotation
FIRST_TRY = 2
#: attempts in a row that find no place, after which the container is full
PATIENCE = 5_000
#: measured seconds of a grain, and of a power of the number of its parts; shares of them for each move and rotation,
#: and how many times as long a grain takes on the average where attempts go on until few find room for the smallest
GRAIN_SECONDS, PART_SECONDS, PART_POWER = 1e-4, 4e-5, 0.75
MOVE_SHARE, ROTATION_SHARE, PATIENT_SHARE = 4.5, 0.3, 13.0
#: measured number of grains of the smallest size whose volume is that of the container, for each grain that is made
GRAINS_OF_ROOM = 6.0
#: number of grains after which the number is expected that a solid fraction takes, and least share of the volume left
LOOKED, SMALLEST_LEFT = 200, 1e-9
#: what is counted: grains placed, attempts in a row without a place
PLACED, MISSED = 0, 1
#: how a part of a run ends: attempts made or container full, solid fraction reached, no room for entries
MADE, REACHED, NO_ROOM = 0, 1, 2


class GrowthRules(NamedTuple):
    """How large grains become, at scale or radius 1 and in these units.

    volume: of each shape, or each grain, at unit size.  limits: (4,) smallest and largest size, factor on the largest
    one that fits, and volume that is asked for.  shift, rotate: moves and rotations that are tried.
    """

    volume: Floats
    limits: Floats
    shift: int
    rotate: int


@dataclass(slots=True)
class PrecomputedShapes:
    """What follows from the problem and the placed grains of true shapes."""

    around: Surroundings
    rules: GrowthRules  # volumes of the shapes at scale 1, and limits of the scale


def precompute_shapes(problem: Problem, state: State, limits: Floats) -> PrecomputedShapes:
    """Return tables of the shapes, cells with the placed grains in them, volumes and limits."""
    n, shapes, arrays = problem.count, problem.shapes, state.arrays
    walls = kernel_container(problem.container, from_corner=True)
    tables = true_shapes(shapes, problem.container, problem.shape_id, np.zeros(n), np.zeros(n))
    tables = tables._replace(scale=arrays["diameter"], orientation=arrays["orientation"])
    tables.turns[:] *= problem.orientation is None
    cells = cells_with(walls, n, arrays["spheres"][: arrays["tally"][PLACED]])
    volume = np.array([shape.volume for shape in shapes])
    core = np.array([inner_radius(shape) for shape in shapes])
    cores = arrays["spheres"].copy()
    cores[:, 3] = arrays["diameter"] * core[problem.shape_id]
    longest = (problem.container.volume / volume) ** (1.0 / problem.dimension)
    parts, period = np.diff(tables.first[: len(shapes) + 1, 0]), np.where(walls.periodic, walls.lengths, np.inf).min()
    longest = np.where(parts > 1, np.minimum(longest, 0.5 * period / tables.bounding), longest)
    seen, searches = np.zeros(n, dtype=np.int64), np.zeros(1, dtype=np.int64)
    around = Surroundings(
        walls, cells, tables, arrays["spheres"], cores, core, longest, seen, searches, np.zeros(3)
    )  # fmt: skip
    rules = GrowthRules(volume, limits, problem.parameters.shift, problem.parameters.rotate)
    return PrecomputedShapes(around, rules)


def advance_shapes(problem: Problem, state: State, made: PrecomputedShapes, key: Words, last: int) -> int:
    """Make attempts up to number `last`; return how they end."""
    end = NO_ROOM
    while end == NO_ROOM:
        run = (key, state.arrays["tally"], state.arrays["volume"], state.done, last)
        done, end = put_shapes(made.around, made.rules, *run)
        state.done = int(done)
        if end == NO_ROOM:
            made.around = made.around._replace(cells=with_room(made.around.cells))
    return int(end)


def expected_seconds(problem: Problem, smallest: float) -> float:
    """Return the expected CPU time of a run that ends by its count or its smallest diameter."""
    seconds = problem.count * _grain_seconds(problem)
    if smallest > 0.0:
        most = problem.container.volume / smallest**problem.dimension / GRAINS_OF_ROOM
        seconds *= min(1.0, PATIENT_SHARE * most / max(problem.count, 1))
    return seconds


def seconds_of_fraction(problem: Problem, scale: Floats, asked: float) -> float:
    """Return the expected CPU time in which a run of which the first grains are known has the volume that is asked for.

    The volume that is left falls as a power of the number of grains, here from a quarter of the first grains to all.
    """
    volume = np.array([shape.volume for shape in problem.shapes])[problem.shape_id[: len(scale)]]
    left = problem.container.volume - np.cumsum(volume * libm.power(scale, problem.dimension))
    end = (left[problem.started - 1] if problem.started else problem.container.volume) - asked
    fall = math.log(left[-1] / max(end, SMALLEST_LEFT * left[-1])) / math.log(left[len(left) // 4] / left[-1])
    return min(len(left) * 4.0 ** min(fall, 99.0), problem.count) * _grain_seconds(problem)


def _grain_seconds(problem: Problem) -> float:
    """Return the expected CPU time of a grain."""
    parts, settings = max(part_count(shape) for shape in problem.shapes), problem.parameters
    moves = 1.0 + MOVE_SHARE * settings.shift + ROTATION_SHARE * settings.rotate
    return (GRAIN_SECONDS + PART_SECONDS * libm.power(parts - 1.0, PART_POWER)) * moves


@kernel
def put_shapes(
    around: Surroundings, rules: GrowthRules, key: Words, tally: Integers, filled: Floats, done: int, last: int,
) -> tuple[int, int]:  # fmt: skip
    """Make attempts up to number `last`; return the number after the last that was made, and how this part ends.

    filled: (1,) volume of the grains that were placed.
    """
    walls, shapes, limits, volume, place = around.walls, around.shapes, rules.limits, rules.volume, np.zeros(4)
    while done < last and tally[PLACED] < len(around.spheres) and tally[MISSED] < PATIENCE:
        n, words = tally[PLACED], philox_block(key[0], key[1], np.uint64(done), np.uint64(0))
        s = shapes.shape[n]
        place[0] = unit_float(words[0]) * walls.lengths[0]
        place[1] = unit_float(words[1]) * walls.lengths[1]
        place[2] = unit_float(words[2]) * walls.lengths[2] if walls.dimension == 3 else 0.0
        _grow_at(around, rules, n, place, key, done)
        f = place[3] * limits[2]
        added, reached = volume[s] * f**walls.dimension, False
        if f > 0.0 and filled[0] + added >= limits[3]:
            # the last grain is made smaller, so that the solid fraction is met exactly
            added, reached = limits[3] - filled[0], True
            f = (added / volume[s]) ** (1.0 / walls.dimension)
        if f <= 0.0 or place[3] * limits[2] < limits[0]:
            tally[MISSED] += 1
            done += 1
            continue
        if not list_sphere(around.cells, n, place[0], place[1], place[2], f * shapes.bounding[s], -1.0):
            return done, NO_ROOM
        _enter(around, n, s, place, f)
        filled[0] += added
        tally[PLACED] += 1
        tally[MISSED] = 0
        done += 1
        if reached:
            return done, REACHED
    return done, MADE


@bare_kernel
def _enter(around, n, s, place, f):  # type: ignore[no-untyped-def]
    """Write a grain that is placed."""
    shapes = around.shapes
    for c in range(3):
        around.spheres[n, c] = around.cores[n, c] = place[c]
    around.spheres[n, 3], around.cores[n, 3] = f * shapes.bounding[s], f * around.core[s]
    shapes.scale[n] = f
    for c in range(4):
        shapes.orientation[n, c] = shapes.work.quaternion[c]


@bare_kernel
def _grow_at(around, rules, n, place, key, number):  # type: ignore[no-untyped-def]
    """Write the largest scale of grain n at a place, and its orientation; the place moves if grains shift."""
    work, dimension, s = around.shapes.work, around.walls.dimension, around.shapes.shape[n]
    least, most = rules.limits[0] / rules.limits[2], rules.limits[1]
    # grains that move or are rotated become larger
    first = 0.0 if rules.shift > 0 or rules.rotate > 0 else least
    for c in range(4):
        work.quaternion[c] = around.shapes.orientation[n, c]
    if around.shapes.turns[s]:
        draw_quaternion(dimension, key, number, work.quaternion)
    write_matrix(work.quaternion, work.turn)
    place[3] = largest_scale(around, s, place[0], place[1], place[2], first, most)
    for _ in range(rules.shift):
        if place[3] <= 0.0 or place[3] >= most or not _move(around, s, place, most):
            break
    if place[3] > 0.0 and rules.rotate > 0 and around.shapes.turns[s]:
        _rotate(around, s, place, most, rules.rotate, key, number)


@bare_kernel
def _move(around, s, place, most):  # type: ignore[no-untyped-def]
    """Move a grain away from what it touches while it grows; return whether it has become larger."""
    ux, uy, uz = around.away[0], around.away[1], around.away[2] if around.walls.dimension == 3 else 0.0
    length, before = math.sqrt(ux * ux + uy * uy + uz * uz), place[3]
    if length == 0.0:
        return False
    ux, uy, uz, step = ux / length, uy / length, uz / length, FIRST * place[3]
    for _ in range(MOVES):
        x = wrapped(around.cells, 0, place[0] + step * ux)
        y = wrapped(around.cells, 1, place[1] + step * uy)
        z = wrapped(around.cells, 2, place[2] + step * uz)
        grown = 0.0
        if fits(around, s, x, y, z, place[3] * (1.0 + GAIN)):
            grown = largest_scale(around, s, x, y, z, place[3], most)
        if grown > place[3]:
            place[0], place[1], place[2], place[3] = x, y, z, grown
            step *= 2.0
        else:
            step *= 0.5
    return place[3] > before


@bare_kernel
def _rotate(around, s, place, most, tries, key, number):  # type: ignore[no-untyped-def]
    """Rotate a grain to where it can grow further, in so many tries."""
    work, span = around.shapes.work, 1.0
    q = work.quaternion
    w, i, j, k = q[0], q[1], q[2], q[3]
    for number_of_try in range(tries):
        if place[3] >= most:
            break
        words = philox_block(key[0], key[1], np.uint64(number), np.uint64(FIRST_TRY + number_of_try))
        half = 0.5 * math.pi * span * (2.0 * unit_float(words[0]) - 1.0)
        a, b, c, d = math.cos(half), 0.0, 0.0, math.sin(half)
        if around.walls.dimension == 3:
            height, angle = 2.0 * unit_float(words[1]) - 1.0, 2.0 * math.pi * unit_float(words[2])
            flat = math.sqrt(max(1.0 - height * height, 0.0)) * d
            b, c, d = flat * math.cos(angle), flat * math.sin(angle), height * d
        q[0], q[1] = a * w - b * i - c * j - d * k, a * i + b * w + c * k - d * j
        q[2], q[3] = a * j - b * k + c * w + d * i, a * k + b * j - c * i + d * w
        write_matrix(q, work.turn)
        grown = 0.0
        if fits(around, s, place[0], place[1], place[2], place[3] * (1.0 + GAIN)):
            grown = largest_scale(around, s, place[0], place[1], place[2], place[3], most)
        if grown > place[3]:
            place[3], w, i, j, k = grown, q[0], q[1], q[2], q[3]
            span = min(1.0, span * WIDER)
        else:
            span *= NARROWER
    size = math.sqrt(w * w + i * i + j * j + k * k)
    q[0], q[1], q[2], q[3] = w / size, i / size, j / size, k / size
    write_matrix(q, work.turn)
