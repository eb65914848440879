"""Work between the attempts of digital packing: the order in which grains are moved, and the lid."""

import numpy as np

from voxgran.geometry.morton import morton_order
from voxgran.packing.digital.container_lattice import container_lattice
from voxgran.packing.digital.precompute import layer_of_lid, precomputed_of, records, walls_of_layers
from voxgran.packing.digital.stamping import close_layer, count_layer
from voxgran.packing.digital.state import DigitalState
from voxgran.packing.problem import Problem

#: sweeps after which grains are sorted along the space-filling curve again
SORT_SWEEPS = 16


def begin_schedule(problem: Problem, state: DigitalState) -> None:
    """Make the arrays of the state that guided moves and the schedule "sleeping" need."""
    n = problem.count
    if problem.parameters.guided > 0:
        state.hint = np.zeros((n, 3), dtype=np.int64)
    if problem.parameters.schedule == "sleeping":
        lattice = container_lattice(problem)
        edge = max(4, int(np.ceil(0.5 / lattice.voxel_size)))
        state.cells = np.append(-(-lattice.shape // edge) + 1, edge).astype(np.int64)
        state.stirred = np.full(int(np.prod(state.cells[:3])), -1, dtype=np.int64)
        state.calm, state.depth, state.slept = np.zeros(n, dtype=np.int64), np.full(n, -(2**40)), np.full(n, -1)


def lower_lid(problem: Problem, state: DigitalState) -> None:
    """Lower the lid by one voxel if the next layer is free of grains."""
    known = precomputed_of(problem, state)
    if "walls" not in state.derived:
        state.derived["walls"] = walls_of_layers(problem, known)
    axis, field, lattice = known.axis, records(state, known).field, known.lattice
    level = layer_of_lid(known, state.lid_layers)
    if state.lid_layers >= lattice.shape[axis] or int(count_layer(field, axis, level)) != state.derived["walls"][level]:
        return
    close_layer(field, axis, level)
    state.lid_layers += 1
    lower, upper = problem.container.bounds
    low = lattice.corner[axis] + state.lid_layers * lattice.voxel_size
    high = lattice.corner[axis] + (lattice.shape[axis] - state.lid_layers) * lattice.voxel_size
    state.lid_lowered = max(0.0, float(upper[axis] - high if known.down[axis] < 0 else low - lower[axis]))


def sort_grains(state: DigitalState) -> None:
    """Sort the grains that have entered along a space-filling curve."""
    placed = np.flatnonzero(state.member >= 0)
    state.order = placed[morton_order(state.site[placed])]
