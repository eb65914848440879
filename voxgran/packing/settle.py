"""Settling of true shapes: small slides and turns along the free directions close the gaps that a lattice left.

In each sweep all grains want to fall by a step. Exact contacts say how far two surfaces are apart and along which
normal; the motions, slides and turns, that come nearest to the fall without closing any gap further than it is are
found by projection, without friction and without inertia. Then the true shapes are compared: where they would overlap
is one more contact, and what still overlaps goes back to where it was. So the packing is free of overlaps after each
sweep.

References
----------
Moreau 1988, Unilateral contact and dry friction in finite freedom dynamics, doi:10.1007/978-3-7091-2624-0_1. Radjai &
Richefeu 2009, Contact dynamics as a nonsmooth discrete element method, doi:10.1016/j.mechmat.2009.01.028.
"""

from dataclasses import dataclass, replace

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.rotation import normalized, product
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.find import find_contacts, overlaps
from voxgran.contacts.walls import escape_depths
from voxgran.containers.box import Box
from voxgran.containers.rectangle import Rectangle
from voxgran.packing.method import State

#: iterations of the projection
ITERATIONS = 300
#: overlaps up to here are round-off, in median diameters
ROUND_OFF = 1e-12
#: mean sinking, in steps, below which the step is halved; and the smallest step, in median diameters
CALM, SMALLEST = 0.03, 1e-4
#: times that places of overlap are added before grains are taken back
CUTS = 6
#: times that grains which overlap are taken back one by one before all are
RETREATS = 12


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
    state.arrays["settling"] = np.array([step, _height(assembly, gravity)])
    state.counters.update(settling_at=state.done, settling_sweeps=0)


def settle_sweep(state: State, assembly: Assembly, gravity: Floats) -> bool:
    """Make one sweep; tell whether the grains have come to rest.

    Parameters
    ----------
    state : State
        Of the method.
    assembly : Assembly
        The grains where the state has them.
    gravity : (3,) ndarray of float
        Direction of the fall.
    """
    step = float(state.arrays["settling"][0])
    after, back = settle_once(assembly, step * gravity)
    state.arrays["position"], state.arrays["orientation"] = after.position.copy(), after.orientation.copy()
    state.counters["settling_sweeps"] += 1
    sunk = float(((after.position - assembly.position) @ gravity).mean())
    if back > 0.2 * assembly.count or sunk < CALM * step:
        state.arrays["settling"][0] = step / 2
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


def settle_once(assembly: Assembly, fall: Floats) -> tuple[Assembly, int]:
    """Let all grains fall by a small step as far as they are free to slide and turn.

    Parameters
    ----------
    assembly : Assembly
        Grains that do not overlap.
    fall : (3,) ndarray of float
        The step.

    Returns
    -------
    Assembly
        Grains that do not overlap.
    int
        How many grains had to go back to where they were.
    """
    step = float(np.linalg.norm(fall))
    touching = find_touching(assembly, 4.0 * step)
    # what a turn of the normals and the end of the projection leave out
    slack = 0.05 * step + 2.0 * step * step / float(assembly.diameters.min())
    loose, back = _fallen(assembly, touching, fall, step, slack, touching.gap - slack)
    if not back:
        return loose, 0
    # gaps that have to open a little keep the next sweep free; where there is no room for it, none has to
    tight, held = _fallen(
        assembly, touching, fall, step, slack, np.maximum(touching.gap - slack, np.minimum(touching.gap, 0.0))
    )
    gain = ((tight.position - loose.position) @ fall).mean()
    return (tight, held) if gain > 0 else (loose, back)


def _fallen(
    assembly: Assembly, touching: Touching, fall: Floats, step: float, slack: float, limits: Floats
) -> tuple[Assembly, int]:
    """Return the grains after a fall that closes no gap by more than its limit, and how many had to go back."""
    for _ in range(CUTS):
        slide, spin = _motion(assembly, touching, limits, fall, step)
        there = _shifted(assembly, slide, spin)
        if not _offenders(there).any():
            return there, 0
        # where they would overlap is one more place where they touch: faces and edges need several
        more = find_touching(there, 0.0)
        closing = _closing(more, slide, spin)
        touching = Touching(*(np.concatenate(pair) for pair in zip(_parts(touching), _parts(more), strict=True)))
        limits = np.concatenate([limits, closing + more.gap - slack])
    for part in (0.5, 0.25):
        # what closes too far on the whole way may not on a part of it
        there = _shifted(assembly, part * slide, part * spin)
        if not _offenders(there).any():
            return there, 0
    return _retreated(assembly, there)


def _motion(assembly: Assembly, touching: Touching, limits: Floats, fall: Floats, step: float) -> tuple[Floats, Floats]:
    """Return slides and spins near the fall that close no gap by more than its limit."""
    mass = assembly.volumes
    inertia = 0.4 * mass * (assembly.diameters / 2) ** 2
    slide, spin = np.tile(fall, (assembly.count, 1)), np.zeros((assembly.count, 3))
    _project(
        touching.i, touching.j, touching.normal, limits, touching.arm_i, touching.arm_j, 1.0 / mass, 1.0 / inertia,
        slide, spin, np.zeros(len(touching.i)), ITERATIONS, assembly.dimension == 2,
    )  # fmt: skip
    slide *= np.minimum(1.0, 2.0 * step / np.maximum(np.linalg.norm(slide, axis=1), 1e-300))[:, None]
    turned = np.linalg.norm(spin, axis=1) * assembly.bounding_radii
    spin *= np.minimum(1.0, 2.0 * step / np.maximum(turned, 1e-300))[:, None]
    return slide, spin


def _closing(touching: Touching, slide: Floats, spin: Floats) -> Floats:
    """Return by how much a motion closes the gaps, along their normals."""
    here = slide[touching.i] + np.cross(spin[touching.i], touching.arm_i)
    there = slide[touching.j] + np.cross(spin[touching.j], touching.arm_j)
    there[touching.j < 0] = 0.0
    return np.asarray(((here - there) * touching.normal).sum(axis=1))


def _parts(touching: Touching) -> tuple[Integers, Integers, Floats, Floats, Floats, Floats]:
    """Return the arrays of contacts."""
    return touching.i, touching.j, touching.normal, touching.gap, touching.arm_i, touching.arm_j


def find_touching(assembly: Assembly, reach: float) -> Touching:
    """Return the contacts of grains, and the walls of grains, that are within a reach."""
    found = find_contacts(assembly, reach)
    lower, upper = assembly.container.bounds
    shift = found.image * (upper - lower)
    arm_i = found.point - assembly.position[found.i]
    arm_j = found.point - (assembly.position[found.j] + shift)
    grain, normal, gap, arm = _near_walls(assembly, reach)
    return Touching(
        np.concatenate([found.i, grain]),
        np.concatenate([found.j, np.full(len(grain), -1)]),
        np.concatenate([found.normal, normal]),
        np.concatenate([found.gap, gap]),
        np.concatenate([arm_i, arm]),
        np.concatenate([arm_j, np.zeros_like(arm)]),
    )


def _near_walls(assembly: Assembly, reach: float) -> tuple[Integers, Floats, Floats, Floats]:
    """Return grains near walls, the normals to the walls, the gaps, and the arms of the nearest points.

    Of flat walls each side counts by itself; of other containers the point of the tessellation that is nearest.
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
                far = corners[np.argmax(sign * corners[:, axis])]
                wall = upper[axis] if sign > 0 else lower[axis]
                rows.append((grain, sign * np.eye(3)[axis], sign * (wall - far[axis]), far - position))
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
    if not rows:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3))
    grains, normals, gaps, arms = zip(*rows, strict=True)
    keep = np.array(gaps) <= reach
    return np.array(grains)[keep], np.array(normals)[keep], np.array(gaps)[keep], np.array(arms)[keep]


def _shifted(assembly: Assembly, slide: Floats, spin: Floats) -> Assembly:
    """Return the grains moved and turned."""
    angle = np.linalg.norm(spin, axis=1)
    axis = spin / np.maximum(angle, 1e-300)[:, None]
    turn = np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis])
    position = assembly.position + slide
    lower, upper = assembly.container.bounds
    for k in range(assembly.dimension):
        if assembly.container.periodic[k]:
            position[:, k] = lower[k] + (position[:, k] - lower[k]) % (upper[k] - lower[k])
    return replace(assembly, position=position, orientation=normalized(product(turn, assembly.orientation)))


def _retreated(assembly: Assembly, there: Assembly) -> tuple[Assembly, int]:
    """Take back the grains that would overlap, and those that these then meet; return how many that were.

    Where that does not end, all stay where they were.
    """
    back = np.zeros(assembly.count, dtype=np.bool_)
    for _ in range(RETREATS):
        mixed = replace(
            assembly,
            position=np.where(back[:, None], assembly.position, there.position),
            orientation=np.where(back[:, None], assembly.orientation, there.orientation),
        )
        wrong = _offenders(mixed)
        if not wrong.any():
            return mixed, int(back.sum())
        back |= wrong
    return assembly, assembly.count


def _offenders(assembly: Assembly) -> Booleans:
    """Tell which grains overlap others or reach through a wall."""
    unit = float(np.median(assembly.diameters))
    found = overlaps(assembly, at_least=ROUND_OFF * unit)
    wrong = escape_depths(assembly) > ROUND_OFF * unit
    wrong[found.i] = True
    wrong[found.j] = True
    return np.asarray(wrong, dtype=np.bool_)


@kernel
def _project(  # type: ignore[no-untyped-def]
    one, other, normal, gap, arm_one, arm_other, light, easy, slide, spin, push, iterations, flat
):
    """Change slides and spins until no gap closes further than it is: projected Gauss-Seidel over the contacts.

    light, easy: reciprocal masses and moments of inertia.  push: accumulated impulses.
    """
    for _ in range(iterations):
        most = 0.0
        for k in range(len(one)):
            i, j = one[k], other[k]
            nx, ny, nz = normal[k, 0], normal[k, 1], normal[k, 2]
            ax = arm_one[k, 1] * nz - arm_one[k, 2] * ny
            ay = arm_one[k, 2] * nx - arm_one[k, 0] * nz
            az = arm_one[k, 0] * ny - arm_one[k, 1] * nx
            if flat:
                ax, ay = 0.0, 0.0
            closing = nx * slide[i, 0] + ny * slide[i, 1] + nz * slide[i, 2]
            closing += ax * spin[i, 0] + ay * spin[i, 1] + az * spin[i, 2]
            weight = light[i] + easy[i] * (ax * ax + ay * ay + az * az)
            bx, by, bz = 0.0, 0.0, 0.0
            if j >= 0:
                bx = arm_other[k, 1] * nz - arm_other[k, 2] * ny
                by = arm_other[k, 2] * nx - arm_other[k, 0] * nz
                bz = arm_other[k, 0] * ny - arm_other[k, 1] * nx
                if flat:
                    bx, by = 0.0, 0.0
                closing -= nx * slide[j, 0] + ny * slide[j, 1] + nz * slide[j, 2]
                closing -= bx * spin[j, 0] + by * spin[j, 1] + bz * spin[j, 2]
                weight += light[j] + easy[j] * (bx * bx + by * by + bz * bz)
            before = push[k]
            push[k] = max(before + (closing - gap[k]) / weight, 0.0)
            change = push[k] - before
            most = max(most, abs(change) * weight)
            if change == 0.0:
                continue
            slide[i, 0] -= change * light[i] * nx
            slide[i, 1] -= change * light[i] * ny
            slide[i, 2] -= change * light[i] * nz
            spin[i, 0] -= change * easy[i] * ax
            spin[i, 1] -= change * easy[i] * ay
            spin[i, 2] -= change * easy[i] * az
            if j >= 0:
                slide[j, 0] += change * light[j] * nx
                slide[j, 1] += change * light[j] * ny
                slide[j, 2] += change * light[j] * nz
                spin[j, 0] += change * easy[j] * bx
                spin[j, 1] += change * easy[j] * by
                spin[j, 2] += change * easy[j] * bz
        if most < 1e-12:
            break
