"""Settling of true shapes: small slides and turns along the free directions close the gaps that a lattice left.

In each sweep all grains want to fall by a step. Exact contacts say how far two surfaces are apart and along which
normal; the motions, slides and turns, that come nearest to the fall without closing any gap further than it is are
found by projection, with Coulomb friction if asked and without inertia. Then the true shapes are compared: where they would overlap
is one more contact, and what still overlaps goes back to where it was. So the packing is free of overlaps after each
sweep.

References
----------
Moreau 1988, Unilateral contact and dry friction in finite freedom dynamics, doi:10.1007/978-3-7091-2624-0_1. Radjai &
Richefeu 2009, Contact dynamics as a nonsmooth discrete element method, doi:10.1016/j.mechmat.2009.01.028.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.rotation import normalized, product
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import Pairs, grain_pairs
from voxgran.contacts.find import PairKey, gaps_of_pairs, is_closed_surface, meeting_pairs, pair_keys
from voxgran.contacts.surface_pairs import surface_gaps
from voxgran.contacts.walls import escape_depths
from voxgran.containers.box import Box
from voxgran.containers.rectangle import Rectangle
from voxgran.packing.method import State
from voxgran.shapes.mesh import Mesh

#: most iterations of the projection, and the change, in steps, at which it ends: far below the slack
ITERATIONS, CLOSE = 300, 1e-3
#: overlaps up to here are round-off, in median diameters
ROUND_OFF = 1e-12
#: mean sinking, in steps, below which the step is halved; and the smallest step, in median diameters
CALM, SMALLEST = 0.05, 1e-3
#: times that places of overlap are added before grains are taken back
CUTS = 10
#: halvings of the way in which the place is found where two grains meet
BISECTIONS = 5
#: times that the way of grains which would overlap is halved, and then that they are taken back, before all are
HALVINGS, RETREATS = 4, 12
#: corners of a mesh up to which they are looked at; a mesh of more is so round that one place does
CORNERS = 512
#: corners of a grain that may touch a flat wall at once
WALL_CORNERS = 8


def begin_settling(state: State, assembly: Assembly, gravity: Floats, step: float) -> None:
    """Note in the state of a method that its grains settle from now on.

    Parameters
    ----------
    state : State
        Of the method.
    assembly : Assembly
        The grains that have entered, in the normalized frame.
    gravity : (3,) ndarray of float
        Direction of the fall.
    step : float
        First step of the fall, in median diameters.
    """
    state.arrays["position"], state.arrays["orientation"] = assembly.position.copy(), assembly.orientation.copy()
    state.arrays["settling"] = np.array([step, _height(assembly, gravity), step])
    state.counters.update(settling_at=state.done, settling_sweeps=0)


def settle_sweep(state: State, assembly: Assembly, gravity: Floats, *, friction: float = 0.0) -> bool:
    """Make one sweep; tell whether the grains have come to rest.

    Parameters
    ----------
    state : State
        Of the method.
    assembly : Assembly
        The grains where the state has them.
    gravity : (3,) ndarray of float
        Direction of the fall.
    friction : float
        Coefficient of friction.
    """
    step, _, first = state.arrays["settling"].tolist()
    after, back = settle_once(assembly, step * gravity, friction)
    state.arrays["position"], state.arrays["orientation"] = after.position.copy(), after.orientation.copy()
    state.counters["settling_sweeps"] += 1
    sunk = float(((after.position - assembly.position) @ gravity).mean())
    if sunk < CALM * step:
        state.arrays["settling"][0] = step / 2
    elif not back:
        state.arrays["settling"][0] = min(first, 1.5 * step)
    return bool(state.arrays["settling"][0] < SMALLEST)


def settling_report(state: State, assembly: Assembly, gravity: Floats) -> dict[str, float]:
    """Return what settling gained: sweeps, mean sinking in median diameters, and how much denser the bed is."""
    before, after = float(state.arrays["settling"][1]), _height(assembly, gravity)
    return {
        "sweeps": state.counters["settling_sweeps"],
        "mean_sinking": before - after,
        "density_gain": before / after - 1.0 if after > 0 else 0.0,
    }


def _height(assembly: Assembly, gravity: Floats) -> float:
    """Return the mean height of the centroids over the lowest corner of the container, along gravity."""
    if not assembly.count:
        return 0.0
    lower, upper = assembly.container.bounds
    floor = np.where(gravity > 0, upper, lower)
    return float(((assembly.position - floor) @ -gravity).mean())


@dataclass(frozen=True, slots=True)
class Touching:
    """Contacts and near walls of grains; a wall has the partner -1.

    Attributes
    ----------
    i, j : (m,) ndarray of int
        The grains.
    normal : (m, 3) ndarray of float
        From i to j, or to the wall.
    gap : (m,) ndarray of float
        Distance of the surfaces.
    arm_i, arm_j : (m, 3) ndarray of float
        From the centroids to the point of contact.
    """

    i: Integers
    j: Integers
    normal: Floats
    gap: Floats
    arm_i: Floats
    arm_j: Floats


def settle_once(assembly: Assembly, fall: Floats, friction: float = 0.0) -> tuple[Assembly, int]:
    """Let all grains fall by a small step as far as they are free to slide and turn.

    Parameters
    ----------
    assembly : Assembly
        Grains that do not overlap.
    fall : (3,) ndarray of float
        The step.
    friction : float
        Coefficient of friction.

    Returns
    -------
    Assembly
        Grains that do not overlap.
    int
        How many grains went a part of their way only.
    """
    step = float(np.linalg.norm(fall))
    touching = find_touching(assembly, 4.0 * step)
    # what a turn of the normals and the end of the projection leave out
    slack = 0.05 * step + 2.0 * step * step / float(assembly.diameters.min())
    limits = touching.gap - slack
    flush = frozenset(pair_keys(_wrong(assembly)[0]))
    held = np.zeros(assembly.count, dtype=np.bool_)
    for cut in range(CUTS):
        slide, spin = _motion(assembly, touching, limits, fall, held, friction)
        there = _shifted(assembly, slide, spin)
        pairs, outside = _wrong(there, flush)
        if not pairs.count and not outside.any():
            return there, int(held.sum())
        if cut >= CUTS // 2:
            # grains that no place keeps apart stay where they are in this sweep, and the others find their way
            held[pairs.i] = held[pairs.j] = True
            held |= outside
        # where they meet on the way is one more place where they touch
        more, part = _meeting_places(assembly, pairs, slide, spin, 4.0 * step)
        walls = _near_walls(there, 0.0)
        known = [part * _closing(more, slide, spin) + more.gap, _closing(walls, slide, spin) + walls.gap]
        # what does not help is asked for with more room
        limits = np.concatenate([limits, *(gap - (1 + cut) * slack for gap in known)])
        touching = _joined([touching, more, walls])
    return _halved(assembly, slide, spin, flush)


def _halved(assembly: Assembly, slide: Floats, spin: Floats, flush: Collection[PairKey]) -> tuple[Assembly, int]:
    """Let grains that would overlap go a part of their way, at last none; return how many that were."""
    part = np.ones(assembly.count)
    for halving in range(HALVINGS + RETREATS):
        there = _shifted(assembly, part[:, None] * slide, part[:, None] * spin)
        pairs, wrong = _wrong(there, flush)
        wrong[pairs.i] = wrong[pairs.j] = True
        wrong &= part > 0
        if not wrong.any():
            return there, int((part < 1).sum())
        part[wrong] = part[wrong] / 2 if halving < HALVINGS else 0.0
    return assembly, assembly.count


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
        return _apart(moved, replace(alone, offset=pairs.offset - (1.0 - part)[:, None] * apart), reach)

    for _ in range(BISECTIONS):
        part = (low + high) / 2
        free = np.zeros(n, dtype=np.bool_)
        free[at(part).i] = True
        low, high = np.where(free, part, low), np.where(free, high, part)
    found = at(low)
    of = found.i
    return replace(found, i=pairs.i[of], j=pairs.j[of]), low[of]


def _apart(assembly: Assembly, pairs: Pairs, reach: float) -> Touching:
    """Return where some pairs are nearest, of those that are apart."""
    closed = np.array([is_closed_surface(shape.geometry) for shape in assembly.shapes], dtype=np.bool_)
    surfaces = closed[assembly.shape_id[pairs.i]] & closed[assembly.shape_id[pairs.j]]
    gap, normal, point = np.full(pairs.count, np.inf), np.zeros((pairs.count, 3)), np.zeros((pairs.count, 3))
    if surfaces.any():
        some = pairs.where(surfaces)
        *known, proven = surface_gaps(assembly, some, reach, tree_of=lambda shape: assembly.shapes[shape].geometry.tree)
        gap[surfaces], normal[surfaces], point[surfaces] = np.where(proven, known[0], np.inf), *known[1:]
    if not surfaces.all():
        gap[~surfaces], normal[~surfaces], point[~surfaces] = gaps_of_pairs(assembly, pairs.where(~surfaces), reach)
    kept = gap <= reach
    return Touching(pairs.i[kept], pairs.j[kept], normal[kept], gap[kept], point[kept], (point - pairs.offset)[kept])


def _closing(touching: Touching, slide: Floats, spin: Floats) -> Floats:
    """Return by how much a motion closes the gaps, along their normals."""
    here = slide[touching.i] + np.cross(spin[touching.i], touching.arm_i)
    there = slide[touching.j] + np.cross(spin[touching.j], touching.arm_j)
    there[touching.j < 0] = 0.0
    return np.asarray(((here - there) * touching.normal).sum(axis=1))


def _joined(parts: list[Touching]) -> Touching:
    """Return all places of several lists."""
    names = ("i", "j", "normal", "gap", "arm_i", "arm_j")
    return Touching(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def find_touching(assembly: Assembly, reach: float) -> Touching:
    """Return where grains are within a reach of each other or of walls.

    Where surfaces are nearest is one place; faces and edges touch at several, so that corners near the other grain are
    places too.
    """
    pairs = grain_pairs(assembly, reach)
    gap, normal, point = gaps_of_pairs(assembly, pairs, reach)
    kept = gap <= reach
    nearest = Touching(pairs.i[kept], pairs.j[kept], normal[kept], gap[kept], point[kept], (point - pairs.offset)[kept])
    return _joined([nearest, *near_corners(assembly, pairs, reach), _near_walls(assembly, reach)])


def near_corners(assembly: Assembly, pairs: Pairs, reach: float) -> list[Touching]:
    """Return where corners of meshes are near the surfaces of others.

    Parameters
    ----------
    assembly : Assembly
        The grains.
    pairs : Pairs
        Which of them may touch.
    reach : float
        How far to look, in the unit of lengths.
    """
    meshes = [shape.geometry if isinstance(shape.geometry, Mesh) else None for shape in assembly.shapes]
    rows = []
    for there, grain, partner in ((True, pairs.i, pairs.j), (False, pairs.j, pairs.i)):
        of, to = assembly.shape_id[grain], assembly.shape_id[partner]
        for a, b in np.unique(np.column_stack([of, to]), axis=0):
            face, corner = meshes[a], meshes[b]
            if face is None or corner is None or len(corner.vertices) > CORNERS:
                continue
            some = np.flatnonzero((of == a) & (to == b))
            offset = pairs.offset[some] if there else -pairs.offset[some]
            rows.append(_corners_near(assembly, face, corner, grain[some], partner[some], offset, reach))
    return rows


def _corners_near(
    assembly: Assembly, face: Mesh, corner: Mesh, grain: Integers, partner: Integers, offset: Floats, reach: float
) -> Touching:
    """Return where corners of one mesh, moved to each partner, are near the surface of another."""
    turn, scale = assembly.matrices, assembly.scale
    arm = np.einsum("kij,vj->kvi", turn[partner], corner.vertices) * scale[partner, None, None]
    place = np.einsum("kji,kvj->kvi", turn[grain], arm + offset[:, None]) / scale[grain, None, None]
    far = (reach / scale[grain])[:, None, None]
    low, high = face.tree.low[0], face.tree.high[0]
    k, v = np.nonzero(((place > low - far) & (place < high + far)).all(axis=2))
    points = place[k, v]
    distance, nearest, _ = face.tree.nearest(points, reach=float(far.max()))
    gap = distance * scale[grain[k]]
    kept = (gap > 0) & (gap <= reach)
    k, v, gap = k[kept], v[kept], gap[kept]
    normal = np.einsum("kij,kj->ki", turn[grain[k]], (points - nearest)[kept]) * (scale[grain[k]] / gap)[:, None]
    arm_j = arm[k, v]
    return Touching(grain[k], partner[k], normal, gap, arm_j + offset[k] - gap[:, None] * normal, arm_j)


def _motion(
    assembly: Assembly, touching: Touching, limits: Floats, fall: Floats, held: Booleans, friction: float
) -> tuple[Floats, Floats]:
    """Return slides and spins near the fall that close no gap by more than its limit, and leave some grains alone."""
    step = float(np.linalg.norm(fall))
    light = np.where(held, 0.0, 1.0 / assembly.volumes)
    easy = light / (0.4 * (assembly.diameters / 2) ** 2)
    slide, spin = np.where(held[:, None], 0.0, fall), np.zeros((assembly.count, 3))
    _project(
        touching.i, touching.j, touching.normal, limits, touching.arm_i, touching.arm_j, light, easy, friction,
        slide, spin, np.zeros(len(touching.i)), np.zeros((len(touching.i), 3)), ITERATIONS, CLOSE * step,
        assembly.dimension == 2,
    )  # fmt: skip
    slide *= np.minimum(1.0, 2.0 * step / np.maximum(np.linalg.norm(slide, axis=1), 1e-300))[:, None]
    turned = np.linalg.norm(spin, axis=1) * assembly.bounding_radii
    spin *= np.minimum(1.0, 2.0 * step / np.maximum(turned, 1e-300))[:, None]
    return slide, spin


def _near_walls(assembly: Assembly, reach: float) -> Touching:
    """Return where grains are near walls.

    Of flat walls each side counts by itself, with the corners that are nearest to it; of other containers the point of
    the tessellation that is nearest.
    """
    container, rows = assembly.container, []
    lower, upper = container.bounds
    plane = isinstance(container, Box | Rectangle)
    for grain in range(assembly.count):
        position, radius = assembly.position[grain], float(assembly.bounding_radii[grain])
        if plane:
            sides = [
                (axis, sign)
                for axis in range(assembly.dimension)
                if not container.periodic[axis]
                for sign, room in ((-1.0, position[axis] - lower[axis]), (1.0, upper[axis] - position[axis]))
                if room - radius <= reach
            ]
            if not sides:
                continue
            corners = assembly.world_vertices(grain)
            for axis, sign in sides:
                wall = upper[axis] if sign > 0 else lower[axis]
                room = sign * (wall - corners[:, axis])
                for k in np.argsort(room)[:WALL_CORNERS]:
                    rows.append((grain, sign * np.eye(3)[axis], room[k], corners[k] - position))
        elif -float(container.signed_distance(position[None])[0]) - radius <= reach:
            corners = assembly.world_vertices(grain)
            distance = container.signed_distance(corners)
            far, delta = corners[int(np.argmax(distance))], 1e-6 * radius
            slope = container.signed_distance(far + delta * np.eye(3)) - container.signed_distance(
                far - delta * np.eye(3)
            )
            length = float(np.linalg.norm(slope))
            if length > 0:
                rows.append((grain, slope / length, -float(distance.max()), far - position))
    rows = [row for row in rows if row[2] <= reach]
    if not rows:
        nothing, none = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
        return Touching(nothing, nothing, none, np.zeros(0), none, none)
    grains, normals, gaps, arms = (np.array(column) for column in zip(*rows, strict=True))
    return Touching(grains, np.full(len(grains), -1), normals, gaps, arms, np.zeros_like(arms))


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


def _wrong(assembly: Assembly, flush: Collection[PairKey] = ()) -> tuple[Pairs, Booleans]:
    """Return the pairs of grains that are not apart, or overlap though they lay flush, and who is beyond a wall."""
    limit = ROUND_OFF * float(np.median(assembly.diameters))
    return meeting_pairs(assembly, limit, flush), np.asarray(escape_depths(assembly) > limit, dtype=np.bool_)


@kernel
def _project(  # type: ignore[no-untyped-def]
    one, other, normal, gap, arm_one, arm_other, light, easy, friction, slide, spin, push, drag, iterations, close, flat
):
    """Change slides and spins until no gap closes further than its limit: projected Gauss-Seidel over the contacts.

    light, easy: reciprocal masses and moments of inertia.  push: accumulated impulses along the normals.  drag: those of
    friction across them, no larger than `friction` times the push.
    """
    rest = np.zeros(3)
    for _ in range(iterations):
        most = 0.0
        for k in range(len(one)):
            i, j = one[k], other[k]
            n = normal[k]
            weight = light[i] + easy[i] * _square_across(arm_one[k], n, flat)
            if j >= 0:
                weight += light[j] + easy[j] * _square_across(arm_other[k], n, flat)
            if weight == 0.0:
                continue
            _approach(slide, spin, i, j, arm_one[k], arm_other[k], rest)
            closing = n[0] * rest[0] + n[1] * rest[1] + n[2] * rest[2]
            before = push[k]
            push[k] = max(before + (closing - gap[k]) / weight, 0.0)
            change = push[k] - before
            most = max(most, abs(change) * weight)
            if change != 0.0:
                rest[0], rest[1], rest[2] = change * n[0], change * n[1], change * n[2]
                _press(slide, spin, i, j, arm_one[k], arm_other[k], light, easy, rest, flat)
            if friction > 0.0 and (push[k] > 0.0 or drag[k, 0] != 0.0 or drag[k, 1] != 0.0 or drag[k, 2] != 0.0):
                most = max(
                    most,
                    _drag(i, j, n, arm_one[k], arm_other[k], light, easy, friction * push[k], slide, spin, drag[k],
                          rest, flat),
                )  # fmt: skip
        if most < close:
            break


@bare_kernel
def _square_across(arm, n, flat):  # type: ignore[no-untyped-def]
    """Return the square of an arm's moment about a normal."""
    ax, ay, az = arm[1] * n[2] - arm[2] * n[1], arm[2] * n[0] - arm[0] * n[2], arm[0] * n[1] - arm[1] * n[0]
    return az * az if flat else ax * ax + ay * ay + az * az


@bare_kernel
def _approach(slide, spin, i, j, arm, partner, rest):  # type: ignore[no-untyped-def]
    """Write how the place of contact of one grain moves as seen from the other; j below 0 is a wall."""
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        rest[c] = slide[i, c] + spin[i, a] * arm[b] - spin[i, b] * arm[a]
        if j >= 0:
            rest[c] -= slide[j, c] + spin[j, a] * partner[b] - spin[j, b] * partner[a]


@bare_kernel
def _press(slide, spin, i, j, arm, partner, light, easy, impulse, flat):  # type: ignore[no-untyped-def]
    """Let an impulse push two grains apart."""
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        slide[i, c] -= light[i] * impulse[c]
        if not flat or c == 2:
            spin[i, c] -= easy[i] * (arm[a] * impulse[b] - arm[b] * impulse[a])
        if j >= 0:
            slide[j, c] += light[j] * impulse[c]
            if not flat or c == 2:
                spin[j, c] += easy[j] * (partner[a] * impulse[b] - partner[b] * impulse[a])


@bare_kernel
def _drag(i, j, n, arm, partner, light, easy, limit, slide, spin, drag, rest, flat):  # type: ignore[no-untyped-def]
    """Let friction hold back the sliding at a contact, up to a limit; return how much it changed."""
    weight = light[i] + easy[i] * (arm[0] ** 2 + arm[1] ** 2 + arm[2] ** 2)
    if j >= 0:
        weight += light[j] + easy[j] * (partner[0] ** 2 + partner[1] ** 2 + partner[2] ** 2)
    _approach(slide, spin, i, j, arm, partner, rest)
    closing = n[0] * rest[0] + n[1] * rest[1] + n[2] * rest[2]
    length = 0.0
    for c in range(3):
        rest[c] = drag[c] + (rest[c] - closing * n[c]) / weight
        length += rest[c] * rest[c]
    length = math.sqrt(length)
    kept = min(1.0, limit / length) if length > 0.0 else 0.0
    most = 0.0
    for c in range(3):
        wanted = kept * rest[c]
        rest[c] = wanted - drag[c]
        drag[c] = wanted
        most = max(most, abs(rest[c]) * weight)
    _press(slide, spin, i, j, arm, partner, light, easy, rest, flat)
    return most
