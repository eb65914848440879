"""Tetrahedral: spheres in the cells of a mesh, then at its nodes, edges and faces, then in all holes that remain.

A mesh of tetrahedra (triangles in two dimensions) fills the container. Each cell gets its inscribed sphere (Cui &
O'Sullivan 2003). The largest sphere that fits is then placed at each node, edge, face and corner of a cell (Jerier et
al. 2009, 2010), and in the holes that these leave: each touches four spheres or walls (three in two dimensions), found
by a climb to the largest clearance nearby. Within one kind of places the largest spheres come first. The sizes follow
from the mesh; their limits are parameters.

Shapes that are no spheres are inscribed in the spheres by their bounding spheres, in random orientations.

The cells of mesh files are read by meshio in a process of its own.

References
----------
Cui & O'Sullivan 2003, Granular Matter 5, 135-145.
Jerier et al. 2009, A geometric algorithm based on tetrahedral meshes to generate a dense polydisperse sphere packing,
Granular Matter 11, doi:10.1007/s10035-008-0116-0.
Jerier et al. 2010, Packing spherical discrete elements for large scale simulations, Computer Methods in Applied
Mechanics and Engineering, doi:10.1016/j.cma.2010.01.016.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers, check_coordinates
from voxgran._base.checkpoint import FAR, Held
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import FileFormatError, InputError
from voxgran._base.files import existing_file
from voxgran._base.guarded import Content, read_guarded
from voxgran._base.lazy import load
from voxgran._base.stopping import stop_if_asked
from voxgran.packing.method import Cost, PackingMethod, State, spheres_within
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem, packing_of_spheres, spheres_of_start
from voxgran.packing.tessellation.climb import HINT, MOST
from voxgran.packing.tessellation.filling import COLUMNS, KIND, Walls, climbed, last_places, next_places, taken, wrapped
from voxgran.packing.tessellation.mesh import CELL, CellMesh, lattice_mesh, lattice_points, places_of, thickness

#: bytes of a sphere (measured)
GRAIN_BYTES = 1500
#: waves, at most
WAVES = 1000
#: cells of a mesh where nothing else says how many; the fewest of a mesh made for a count, and spheres per cell then
CELLS, FEWEST, PER_CELL = 2000, 200, {2: 1.5, 3: 2.0}
#: spheres by default where the container is thin, at most and about, and points of a lattice of fewer cells, at most
SPHERES, MOST_POINTS = 50_000, 200_000
#: spheres that fill a volume, times the smallest diameter to the power of the dimension (measured; less in thin plates)
PER_VOLUME = 0.2
#: volume of a cell by its edge, and the diameter of the sphere inscribed in a regular one
CELL_VOLUME = {2: math.sqrt(3.0) / 4.0, 3: 1.0 / 12.0 / ((1.0 + math.sqrt(3.0)) / 3.0) ** 3}
INSCRIBED = {2: 1.0 / math.sqrt(3.0), 3: 1.0 / math.sqrt(6.0)}
#: bytes of a point of the lattice (estimated), and factor from one edge that is tried to the next
POINT_BYTES, LONGER = 120, 1.1
#: smallest diameter where none is given: in edges or thicknesses, and in thicknesses of the thinnest containers
SMALLEST, THIN = 0.2, 0.5
#: overlap that is rounding, in lengths of the container
ROUNDING = 1e-15


@parameter_class
class Tetrahedral:
    """Parameters of a packing by a mesh.

    Parameters
    ----------
    edge
        mean edge of the cells, which are flat where the container is thinner; left out: by the largest diameter, by the
        count, or for about 2000 cells.
    smallest
        smallest diameter of a sphere; left out: a fifth of the edge or of the thickness of the container (twice the
        volume over the surface), whichever is less; larger, up to half the thickness, where neither edge, largest nor
        count is given and that would take more than about 50,000 spheres.
    largest
        largest diameter of a sphere; left out: as the cells give.
    jitter
        range of random displacements of the nodes, in edges.
    mesh
        file of a mesh of tetrahedra (2D: triangles) with the lengths of the container, instead of one made here.

    Raises
    ------
    InputError
        If a number is out of its range, or the smallest diameter is larger than the largest.

    Examples
    --------
    >>> import voxgran as vg
    >>> packing = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), vg.methods.Tetrahedral(edge=1.0))
    >>> packing.verify().ok
    True
    """

    edge: float | None = parameter(None, unit="length", above=0.0)
    smallest: float | None = parameter(None, unit="length", above=0.0)
    largest: float | None = parameter(None, unit="length", above=0.0)
    jitter: float = parameter(0.3, at_least=0.0, at_most=1.0)
    mesh: str | None = parameter(None)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self)
        if self.smallest is not None and self.largest is not None and self.smallest > self.largest:
            raise InputError(
                f"smallest is {self.smallest:g} and largest is {self.largest:g}: diameters lie between them; exchange "
                "them"
            )


@dataclass(frozen=True, slots=True)
class Limits:
    """Edge of the cells, and the smallest and the largest radius, in the unit of the problem."""

    edge: float
    smallest: float
    largest: float


def limits_of(problem: Problem) -> Limits:
    """Return the lengths that are given, or follow from others."""
    settings: Tetrahedral = problem.parameters
    largest = math.inf if settings.largest is None else problem.length(settings.largest)
    thick = thickness(problem.container)
    edge = _usual_edge(problem, largest) if settings.edge is None else problem.length(settings.edge)
    if settings.smallest is not None:
        smallest = problem.length(settings.smallest)
    else:
        smallest = SMALLEST * min(edge, thick)
        if settings.edge is None and problem.asked_count is None and largest >= thick:
            few = (PER_VOLUME * problem.container.volume / SPHERES) ** (1.0 / problem.dimension)
            smallest = max(smallest, min(THIN * thick, few))
    return Limits(edge, 0.5 * min(smallest, largest), 0.5 * largest)


def _usual_edge(problem: Problem, largest: float) -> float:
    """Return the edge of the cells where none is given.

    In thin containers cells are flat, and spheres grow from them into all of the holes around.
    """
    container, dimension = problem.container, problem.dimension
    if largest < math.inf:
        return min(largest / INSCRIBED[dimension], float((container.bounds[1] - container.bounds[0]).max()))
    wanted = CELLS
    if problem.asked_count is not None:
        wanted = max(FEWEST, int(problem.asked_count / PER_CELL[dimension]))
    edge = (container.volume / (wanted * CELL_VOLUME[dimension])) ** (1.0 / dimension)
    # the lattice fills the bounds, however little of them the container takes
    while lattice_points(container, edge) > max(MOST_POINTS, wanted):
        edge *= LONGER
    return edge


def prepare(problem: Problem) -> State:
    """Return the state in which all places of the mesh wait, and only the grains of the start are placed.

    Raises
    ------
    InputError
        If the edge is longer than the container, no cell of the mesh lies in that, or a grain of the start overlaps
        another or reaches beyond a wall.
    FileFormatError
        If the file of the mesh is damaged or has no cells.
    MissingFileError
        If there is no such file.
    """
    spheres = spheres_of_start(problem)
    queue = np.zeros((0, COLUMNS)) if len(spheres) == problem.count else _first_queue(problem)
    far, all_spheres = 2.0 * float(np.ptp(problem.container.bounds, axis=0).max()), spheres_within(problem, "spheres")
    # places, and hints, largest radii (infinite without a largest size) and kinds, which are not negative
    low, high = [-far] * 3 + [0.0] * 3, [far] * 3 + [FAR, math.inf, FAR]
    declared = {"spheres": all_spheres, "queue": Held(low, high, "queue"), "swept": Held(0, 1)}
    rule = lambda arrays, _: problem.started <= len(arrays["spheres"]) <= problem.count  # noqa: E731
    state = State({"spheres": spheres, "queue": queue}, {"swept": 0}, 0, WAVES, declared=declared, rule=rule)
    _look(problem, state)
    return state


def _first_queue(problem: Problem) -> Floats:
    """Return all places of the mesh."""
    settings: Tetrahedral = problem.parameters
    limits, container = limits_of(problem), problem.container
    longest = float((container.bounds[1] - container.bounds[0]).max())
    if limits.edge > longest * (1.0 + 1e-12):
        raise InputError(
            f"edge is {limits.edge * problem.unit_length:.6g}: no cell is longer than the container of "
            f"{longest * problem.unit_length:.6g}; give a smaller one"
        )
    if settings.mesh is None:
        mesh = lattice_mesh(container, limits.edge, settings.jitter, problem.seed)
    else:
        nodes, cells = read_cells(settings.mesh, problem.dimension)
        mesh = CellMesh(nodes / problem.unit_length, cells)
    if not len(mesh.cells):
        raise InputError(
            f"edge is {limits.edge * problem.unit_length:.6g}: no cell of that size lies in the container; give a "
            "smaller one"
        )
    place, radius, kind = places_of(mesh, container)
    walls = Walls(container)
    queue = np.zeros((len(place), COLUMNS))
    queue[:, :3] = wrapped(place - walls.lower, walls)
    queue[:, HINT], queue[:, KIND] = radius, kind
    most = min(limits.largest, walls.widest)
    queue[:, MOST] = np.where(kind == CELL, np.minimum(radius, most), most)
    return queue


def advance(problem: Problem, state: State, attempts: int) -> State:
    """Make up to `attempts` waves, each of which fills places of one kind."""
    if "walls" not in state.derived:
        state.derived["walls"], state.derived["limits"] = Walls(problem.container), limits_of(problem)
    last = min(state.done + attempts, state.total)
    while state.done < last and not state.stop_reason:
        _fill(problem, state)
        state.done += 1
        _look(problem, state)
    return state


def _fill(problem: Problem, state: State) -> None:
    """Climb from all places of the first kind, take the largest spheres, and queue the places that these leave.

    When the queue is empty it is filled once more, from a triangulation of the spheres.
    """
    walls, limits = state.derived["walls"], state.derived["limits"]
    spheres, queue = state.arrays["spheres"], state.arrays["queue"]
    most = min(limits.largest, walls.widest)
    if not len(queue):
        stop_if_asked()
        state.counters["swept"] = 1
        state.arrays["queue"] = last_places(spheres, walls, limits.smallest, most)
        return
    first = queue[:, KIND] == queue[:, KIND].min()
    wave = queue[first]
    found, normals = climbed(spheres, wave, walls, limits.smallest)
    found[:, :3] = wrapped(found[:, :3], walls)
    chosen, again = taken(found, walls, ROUNDING * walls.size)
    repeat = wave[again]
    repeat[:, :3], repeat[:, HINT] = found[again, :3], found[again, 3]
    after = next_places(found[chosen], normals[chosen], walls, most)
    state.arrays["queue"] = np.concatenate([queue[~first], repeat, after])
    state.arrays["spheres"] = np.concatenate([spheres, _as_asked(problem, spheres, found[chosen], limits.smallest)])


def _as_asked(problem: Problem, spheres: Floats, more: Floats, smallest: float) -> Floats:
    """Return the spheres up to the count and the solid fraction that are asked for; the last one meets the latter."""
    more = more[: problem.count - len(spheres)]
    if problem.asked_fraction is None:
        return more
    volume = _added(problem, np.concatenate([spheres, more]))
    wanted = problem.asked_fraction * problem.container.volume
    enough = int(np.searchsorted(volume, wanted * (1.0 - 1e-13)))
    last = enough - (len(spheres) - problem.started)
    if last >= len(more):
        return more
    more = more[: last + 1].copy()
    own = volume[enough] - (volume[enough - 1] if enough else 0.0)
    part = libm.power(1.0 - (volume[enough] - wanted) / own, 1.0 / problem.dimension)
    more[last, 3] = max(part * more[last, 3], smallest)
    return more


def _added(problem: Problem, spheres: Floats) -> Floats:
    """Return the running sums of the true volumes of grains in spheres, without those of the start."""
    return np.cumsum(volumes_of(problem, spheres[:, 3])[problem.started :])


def volumes_of(problem: Problem, radius: Floats) -> Floats:
    """Return the true volumes of the grains in spheres of these radii."""
    shapes = np.array([shape.volume / shape.bounding_radius**problem.dimension for shape in problem.shapes])
    return np.asarray(shapes[problem.shape_id[: len(radius)]] * libm.power(radius, problem.dimension))


def _look(problem: Problem, state: State) -> None:
    """Set the stop reason."""
    spheres = state.arrays["spheres"]
    # summed up as when the last sphere was sized: otherwise rounding decides
    volume = _added(problem, spheres)[-1] if len(spheres) > problem.started else 0.0
    if len(spheres) == problem.count:
        state.stop_reason = "count"
    elif problem.asked_fraction is not None and volume >= problem.asked_fraction * problem.container.volume * (
        1.0 - 1e-13
    ):
        state.stop_reason = "solid_fraction"
    elif not len(state.arrays["queue"]) and state.counters["swept"]:
        state.stop_reason = "full"
    elif state.done >= state.total:
        state.stop_reason = "steps"
    if state.stop_reason:
        state.arrays["queue"] = np.zeros((0, COLUMNS))
        state.derived.clear()


def finish(problem: Problem, state: State) -> Packing:
    """Return the packing of the spheres that were placed."""
    spheres, limits, unit = state.arrays["spheres"], limits_of(problem), problem.unit_length
    told = {"parameters": {"edge": limits.edge * unit, "smallest": 2.0 * limits.smallest * unit}}
    grains = np.arange(len(spheres))
    return packing_of_spheres(problem, grains, spheres, state.stop_reason, sized=True, provenance=told)


def cost(problem: Problem) -> Cost:
    """Return the cost of a run."""
    limits, dimension, volume = limits_of(problem), problem.dimension, problem.container.volume
    cells = volume / (CELL_VOLUME[dimension] * limits.edge**dimension)
    spheres = max(2.0 * PER_CELL[dimension] * cells, PER_VOLUME * volume / (2.0 * limits.smallest) ** dimension)
    many = max(min(spheres, problem.count), cells)
    points = 0.0 if problem.parameters.mesh is not None else lattice_points(problem.container, limits.edge)
    memory = int(GRAIN_BYTES * many + POINT_BYTES * points) + 2**22
    return Cost(memory=memory, attempts=WAVES if problem.count else 0)


registration = PackingMethod(
    summary="spheres in the cells of a tetrahedral mesh, at its nodes, edges and faces, and in all holes that remain",
    source="Cui & O'Sullivan 2003, Granular Matter 5, 135; Jerier et al. 2009, doi:10.1007/s10035-008-0116-0",
    parameters=Tetrahedral,
    prepare=prepare,
    advance=advance,
    finish=finish,
    cost=cost,
    dimensions=(2, 3),
    libraries=("numba", "scipy"),
    any_container=True,
    sizing="made",
    start="placed",
)


#: names of cells in meshio, by the dimension of the mesh; of those with more nodes the corners come first
KINDS = {2: ("triangle", "triangle6"), 3: ("tetra", "tetra10")}


def read_cells(path: str, dimension: int) -> tuple[Floats, Integers]:
    """Return the nodes (n, 3) and the cells (m, dimension + 1) of a mesh in any format that meshio knows by its suffix.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is damaged, or has no cells of that dimension.
    """
    found = existing_file(path)
    _, arrays = read_guarded(meshio_cells, found, dimension=dimension)
    points, cells = arrays["points"], arrays["cells"].astype(np.int64)
    if not len(cells):
        raise FileFormatError(f"{found} holds no {KINDS[dimension][0]} cells: a mesh needs them; export them too")
    if cells.min() < 0 or cells.max() >= len(points) or not np.isfinite(points).all():
        raise FileFormatError(f"{found} has cells of nodes that it does not hold: it is cut or damaged; write it again")
    try:
        check_coordinates(points, "coordinate")
    except InputError as error:
        raise FileFormatError(f"{found}: {error}") from error
    return points, cells


def meshio_cells(path: Path, *, dimension: int) -> Content:
    """Read the nodes and the cells of a mesh file, to be run by `read_guarded`."""
    mesh = load("meshio").read(str(path))
    blocks = [np.asarray(block.data)[:, : dimension + 1] for block in mesh.cells if block.type in KINDS[dimension]]
    cells = np.concatenate([np.zeros((0, dimension + 1), np.int64), *blocks])
    nodes = np.zeros((len(mesh.points), 3))
    nodes[:, :dimension] = np.asarray(mesh.points)[:, :dimension]
    return {}, {"points": nodes, "cells": cells}
