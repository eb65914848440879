"""Exact Apollonian gaskets: every gap between spheres that touch gets the sphere that touches all of them.

The container decides the gasket: a disk or a sphere holds three or four equal ones around its middle, in a direction
that the seed decides; in a rectangle with one periodic axis, a whole number of heights long, circles touch both walls;
a triangle holds its inscribed circle, and circles toward its corners. The largest grains come first, down to a smallest
diameter, a count or a solid fraction. The number of grains above a size is a power of it, of exponent 1.3057 in the
plane and 2.474 in space.

Shapes that are no spheres are represented by their bounding spheres, in random orientations.

References
----------
Lagarias, Mallows & Wilks 2002, Beyond the Descartes circle theorem, American Mathematical Monthly 109, 338-361,
doi:10.1080/00029890.2002.11920896.
Borkovec, De Paris & Peikert 1994, The fractal dimension of the Apollonian sphere packing, Fractals 2, 521-526,
doi:10.1142/S0218348X94000739: the exponent in space.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.containers.model import boundary_of
from voxgran.geometry.walls import Round
from voxgran.packing.method import Cost, PackingMethod, State, spheres_within
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem, packing_of_spheres
from voxgran.packing.space_filling.gaskets import in_sphere, in_strip, in_triangle

#: number of grains if nothing is asked for
USUAL = 10_000
#: bytes of a grain (measured): in space the search holds many that are too small
GRAIN_BYTES = 3000
#: largest curvature, in the reciprocal size of the container, at which the search begins, and factor of its next one
FIRST, NEXT = 30.0, 1.5
#: largest share of a height by which the length of a strip may differ from a whole number of them
ROUNDING = 1e-9


@parameter_class
class Apollonian:
    """Parameters of the exact gaskets.

    Parameters
    ----------
    smallest
        smallest diameter; default: that of as many grains as are asked for, or of the 10,000 largest.

    Raises
    ------
    InputError
        If the smallest diameter is not above 0.

    Examples
    --------
    >>> import voxgran as vg
    >>> gasket = vg.pack(vg.shapes.disk(), vg.Disk(radius=2), vg.methods.Apollonian(smallest=0.5))
    >>> gasket.count, gasket.dimension
    (6, 2)
    """

    smallest: float | None = parameter(None, unit="length", above=0.0)


@dataclass(frozen=True)
class Gasket:
    """A gasket in the unit in which it is made.

    size: its unit of lengths.  spheres: of a largest curvature, the rows in parts.  place: of centers (n, 2) or (n, 3),
    in that unit, in the container.
    """

    size: float
    spheres: Callable[[float], Iterator[Floats]]
    place: Callable[[Floats], Floats]


def prepare(problem: Problem) -> State:
    """Return the state without grains.

    Raises
    ------
    InputError
        If the container has no gasket.
    """
    gasket_of(problem)
    state = State({"spheres": np.zeros((0, 4))}, {}, 0, 1, declared={"spheres": spheres_within(problem, "spheres")})
    if not problem.count:
        state.stop_reason = "count"
    return state


def gasket_of(problem: Problem) -> Gasket:
    """Return the gasket of the container.

    Raises
    ------
    InputError
        If the container is none of those that have one.
    """
    container, boundary = problem.container, boundary_of(problem.container)
    if wall := boundary.sphere or (boundary.cylinder if problem.dimension == 2 else None):
        return _of_round(problem, wall)
    if problem.dimension == 2 and boundary.is_flat and sum(container.periodic) == 1:
        return _of_strip(problem)
    if len(boundary.loops) == 1 and len(boundary.loops[0]) == 3:
        origin, size = boundary.loops[0][0], float(np.ptp(boundary.loops[0], axis=0).max())
        corners = (boundary.loops[0] - origin) / size
        return Gasket(size, lambda most: in_triangle(corners, most), lambda place: origin + size * place)
    raise InputError(
        f"container is {container.kind!r}: exact gaskets are in a disk, a sphere, a triangle (a polygon of three "
        "corners) or a rectangle with one periodic axis; give one of these, or method='random_apollonian'"
    )


def _of_round(problem: Problem, wall: Round) -> Gasket:
    """Return the gasket of a disk or a sphere, turned at random."""
    dimension, radius = problem.dimension, wall.radius
    u, _, v = linear.svd(stream(problem.seed, "turn").normal(size=(dimension, dimension)))
    # the nearest orthogonal matrix has the same distribution from each side
    turn = linear.matmul(u, v)
    middle = np.array(wall.center[:dimension])
    return Gasket(
        radius, lambda most: in_sphere(dimension, most), lambda place: middle + linear.matmul(radius * place, turn.T)
    )


def _of_strip(problem: Problem) -> Gasket:
    """Return the gasket of a rectangle with one periodic axis, with a random place of the first circle."""
    (lower, upper), along = problem.container.bounds, problem.container.periodic.index(True)
    length, height = (upper - lower)[along], (upper - lower)[1 - along]
    heights = round(length / height)
    if abs(length / height - heights) > ROUNDING or not heights:
        raise InputError(
            f"the periodic length is {length / height:.6g} times the other one: circles that touch both walls fit a "
            f"whole number of times; make it {max(heights, 1)} times as long"
        )
    shift, origin = stream(problem.seed, "shift").random() * length, lower[:2]

    def spheres(most: float) -> Iterator[Floats]:
        for rows in in_strip(most):
            for period in range(heights):
                moved = rows.copy()
                moved[:, 1] += period * rows[:, 0]
                yield moved

    def place(centers: Floats) -> Floats:
        lying = np.column_stack([(centers[:, 0] * height + shift) % length, centers[:, 1] * height])
        return origin + (lying if along == 0 else lying[:, ::-1])

    return Gasket(height, spheres, place)


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Make the gasket, which is one attempt.

    Raises
    ------
    InputError
        If the gasket has more grains down to the smallest diameter than are placed without a count.
    """
    gasket = state.derived.setdefault("gasket", gasket_of(problem))
    if state.stop_reason or not attempts:
        return state
    smallest, rows = problem.parameters.smallest, np.zeros((0, problem.dimension + 2))
    if smallest is not None:
        rows = _up_to(gasket, 2.0 * gasket.size / problem.length(smallest))
        if len(rows) > problem.count and problem.asked_count is None:
            raise InputError(
                f"smallest is {smallest:.6g}: the gasket has {len(rows)} grains down to it, above {problem.count}; "
                "give a larger diameter, or the count of them that is packed"
            )
    else:
        wanted = problem.count if problem.target else USUAL
        most = FIRST
        while len(rows) < wanted and _fraction(problem, gasket, rows) < (problem.asked_fraction or math.inf):
            rows = _up_to(gasket, most)
            most *= NEXT
        rows = rows[:wanted]
    rows = rows[: problem.count]
    state.arrays["spheres"], state.stop_reason = _chosen(problem, gasket, rows)
    state.done = 1
    state.derived.clear()
    return state


def _up_to(gasket: Gasket, most: float) -> Floats:
    """Return the rows of all spheres up to a curvature, the largest first; equal ones by their place."""
    rows = np.concatenate(list(gasket.spheres(most)))
    # curvatures that differ by rounding only are equal
    return np.asarray(rows[np.lexsort([*np.round(rows[:, 1:-1], 6).T, np.round(rows[:, 0], 6)])])


def _volumes(problem: Problem, gasket: Gasket, rows: Floats) -> Floats:
    """Return the volumes of the grains in the spheres, of which the largest are the first grains."""
    radius = gasket.size / rows[: problem.count, 0]
    return np.asarray(problem.unit_volumes[: len(radius)] * libm.power(radius, problem.dimension))


def _fraction(problem: Problem, gasket: Gasket, rows: Floats) -> float:
    """Return the solid fraction of the grains in the spheres."""
    return float(_volumes(problem, gasket, rows).sum()) / problem.container.volume


def _chosen(problem: Problem, gasket: Gasket, rows: Floats) -> tuple[Floats, str]:
    """Return the spheres (n, 4), from the lower corner, down to the solid fraction that is asked for, and why there."""
    reason = "full" if problem.parameters.smallest is not None else "count"
    if problem.asked_fraction is not None:
        total = np.cumsum(_volumes(problem, gasket, rows)) / problem.container.volume
        enough = int(np.searchsorted(total, problem.asked_fraction))
        if enough < len(rows):
            rows, reason = rows[: enough + 1], "solid_fraction"
        elif problem.asked_count is None:
            reason = "full"
    if problem.asked_count is not None and len(rows) == problem.asked_count and reason != "solid_fraction":
        reason = "count"
    centers = gasket.place(rows[:, 1:-1] / rows[:, :1])
    spheres = np.zeros((len(rows), 4))
    spheres[:, : problem.dimension] = centers - problem.container.bounds[0][: problem.dimension]
    spheres[:, 3] = gasket.size / rows[:, 0]
    return spheres, reason


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the gasket."""
    spheres = state.arrays["spheres"]
    return packing_of_spheres(problem, np.arange(len(spheres)), spheres, state.stop_reason, sized=True)


def cost(problem: Problem) -> Cost:
    """Return the cost of a run."""
    return Cost(memory=GRAIN_BYTES * (problem.count if problem.target else USUAL) + 2**22, attempts=1)


registration = PackingMethod(
    summary="exact gaskets: each gap between touching spheres gets the one that touches all of them",
    source="Lagarias, Mallows & Wilks 2002, doi:10.1080/00029890.2002.11920896",
    parameters=Apollonian,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    libraries=(),
    sizing="made",
    no_start="makes exact gaskets, which have no room for other grains",
)
