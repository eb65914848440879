"""Settling of true shapes under gravity by small translations and rotations.

The trial motion of a sweep is a free fall of all grains by a step. Exact contacts give distances and normals of nearby
surfaces; the motions nearest to the trial motion that close no gap beyond its distance are found by a projected
Gauss-Seidel iteration, optionally with Coulomb friction and without inertia. Then the true shapes are compared: a place
where two grains would meet is added as a contact, and grains that no contact keeps apart stay where they are, so that
the packing is free of overlaps after each sweep. Shaking, with an amplitude that falls to zero, adds random motions to
the fall, which makes beds denser and lets grains with faces align.

References
----------
Moreau 1988, Unilateral contact and dry friction in finite freedom dynamics, doi:10.1007/978-3-7091-2624-0_1. Radjai &
Richefeu 2009, Contact dynamics as a nonsmooth discrete element method, doi:10.1016/j.mechmat.2009.01.028.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from voxgran._base.arrays import Booleans, Floats
from voxgran._base.rotation import normalized, product
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import Pairs, grain_pairs
from voxgran.contacts.find import PairKey, gaps_of_pairs, meeting_pairs, pair_keys
from voxgran.contacts.walls import escape_depths
from voxgran.settling.contact_points import (
    ContactPoints,
    closing_of,
    find_contact_points,
    joined,
    near_walls,
    places_of,
)
from voxgran.settling.gauss_seidel import project
from voxgran.settling.trial_motion import TrialMotion

#: most iterations of the projection, and the change, in steps, at which it ends: far below the slack
ITERATIONS, CLOSE = 400, 3e-3
#: contacts that are solved between two checks for a request to stop
AT_ONCE = 2**20
#: overlaps up to here are round-off, in median diameters
ROUND_OFF = 1e-12
#: mean displacement along gravity, in steps, below which a sweep counts as calm
CALM = 0.05
#: times that places of overlap are added before grains are taken back
CUTS = 10
#: bisections of the motion in which the place is found where two grains meet
BISECTIONS = 10
#: largest displacement of a sweep, in steps; a motion that is cut off here may violate limits of gaps
FARTHEST = 8.0
#: within which distance contacts are kept open while grains are parted, and by how much they are parted at least, in
#: median diameters
PART_REACH, PART_ROOM = 0.02, 1e-5
#: times that the motions of grains which would overlap are halved, and then undone, before all motions are
HALVINGS, RETREATS = 4, 60


def part_once(assembly: Assembly, gravity: Floats, sweep: int = 0, *, distance: float = 0.0) -> tuple[Assembly, int]:
    """Separate grains that overlap a little, or are too near, by the least motions that do so to first order.

    Contacts are solved along `gravity`; the margin grows with the number of sweeps before; surfaces keep a distance, 0
    if they may touch. Return the grains, and how many pairs were too near, and grains beyond walls, before.
    """
    pairs, outside = _wrong(assembly)
    many = (_count_near(assembly, distance) if distance > 0.0 else pairs.count) + int(outside.sum())
    if not many:
        return assembly, 0
    size = float(np.median(assembly.diameters))
    contacts = find_contact_points(assembly, distance + PART_REACH * size)
    contacts.gap[contacts.j >= 0] -= distance
    # at walls stands the tessellation of a grain, which the true surface may pass by its error
    error = np.array([shape.tessellation_error for shape in assembly.shapes])[assembly.shape_id] * assembly.scale
    contacts.gap[contacts.j < 0] -= error[contacts.i[contacts.j < 0]]
    none, step = np.zeros((assembly.count, 3)), max(-float(contacts.gap.min(initial=0.0)), PART_ROOM * size)
    # safety margin for rotations and the residual of the solver
    room = (1 + sweep) * PART_ROOM * size + 0.05 * step
    limits = np.where(contacts.gap < 0.0, contacts.gap - room, np.maximum(contacts.gap - room, 0.0))
    fall = step * gravity if gravity.any() else step * np.eye(3)[assembly.dimension - 1]
    held, impulses = np.zeros(assembly.count, dtype=np.bool_), np.zeros((len(contacts.i), 4))
    motion = TrialMotion(step, fall, none, none)
    translation, rotation = _motion(assembly, contacts, limits, motion, held, 0.0, impulses)
    return _shifted(assembly, translation, rotation), many


def follow(assembly: Assembly, motion: TrialMotion, friction: float = 0.0) -> tuple[Assembly, int]:
    """Move all grains, which do not overlap, as near to a small trial motion as their contacts and friction allow.

    Return the grains, which do not overlap, and the number of those that made only a part of their motion.
    """
    step = motion.step
    contacts = find_contact_points(assembly, 4.0 * step)
    # safety margin for the rotation of contact normals and the residual of the solver
    slack = 0.05 * step + 2.0 * step * step / float(assembly.diameters.min())
    open_limits = contacts.gap - slack
    loose, back, gain = _moved(assembly, contacts, open_limits, motion, slack=slack, friction=friction)
    if gain > CALM * step * step:
        return loose, back
    # gaps that have to open a little keep the next sweep free; where there is no room for it, none has to
    shut_limits = np.maximum(open_limits, np.minimum(contacts.gap, 0.0))
    tight, held, more = _moved(assembly, contacts, shut_limits, motion, slack=slack, friction=friction)
    return (tight, held) if more > gain else (loose, back)


def _moved(
    assembly: Assembly, contacts: ContactPoints, limits: Floats, motion: TrialMotion, *, slack: float, friction: float
) -> tuple[Assembly, int, float]:
    """Return the grains after a motion that closes no gap by more than its limit.

    Also how many were held back, and the mean product of motion and fall.
    """
    flush = frozenset(pair_keys(_wrong(assembly)[0]))
    held = np.zeros(assembly.count, dtype=np.bool_)
    impulses = np.zeros((len(contacts.i), 4))
    for cut in range(CUTS):
        translation, rotation = _motion(assembly, contacts, limits, motion, held, friction, impulses)
        there = _shifted(assembly, translation, rotation)
        pairs, outside = _wrong(there, flush)
        if not pairs.count and not outside.any():
            return there, int(held.sum()), float((translation @ motion.fall).mean())
        if cut >= CUTS // 2:
            # grains that no contact keeps apart stay where they are in this sweep
            held |= _to_stop(assembly, pairs, motion.fall, held) | outside
        # the place where they would meet is one more contact
        more, part = _meeting_places(assembly, pairs, translation, rotation, 4.0 * motion.step)
        walls = near_walls(there, 0.0)
        known = [
            part * closing_of(more, translation, rotation) + more.gap,
            closing_of(walls, translation, rotation) + walls.gap,
        ]
        # with a margin that grows in each cut
        limits = np.concatenate([limits, *(np.maximum(gap - (1 + cut) * slack, -slack) for gap in known)])
        contacts = joined([contacts, more, walls])
        impulses = np.concatenate([impulses, np.zeros((len(more.i) + len(walls.i), 4))])
    part = _parts(assembly, translation, rotation, motion.fall, flush)
    gain = float(part @ (translation @ motion.fall)) / max(assembly.count, 1)
    return _shifted(assembly, part[:, None] * translation, part[:, None] * rotation), int((part < 1).sum()), gain


def _to_stop(assembly: Assembly, pairs: Pairs, fall: Floats, stopped: Booleans) -> Booleans:
    """Return the grains that have to stop so that pairs stay apart: the upper one of two that move, else the other."""
    height = -(assembly.position @ fall)
    upper = np.where(height[pairs.i] >= height[pairs.j], pairs.i, pairs.j)
    other = pairs.i + pairs.j - upper
    wrong = np.zeros(assembly.count, dtype=np.bool_)
    wrong[np.where(stopped[upper], other, upper)] = True
    return wrong


def _parts(
    assembly: Assembly, translation: Floats, rotation: Floats, fall: Floats, flush: Collection[PairKey]
) -> Floats:
    """Return the fraction of its motion that each grain can make; reduced, at last to 0, where they overlap."""
    part = np.ones(assembly.count)
    for halving in range(HALVINGS + RETREATS):
        there = _shifted(assembly, part[:, None] * translation, part[:, None] * rotation)
        pairs, wrong = _wrong(there, flush)
        wrong |= _to_stop(assembly, pairs, fall, part == 0)
        wrong &= part > 0
        if not wrong.any():
            return part
        part[wrong] = part[wrong] / 2 if halving < HALVINGS else 0.0
    return np.zeros(assembly.count)


def _meeting_places(
    assembly: Assembly, pairs: Pairs, translation: Floats, rotation: Floats, reach: float
) -> tuple[ContactPoints, Floats]:
    """Return where pairs that would overlap are nearest just before they meet, and at which fraction of the motion."""
    n, both = pairs.count, np.concatenate([pairs.i, pairs.j])
    low, high = np.zeros(n), np.ones(n)
    alone = Pairs(np.arange(n), n + np.arange(n), pairs.image, pairs.offset)
    apart = translation[pairs.j] - translation[pairs.i]

    def at(part: Floats) -> ContactPoints:
        """Return where the pairs are nearest after a fraction of their motion."""
        twice = np.concatenate([part, part])[:, None]
        moved = Assembly(
            assembly.shapes, assembly.shape_id[both], assembly.scale[both], assembly.position[both],
            _turned(assembly.orientation[both], twice * rotation[both]), assembly.container,
        )  # fmt: skip
        return places_of(moved, replace(alone, offset=pairs.offset - (1.0 - part)[:, None] * apart), reach)

    for _ in range(BISECTIONS):
        stop_if_asked()
        part = (low + high) / 2
        free = np.zeros(n, dtype=np.bool_)
        free[at(part).i] = True
        low, high = np.where(free, part, low), np.where(free, high, part)
    found = at(low)
    of = found.i
    return replace(found, i=pairs.i[of], j=pairs.j[of]), low[of]


def _motion(
    assembly: Assembly, contacts: ContactPoints, limits: Floats, motion: TrialMotion, held: Booleans, friction: float,
    impulses: Floats,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return translations and rotations near a motion that close no gap by more than its limit; held grains stay.

    impulses: along the normals and across them, changed in place.
    """
    step = motion.step
    inverse_mass = np.where(held, 0.0, 1.0 / assembly.volumes)
    inverse_inertia = inverse_mass / (0.4 * (assembly.diameters / 2) ** 2)
    translation, rotation = (np.where(held[:, None], 0.0, free) for free in (motion.translation, motion.rotation))
    normal_impulse, tangential_impulse = np.ascontiguousarray(impulses[:, 0]), np.ascontiguousarray(impulses[:, 1:])
    order = np.argsort(-(assembly.position[contacts.i] @ motion.fall), kind="stable")
    weight, rest = np.zeros(len(normal_impulse)), np.zeros(3)
    some = max(1, AT_ONCE // max(len(normal_impulse), 1))
    for first in range(0, ITERATIONS, some):
        stop_if_asked()
        if project(
            contacts.i, contacts.j, contacts.normal, limits, contacts.arm_i, contacts.arm_j, inverse_mass,
            inverse_inertia, friction, translation, rotation, normal_impulse, tangential_impulse, order, weight, rest,
            first, min(first + some, ITERATIONS), CLOSE * step,
            assembly.dimension == 2,
        ):  # fmt: skip
            break
    impulses[:, 0], impulses[:, 1:] = normal_impulse, tangential_impulse
    for moved, radius in ((translation, 1.0), (rotation, assembly.bounding_radii)):
        way = np.linalg.norm(moved, axis=1) * radius
        moved *= np.minimum(1.0, FARTHEST * step / np.maximum(way, 1e-300))[:, None]
    return translation, rotation


def _shifted(assembly: Assembly, translation: Floats, rotation: Floats) -> Assembly:
    """Return the grains moved and turned."""
    position = assembly.position + translation
    lower, upper = assembly.container.bounds
    for k in range(assembly.dimension):
        if assembly.container.periodic[k]:
            position[:, k] = lower[k] + (position[:, k] - lower[k]) % (upper[k] - lower[k])
    return replace(assembly, position=position, orientation=_turned(assembly.orientation, rotation))


def _turned(orientation: Floats, rotation: Floats) -> Floats:
    """Return orientations turned by rotation vectors."""
    angle = np.linalg.norm(rotation, axis=1)
    axis = rotation / np.maximum(angle, 1e-300)[:, None]
    turn = np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis])
    return normalized(product(turn, orientation))


def _count_near(assembly: Assembly, distance: float) -> int:
    """Return how many pairs of grains are nearer than a distance."""
    gap = gaps_of_pairs(assembly, grain_pairs(assembly, distance), distance, deepest=False)[0]
    return int(np.count_nonzero(gap < distance - ROUND_OFF * float(np.median(assembly.diameters))))


def _wrong(assembly: Assembly, flush: Collection[PairKey] = ()) -> tuple[Pairs, Booleans]:
    """Return the pairs of grains that overlap, or lay flush and overlap now, and which grains are beyond a wall."""
    stop_if_asked()
    limit = ROUND_OFF * float(np.median(assembly.diameters))
    return meeting_pairs(assembly, limit, flush), np.asarray(escape_depths(assembly) > limit, dtype=np.bool_)
