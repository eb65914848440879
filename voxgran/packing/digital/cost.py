"""What a run of digital packing takes: memory, attempts and solids that are voxelized."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.containers.model import boundary_of
from voxgran.packing.digital.bit_columns import UNPACKED
from voxgran.packing.digital.container_lattice import ContainerLattice, container_lattice
from voxgran.packing.digital.no_fit_tables import table_bytes
from voxgran.packing.digital.precompute import LAZY, SHARED, bases_of, digital_kinds, mean_width, tables_pay
from voxgran.packing.method import Cost
from voxgran.packing.problem import Problem
from voxgran.packing.walking.feeding import planned_attempts, usual_seconds

#: processor time of an attempt on a usual core, in seconds, and of one in a container that is nearly full (measured)
ATTEMPT = 4e-6, 1e-6


def digital_cost(problem: Problem) -> Cost:
    """Return what a run takes."""
    settings = problem.parameters
    lattice = container_lattice(problem)
    width = np.array([mean_width(shape) for shape in problem.shapes])[problem.shape_id] * problem.diameter
    radius = np.array([shape.bounding_radius for shape in problem.shapes])[problem.shape_id] * problem.diameter
    wide, half = width / lattice.voxel_size + 2, np.ceil(radius / lattice.voxel_size) + 1
    tall = wide if problem.dimension == 3 else np.ones_like(wide)
    members = bases_of(problem)
    # each member along each axis, in pieces and then joined; and the bits of each grain, or those that all share
    words = wide * wide * (tall / 64 + 0.5)
    grains = digital_kinds(problem)[1]
    fixed = settings.orientations == 1 or problem.orientation is not None
    turns = 1 if fixed else 24 if problem.dimension == 3 else 4
    shared = members * turns * float(words[grains].sum())
    bits = shared if shared <= SHARED else float(words.sum())
    bank = 2 * 3 * members * 8 * float(words[grains].sum()) + 8 * bits
    masks = float(((2 * half) ** problem.dimension).mean()) if problem.count else 0.0
    different = _different_masks(problem)
    kept = min(problem.cache.limit, different * masks)
    largest = 2 * float(radius.max(initial=0.0)) / lattice.voxel_size + 4
    margin = np.where(np.array(problem.container.periodic), largest, 1.0)
    canvas = float(np.prod(lattice.shape + 2 * margin + np.array([0, 0, 64]))) / 8
    tables = _bytes_of_tables(problem, lattice, width, turns)
    # what is free is found voxel by voxel where the walls are not those of the lattice
    even = boundary_of(problem.container).is_flat
    unpacked = 4 * UNPACKED + (0.0 if even else 2.5 * float(np.prod(lattice.shape)))
    return Cost(
        memory=int((tables or canvas + unpacked) + bank + kept),
        seconds=usual_seconds(problem, *ATTEMPT),
        attempts=planned_attempts(problem),
        voxelized_shapes=different,
    )


def _bytes_of_tables(problem: Problem, lattice: ContainerLattice, width: Floats, turns: int) -> float:
    """Return what the tables of pairs take where they replace the canvas, made in pieces and joined; else 0."""
    grains, members = digital_kinds(problem)[1], bases_of(problem)
    if not len(grains) or members >= LAZY:
        return 0.0
    touched = 1.5 * lattice.voxel_size if problem.parameters.cover == "touch" else 0.0
    filled = problem.volumes * ((width + touched) / width / lattice.voxel_size) ** problem.dimension
    wide = np.ceil((width[grains] + touched) / lattice.voxel_size).astype(np.int64)
    tall = wide if problem.dimension == 3 else np.ones_like(wide)
    size = np.repeat(np.column_stack([wide, wide, tall]), members, axis=0)
    voxels = float(filled[grains].mean())
    if not tables_pay(problem, lattice.shape, size=size, low=-(size // 2), voxels=voxels, turns=turns):
        return 0.0
    return 2.0 * table_bytes(size, turns)


def _different_masks(problem: Problem) -> int:
    """Return how many sets of voxels differ; a sphere looks the same in all orientations."""
    grains = digital_kinds(problem)[1]
    sphere = np.array([shape.is_sphere for shape in problem.shapes], dtype=np.bool_)[problem.shape_id]
    alike = np.column_stack([problem.shape_id, problem.diameter])[grains[sphere[grains]]]
    return len(np.unique(alike, axis=0)) + bases_of(problem) * int(np.count_nonzero(~sphere[grains]))
