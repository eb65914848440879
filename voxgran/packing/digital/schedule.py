"""What comes between the attempts of digital packing: whose turn it is, and the lid."""

import numpy as np

from voxgran._base.arrays import Integers
from voxgran.lattice.morton import morton_order
from voxgran.packing.digital.container_lattice import container_lattice, free_voxels
from voxgran.packing.digital.precompute import Setting, layer_of_lid, records, voxel_size_of, walls_of_layers
from voxgran.packing.digital.stamping import close_layer, count_layer
from voxgran.packing.method import State
from voxgran.packing.problem import Problem

#: sweeps after which grains are put in the order of space anew
SORT_SWEEPS = 16


def turn_arrays(problem: Problem) -> dict[str, Integers]:
    """Return what the schedule and guided moves keep, empty where they are not asked for."""
    settings, n, nothing = problem.parameters, problem.count, np.zeros(0, dtype=np.int64)
    sleeps = settings.schedule == "sleeping"
    cells = np.ones(4, dtype=np.int64)
    if sleeps:
        lattice = container_lattice(problem, voxel_size_of(problem))
        edge = max(4, int(np.ceil(0.5 / lattice.voxel_size)))
        cells = np.append(-(-lattice.shape // edge) + 1, edge).astype(np.int64)
    return {
        "order": nothing,
        "hint": np.zeros((n if settings.guided > 0 else 0, 3), dtype=np.int64),
        "calm": np.zeros(n if sleeps else 0, dtype=np.int64),
        "depth": np.full(n if sleeps else 0, -(2**40)),
        "slept": np.full(n if sleeps else 0, -1, dtype=np.int64),
        "stirred": np.full(int(np.prod(cells[:3])) if sleeps else 0, -1, dtype=np.int64),
        "cells": cells,
    }


def look_at_turns(problem: Problem, state: State, setting: Setting) -> None:
    """Lower the lid by a voxel where it finds room, and put the grains in the order of space."""
    placed = max(state.counters["placed"], 1)
    if problem.parameters.lid:
        if "walls" not in state.derived:
            state.derived["walls"] = _walls(problem, setting)
        axis, field = int(np.argmax(np.abs(setting.down))), records(state, setting)[0]
        level = layer_of_lid(setting, state.counters["lid_lowered"])
        inside = state.counters["lid_lowered"] < int(setting.lattice.shape[axis])
        if inside and int(count_layer(field, axis, level)) == int(state.derived["walls"][level]):
            close_layer(field, axis, level)
            state.counters["lid_lowered"] += 1
            state.derived["lid"] = True
    if (state.done - state.counters["fed_at"]) % (SORT_SWEEPS * placed) == 0:
        sort_grains(problem, state)


def _walls(problem: Problem, setting: Setting) -> Integers:
    """Return how many voxels of each layer the walls take."""
    return walls_of_layers(setting, setting.canvas.words(free_voxels(problem.container, setting.lattice)))


def lower_lid_again(problem: Problem, state: State, setting: Setting) -> None:
    """Close the layers that the lid had taken, after the state was read from a checkpoint."""
    axis, field = int(np.argmax(np.abs(setting.down))), records(state, setting)[0]
    for lowered in range(state.counters["lid_lowered"]):
        close_layer(field, axis, layer_of_lid(setting, lowered))
    state.derived["lid"] = True


def sort_grains(problem: Problem, state: State) -> None:
    """Put the grains that have entered in the order of space, where the schedule asks for it."""
    if problem.parameters.schedule == "sorted":
        placed = np.flatnonzero(state.arrays["member"] >= 0)
        state.arrays["order"] = placed[morton_order(state.arrays["site"][placed])]
