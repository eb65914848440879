"""Settling of true shapes: small slides and turns along the free directions close the gaps that a lattice left.

In each sweep all grains want to fall by a step. Exact contacts say how far two surfaces are apart and along which
normal; the motions, slides and turns, that come nearest to the fall without closing any gap further than it is are
found by projection, with Coulomb friction if asked and without inertia. Then the true shapes are compared: where two
would meet on their way is one more contact, and grains that no contact keeps apart stay where they are. So the packing
is free of overlaps after each sweep. Shaking, which dies away, lets each grain want to go and turn its own way as well:
beds get denser by it, and grains with faces lie down on each other.

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
from voxgran.settling.contact_points import Touching, closing_of, find_touching, joined, near_walls, places_of
from voxgran.settling.gauss_seidel import project
from voxgran.settling.trial_motion import Wish

#: most iterations of the projection, and the change, in steps, at which it ends: far below the slack
ITERATIONS, CLOSE = 400, 3e-3
#: contacts that are solved between two looks whether to stop
AT_ONCE = 2**20
#: overlaps up to here are round-off, in median diameters
ROUND_OFF = 1e-12
#: mean way along gravity, in steps, below which a sweep counts as calm
CALM = 0.05
#: times that places of overlap are added before grains are taken back
CUTS = 10
#: halvings of the way in which the place is found where two grains meet
BISECTIONS = 10
#: largest way and turn of a sweep, in steps: what is cut off here breaks what the projection kept
FARTHEST = 8.0
#: within which distance contacts are kept open while grains are parted, and by how much they are parted at least, in
#: median diameters
PART_REACH, PART_ROOM = 0.02, 1e-5
#: times that the way of grains which would overlap is halved, and then that they are taken back, before all are
HALVINGS, RETREATS = 4, 60


def part_once(
    assembly: Assembly, gravity: Floats, sweep: int = 0, *, distance: float = 0.0
) -> tuple[Assembly, int]:  # fmt: skip
    """Push grains that overlap a little, or are too near, apart, in the least motions that do so to first order.

    Parameters
    ----------
    assembly : Assembly
        The grains.
    gravity : (3,) ndarray of float
        Direction of the fall, along which contacts are solved.
    sweep : int
        Sweeps that have not parted them: the more, the more room is asked for.
    distance : float
        That the surfaces of grains have to keep, in the unit of lengths; 0: they may touch.

    Returns
    -------
    Assembly
        The grains pushed apart, or as they were where none was too near.
    int
        How many pairs were too near, and grains reached through walls, before.
    """
    pairs, outside = _wrong(assembly)
    many = (_count_near(assembly, distance) if distance > 0.0 else pairs.count) + int(outside.sum())
    if not many:
        return assembly, 0
    size = float(np.median(assembly.diameters))
    touching = find_touching(assembly, distance + PART_REACH * size)
    touching.gap[touching.j >= 0] -= distance
    # at walls stands the tessellation of a grain, which the true surface may pass by its error
    error = np.array([shape.tessellation_error for shape in assembly.shapes])[assembly.shape_id] * assembly.scale
    touching.gap[touching.j < 0] -= error[touching.i[touching.j < 0]]
    none, step = np.zeros((assembly.count, 3)), max(-float(touching.gap.min(initial=0.0)), PART_ROOM * size)
    # what turns of the grains and the end of the projection leave out
    room = (1 + sweep) * PART_ROOM * size + 0.05 * step
    limits = np.where(touching.gap < 0.0, touching.gap - room, np.maximum(touching.gap - room, 0.0))
    fall = step * gravity if gravity.any() else step * np.eye(3)[assembly.dimension - 1]
    held, impulses = np.zeros(assembly.count, dtype=np.bool_), np.zeros((len(touching.i), 4))
    slide, spin = _motion(assembly, touching, limits, Wish(step, fall, none, none), held, 0.0, impulses)
    return _shifted(assembly, slide, spin), many


def follow(assembly: Assembly, wish: Wish, friction: float = 0.0) -> tuple[Assembly, int]:
    """Let all grains go as near to their wish as they are free to slide and turn.

    Parameters
    ----------
    assembly : Assembly
        Grains that do not overlap.
    wish : Wish
        A small motion of each.
    friction : float
        Coefficient of friction.

    Returns
    -------
    Assembly
        Grains that do not overlap.
    int
        How many grains went a part of their way only.
    """
    step = wish.step
    touching = find_touching(assembly, 4.0 * step)
    # what a turn of the normals and the end of the projection leave out
    slack = 0.05 * step + 2.0 * step * step / float(assembly.diameters.min())
    open_limits = touching.gap - slack
    loose, back, gain = _moved(assembly, touching, open_limits, wish, slack=slack, friction=friction)
    if gain > CALM * step * step:
        return loose, back
    # gaps that have to open a little keep the next sweep free; where there is no room for it, none has to
    shut_limits = np.maximum(open_limits, np.minimum(touching.gap, 0.0))
    tight, held, more = _moved(assembly, touching, shut_limits, wish, slack=slack, friction=friction)
    return (tight, held) if more > gain else (loose, back)


def _moved(
    assembly: Assembly, touching: Touching, limits: Floats, wish: Wish, *, slack: float, friction: float
) -> tuple[Assembly, int, float]:
    """Return the grains after a motion that closes no gap by more than its limit.

    Also how many were held back, and the mean product of motion and fall.
    """
    flush = frozenset(pair_keys(_wrong(assembly)[0]))
    held = np.zeros(assembly.count, dtype=np.bool_)
    impulses = np.zeros((len(touching.i), 4))
    for cut in range(CUTS):
        slide, spin = _motion(assembly, touching, limits, wish, held, friction, impulses)
        there = _shifted(assembly, slide, spin)
        pairs, outside = _wrong(there, flush)
        if not pairs.count and not outside.any():
            return there, int(held.sum()), float((slide @ wish.fall).mean())
        if cut >= CUTS // 2:
            # grains that no place keeps apart stay where they are in this sweep, and the others find their way
            held |= _to_stop(assembly, pairs, wish.fall, held) | outside
        # where they meet on the way is one more place where they touch
        more, part = _meeting_places(assembly, pairs, slide, spin, 4.0 * wish.step)
        walls = near_walls(there, 0.0)
        known = [part * closing_of(more, slide, spin) + more.gap, closing_of(walls, slide, spin) + walls.gap]
        # what does not help is asked for with more room
        limits = np.concatenate([limits, *(np.maximum(gap - (1 + cut) * slack, -slack) for gap in known)])
        touching = joined([touching, more, walls])
        impulses = np.concatenate([impulses, np.zeros((len(more.i) + len(walls.i), 4))])
    part = _parts(assembly, slide, spin, wish.fall, flush)
    gain = float(part @ (slide @ wish.fall)) / max(assembly.count, 1)
    return _shifted(assembly, part[:, None] * slide, part[:, None] * spin), int((part < 1).sum()), gain


def _to_stop(assembly: Assembly, pairs: Pairs, fall: Floats, stopped: Booleans) -> Booleans:
    """Return who has to stop so that pairs stay apart: of two that move the upper one, else the one that moves."""
    height = -(assembly.position @ fall)
    upper = np.where(height[pairs.i] >= height[pairs.j], pairs.i, pairs.j)
    other = pairs.i + pairs.j - upper
    wrong = np.zeros(assembly.count, dtype=np.bool_)
    wrong[np.where(stopped[upper], other, upper)] = True
    return wrong


def _parts(assembly: Assembly, slide: Floats, spin: Floats, fall: Floats, flush: Collection[PairKey]) -> Floats:
    """Return which part of its way each grain can go: grains that would overlap go less of it, at last nothing."""
    part = np.ones(assembly.count)
    for halving in range(HALVINGS + RETREATS):
        there = _shifted(assembly, part[:, None] * slide, part[:, None] * spin)
        pairs, wrong = _wrong(there, flush)
        wrong |= _to_stop(assembly, pairs, fall, part == 0)
        wrong &= part > 0
        if not wrong.any():
            return part
        part[wrong] = part[wrong] / 2 if halving < HALVINGS else 0.0
    return np.zeros(assembly.count)


def _meeting_places(
    assembly: Assembly, pairs: Pairs, slide: Floats, spin: Floats, reach: float
) -> tuple[Touching, Floats]:
    """Return where pairs of grains that would overlap are nearest just before they meet, and which part of the way."""
    n, both = pairs.count, np.concatenate([pairs.i, pairs.j])
    low, high = np.zeros(n), np.ones(n)
    alone = Pairs(np.arange(n), n + np.arange(n), pairs.image, pairs.offset)
    apart = slide[pairs.j] - slide[pairs.i]

    def at(part: Floats) -> Touching:
        """Return where the pairs are nearest after a part of their way."""
        twice = np.concatenate([part, part])[:, None]
        moved = Assembly(
            assembly.shapes, assembly.shape_id[both], assembly.scale[both], assembly.position[both],
            _turned(assembly.orientation[both], twice * spin[both]), assembly.container,
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
    assembly: Assembly,
    touching: Touching,
    limits: Floats,
    wish: Wish,
    held: Booleans,
    friction: float,
    impulses: Floats,
) -> tuple[Floats, Floats]:
    """Return slides and spins near the wish that close no gap by more than its limit, and leave some grains alone.

    impulses: along the normals and across them, changed in place.
    """
    step = wish.step
    light = np.where(held, 0.0, 1.0 / assembly.volumes)
    easy = light / (0.4 * (assembly.diameters / 2) ** 2)
    slide, spin = (np.where(held[:, None], 0.0, motion) for motion in (wish.slide, wish.spin))
    push, drag = np.ascontiguousarray(impulses[:, 0]), np.ascontiguousarray(impulses[:, 1:])
    order = np.argsort(-(assembly.position[touching.i] @ wish.fall), kind="stable")
    weight, rest = np.zeros(len(push)), np.zeros(3)
    some = max(1, AT_ONCE // max(len(push), 1))
    for first in range(0, ITERATIONS, some):
        stop_if_asked()
        if project(
            touching.i, touching.j, touching.normal, limits, touching.arm_i, touching.arm_j, light, easy, friction,
            slide, spin, push, drag, order, weight, rest, first, min(first + some, ITERATIONS), CLOSE * step,
            assembly.dimension == 2,
        ):  # fmt: skip
            break
    impulses[:, 0], impulses[:, 1:] = push, drag
    slide *= np.minimum(1.0, FARTHEST * step / np.maximum(np.linalg.norm(slide, axis=1), 1e-300))[:, None]
    turned = np.linalg.norm(spin, axis=1) * assembly.bounding_radii
    spin *= np.minimum(1.0, FARTHEST * step / np.maximum(turned, 1e-300))[:, None]
    return slide, spin


def _shifted(assembly: Assembly, slide: Floats, spin: Floats) -> Assembly:
    """Return the grains moved and turned."""
    position = assembly.position + slide
    lower, upper = assembly.container.bounds
    for k in range(assembly.dimension):
        if assembly.container.periodic[k]:
            position[:, k] = lower[k] + (position[:, k] - lower[k]) % (upper[k] - lower[k])
    return replace(assembly, position=position, orientation=_turned(assembly.orientation, spin))


def _turned(orientation: Floats, spin: Floats) -> Floats:
    """Return orientations turned by rotation vectors."""
    angle = np.linalg.norm(spin, axis=1)
    axis = spin / np.maximum(angle, 1e-300)[:, None]
    turn = np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis])
    return normalized(product(turn, orientation))


def _count_near(assembly: Assembly, distance: float) -> int:
    """Return how many pairs of grains are nearer than a distance."""
    gap = gaps_of_pairs(assembly, grain_pairs(assembly, distance), distance, deepest=False)[0]
    return int(np.count_nonzero(gap < distance - ROUND_OFF * float(np.median(assembly.diameters))))


def _wrong(assembly: Assembly, flush: Collection[PairKey] = ()) -> tuple[Pairs, Booleans]:
    """Return the pairs of grains that are not apart, or overlap though they lay flush, and who is beyond a wall."""
    stop_if_asked()
    limit = ROUND_OFF * float(np.median(assembly.diameters))
    return meeting_pairs(assembly, limit, flush), np.asarray(escape_depths(assembly) > limit, dtype=np.bool_)
