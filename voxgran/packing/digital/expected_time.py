"""How long searches of a whole lattice take, and the voxels that they use by default.

The times are counts of the steps of the inner loops, times what a step takes on a usual processor core. They do not
depend on the machine, so that the default voxels are the same everywhere.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.containers.model import boundary_of
from voxgran.packing.digital.oriented_voxels import kinds_of, lattice_turns
from voxgran.packing.digital.precompute import mean_width
from voxgran.packing.problem import Problem
from voxgran.shapes.primitive import Primitive

#: seconds to join a column of one grain to one of another, a column of a map to another, to look at a place of a map,
#: to make a table, and to try a candidate of random sequential addition
COLUMN, JOINED, PLACE, TABLE, CANDIDATE = 3e-9, 1e-9, 1e-8, 2e-5, 2.5e-7
#: part of the container from which on random sequential addition may have to try all candidates
NEARLY_FULL = 0.2


def filling_seconds(problem: Problem, voxel_size: float) -> float:
    """Return the expected CPU time of digital filling with voxels of a size in median diameters."""
    wide, poses, share = _kinds(problem, voxel_size)
    x, y, z = _voxels(problem, voxel_size)
    every = float(poses.sum())
    runs, columns = 0.8 * wide**2, wide**2 * np.ceil(wide / 64)
    walls = 0.0 if boundary_of(problem.container).is_flat else x * y * math.ceil(z / 64) * float((poses * runs).sum())
    # kinds of one grain meet the grains that came before them, others all of them
    met = 0.5 if len(poses) == problem.count else 1.0
    joins = met * every * problem.count
    tables = met * every * min(problem.count, every)
    table = TABLE + COLUMN * float((poses * runs).sum() / max(every, 1.0)) * float((share * columns).sum())
    joined = float((share * (2 * wide) ** 2 * np.ceil(2 * wide / 64)).sum())
    places = x * y * (z * every / 3 + problem.count * float((share * poses).sum()))
    return COLUMN * walls + tables * table + joins * (TABLE / 2 + JOINED * joined) + PLACE * places


def addition_seconds(problem: Problem, voxel_size: float) -> float:
    """Return the expected CPU time of random sequential addition on a lattice, as :func:`filling_seconds`."""
    poses = _kinds(problem, voxel_size)[1]
    candidates = math.prod(_voxels(problem, voxel_size)) * float(poses.sum())
    full = float(problem.volumes.sum() / problem.container.volume) / NEARLY_FULL if problem.target else 1.0
    return CANDIDATE * candidates * min(full, 1.0)


def maps_and_masks(problem: Problem, voxel_size: float) -> tuple[float, float]:
    """Return how many maps digital filling keeps at the most, and the bytes of the voxels of all poses.

    The maps of a kind are kept until its last grain has come: those of kinds of one grain one after the other.
    """
    wide, poses, share = _kinds(problem, voxel_size)
    several = share * problem.count > 1.5
    maps = float(poses[several].sum()) + float(poses[~several].max(initial=0.0))
    tall = wide if problem.dimension == 3 else np.ones_like(wide)
    return maps, float((poses * wide**2 * (tall + 8 * np.ceil(tall / 64))).sum())


def _kinds(problem: Problem, voxel_size: float) -> tuple[Floats, Floats, Floats]:
    """Return the width in voxels, the number of poses and the share of the grains of each kind."""
    settings, (kind, first) = problem.parameters, kinds_of(problem)
    shapes = problem.shape_id[first]
    width = np.array([mean_width(shape) for shape in problem.shapes])[shapes] * problem.diameter[first]
    turns = len(lattice_turns(problem)) if settings.turned else 1
    # in the pose that is given, primitives look alike in all rotations but 6, spheres in all of them
    alike = np.array([6 if isinstance(shape.geometry, Primitive) else 24 for shape in problem.shapes])[shapes]
    sphere = np.array([shape.is_sphere for shape in problem.shapes], dtype=np.bool_)[shapes]
    poses = np.where(
        sphere,
        1.0,
        turns * ((settings.orientations if problem.orientation is None else 1) - 1.0) + np.minimum(turns, alike),
    )
    return width / voxel_size + 2, poses, np.bincount(kind, minlength=len(first)) / max(problem.count, 1)


def _voxels(problem: Problem, voxel_size: float) -> tuple[float, float, float]:
    """Return the number of voxels of the container along each axis."""
    lower, upper = problem.container.bounds
    x, y, z = np.maximum((upper - lower) / voxel_size, 1.0).tolist()
    return x, y, z if problem.dimension == 3 else 1.0
