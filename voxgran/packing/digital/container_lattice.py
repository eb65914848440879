"""The lattice of a container: how many voxels, where, and which of them grains may take."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import WHOLE, Booleans, Floats, Integers
from voxgran._base.errors import InputError, TooLargeError
from voxgran.contacts.inside import Occupied
from voxgran.containers.model import UNKNOWN, Container, boundary_of
from voxgran.lattice.grid import Grid, check_voxel_size
from voxgran.packing.problem import COARSEST, Problem
from voxgran.voxels.occupy import occupy

#: voxels of a container at the most, one bit each
MOST_VOXELS = 2**40
#: expected CPU time of a search, in seconds, beyond which voxels are larger by default
LONG = 10.0
#: number of sizes of voxels, each smaller by 5 percent, that are tried where the container is hardly wider than a grain
NARROW = 44
#: orientations in the bank of a grain at the most
MOST_ORIENTATIONS = 10**6


@dataclass(frozen=True, slots=True)
class ContainerLattice:
    """Voxels over the bounds of a container."""

    corner: Floats  # (3,): lower corner of voxel (0, 0, 0), in median diameters
    voxel_size: float  # in median diameters
    shape: Integers  # (3,): whole voxels along x, y, z; 1 along z in 2D


def container_lattice(problem: Problem) -> ContainerLattice:
    """Return the lattice of the container with voxels no larger than asked, a whole number along periodic axes.

    Raises
    ------
    InputError
        If a voxel is larger than the container, or no voxel size down to half of it divides all periodic lengths.
    TooLargeError
        If there are more than 2**40 voxels.
    """
    container, asked = problem.container, problem.parameters.voxel_size
    voxel_size = _usual_voxel_size(problem) if asked is None else problem.length(asked)
    lower, upper = container.bounds
    lengths = (upper - lower)[: container.dimension]
    if float(libm.log2(np.maximum(lengths / voxel_size, 1.0)).sum()) > libm.log2(MOST_VOXELS):
        raise TooLargeError(
            f"voxel_size is {voxel_size * problem.unit_length:.6g}: the voxels of the container would take more than "
            f"{MOST_VOXELS // 2**33} GiB, a bit each; make them larger"
        )
    check_voxel_size(voxel_size * problem.unit_length, float(lengths.min()) * problem.unit_length, "the container")
    wraps = [k for k in range(container.dimension) if container.periodic[k]]
    size = _dividing_size(lengths[wraps], voxel_size, problem.unit_length) if wraps else voxel_size
    counts = np.ones(3, dtype=np.int64)
    counts[: container.dimension] = np.maximum(np.floor(lengths / size + WHOLE), 1)
    return ContainerLattice(lower.copy(), float(size), counts)


def _usual_voxel_size(problem: Problem) -> float:
    """Return the default voxel size: that of the method, or a larger one where the search would take long with it, or a
    smaller one where the container is hardly wider than a grain.

    It is no larger than a tenth of the median diameter.
    """
    size, seconds = problem.parameters.usual_voxel_size, getattr(problem.parameters, "expected_seconds", None)
    while seconds is not None and size < COARSEST and seconds(problem, size) > LONG:
        size = min(1.1 * size, COARSEST)
    finer = size * libm.power(1.05, -np.arange(float(NARROW)))
    sizes = [float(size), *_sizes_of_column(problem, size), *map(float, finer[1:])]
    # a column that fills the container to the last digit has one grain less than it could hold
    tries = ((smaller, column) for column in (True, False) for smaller in sizes)
    return next((smaller for smaller, column in tries if _has_places(problem, smaller, column=column)), float(size))


def _sizes_of_column(problem: Problem, size: float) -> list[float]:
    """Return voxel sizes below another one of which a column of grains one above the other has a whole number."""
    room, edges = _room_between_walls(problem), [_edges(problem, k).max() for k in range(len(problem.shapes))]
    longest, many = max(edges), _in_column(problem, room, np.full(problem.dimension, max(edges)))
    if many < 2 or not np.isfinite(room[-1]):
        return []
    halves = np.arange(NARROW) + np.floor(longest / (2.0 * size)) + 1.0
    found: list[float] = (room[-1] / (2.0 * many * halves)).tolist()
    return [smaller for smaller in found if smaller <= size]


def _in_column(problem: Problem, room: Floats, edges: Floats) -> int:
    """Return how many grains of sorted edges lie one above the other in a container where no two lie side by side."""
    if edges[0] <= 0.0:
        return 1
    many = np.floor(room / edges + WHOLE)
    return int(min(many[-1], problem.count)) if (many[:-1] == 1.0).all() else 1


def _room_between_walls(problem: Problem) -> Floats:
    """Return the lengths of a container, the smallest first, which are infinite along periodic axes."""
    container = problem.container
    lengths = np.where(container.periodic, np.inf, container.bounds[1] - container.bounds[0])
    return np.sort(lengths[: problem.dimension])


def _edges(problem: Problem, shape: int) -> Floats:
    """Return the edges of the bounds of the largest grain of a shape, the smallest first."""
    largest = problem.diameter[problem.shape_id == shape].max(initial=0.0)
    return np.sort(np.ptp(problem.shapes[shape].bounds, axis=0)[: problem.dimension] * largest)


def _has_places(problem: Problem, size: float, *, column: bool) -> bool:
    """Return whether the voxels of the largest grain of each shape, turned along the axes, fit between plane walls,
    and those of all grains that a column of single ones holds.

    A grain that is wider than the container counts for nothing: no voxels help.
    """
    if not boundary_of(problem.container).is_flat:
        return True
    room = _room_between_walls(problem)
    for k in range(len(problem.shapes)):
        edges = _edges(problem, k)
        taken = 2.0 * (np.floor(edges / (2.0 * size) + WHOLE) + 1.0)
        taken[-1] *= _in_column(problem, room, edges) if column else 1
        if (edges <= room).all() and (taken > np.floor(room / size + WHOLE)).any():
            return False
    return True


def _dividing_size(lengths: Floats, voxel_size: float, unit: float) -> float:
    """Return the largest size, not above the one asked for, that divides all lengths."""
    fewest = int(np.ceil(lengths[0] / voxel_size - WHOLE))
    for count in range(max(fewest, 1), 2 * max(fewest, 1) + 1):
        size = lengths[0] / count
        parts = lengths / size
        if np.all(np.abs(parts - np.rint(parts)) <= WHOLE * np.maximum(parts, 1.0)):
            return float(size)
    raise InputError(
        f"no voxel_size from {voxel_size * unit / 2:.6g} to {voxel_size * unit:.6g} divides the periodic lengths "
        f"{(lengths * unit).tolist()}: make their ratio a simple fraction"
    )


def free_voxels(container: Container, lattice: ContainerLattice) -> Booleans | None:
    """Return the mask (nx, ny, nz) of the voxels that lie wholly inside the container; None where all do."""
    if isinstance(container, Occupied):
        clear, inside = _clear_of_solids(container, lattice), free_voxels(container.container, lattice)
        return clear if inside is None else clear & inside
    walls = boundary_of(container)
    if walls.is_flat:
        return None
    x, y, z = (int(n) for n in lattice.shape)
    corner = (float(lattice.corner[0]), float(lattice.corner[1]), float(lattice.corner[2]))
    if walls.solid is not None:
        # touched from inside the solid and touched from outside: what is inside and not on the surface is free
        grid = Grid(corner, lattice.voxel_size, (x, y, z))
        offset = np.asarray(walls.solid.offset)
        surface = occupy(walls.solid, grid, offset=offset, cover="surface")
        return occupy(walls.solid, grid, offset=offset, cover="center") & ~surface
    if walls is UNKNOWN:
        return _far_from_walls(container, lattice)
    # these are convex: a cube lies inside when its corners do
    axes = [corner[k] + np.arange(n + 1) * lattice.voxel_size for k, n in enumerate((x, y, z))]
    inside = np.zeros((x + 1, y + 1, z + 1), dtype=bool)
    for k, height in enumerate(axes[2]):
        points = np.stack(np.broadcast_arrays(axes[0][:, None], axes[1][None, :], height), axis=-1)
        inside[:, :, k] = container.signed_distance(points.reshape(-1, 3)).reshape(x + 1, y + 1) <= WHOLE
    for axis in range(3):
        inside = np.delete(inside, -1, axis) & np.delete(inside, 0, axis)
    return inside


def _far_from_walls(container: Container, lattice: ContainerLattice) -> Booleans:
    """Return which voxels have a center farther inside than their corners are from it, whatever the container."""
    size, flat = lattice.voxel_size, container.dimension == 2
    x, y, z = (lattice.corner[k] + (np.arange(n) + 0.5) * size for k, n in enumerate(lattice.shape))
    inside = np.zeros(lattice.shape.tolist(), dtype=bool)
    for k, height in enumerate([0.0] if flat else z):
        points = np.stack(np.broadcast_arrays(x[:, None], y[None, :], height), axis=-1).reshape(-1, 3)
        depth = -np.asarray(container.signed_distance(points))
        inside[:, :, k] = (depth >= 0.5 * size * np.sqrt(container.dimension)).reshape(inside.shape[:2])
    return inside


def _clear_of_solids(container: Occupied, lattice: ContainerLattice) -> Booleans:
    """Return which voxels have a center farther from all solids in a container than their corners are from it."""
    size, clear = lattice.voxel_size, np.ones(lattice.shape.tolist(), dtype=bool)
    away = 0.5 * size * np.sqrt(container.dimension)
    for place, radius, depth in container.solids():
        first = np.clip(np.floor((place - radius - away - lattice.corner) / size), 0, lattice.shape).astype(int)
        last = np.clip(np.ceil((place + radius + away - lattice.corner) / size), 0, lattice.shape).astype(int)
        x, y, z = (lattice.corner[k] + (np.arange(first[k], last[k]) + 0.5) * size for k in range(3))
        for k, height in enumerate([0.0] * len(z) if container.dimension == 2 else z):
            points = np.stack(np.broadcast_arrays(x[:, None], y[None, :], height), axis=-1).reshape(-1, 3)
            here = clear[first[0] : last[0], first[1] : last[1], first[2] + k]
            here &= (depth(points) <= -away).reshape(here.shape)
    return clear


def positions_on(lattice: ContainerLattice, site: Integers, dimension: int) -> Floats:
    """Return the positions of lattice corners, (m, 3), in median diameters; z = 0 in two dimensions."""
    position = lattice.corner + site * lattice.voxel_size
    if dimension == 2:
        position[:, 2] = 0.0
    return np.asarray(position)
