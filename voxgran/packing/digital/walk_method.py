"""Digital packing: grains and container are voxels, and grains move over the lattice one voxel at a time.

An attempt selects a grain and moves it one voxel in one of 26 directions (8 in two dimensions) or rotates it to another
of its orientations; it is refused if a voxel would be occupied twice. Directions are equally likely, or biased downward
by gravity, with cycles of vibration in which upward moves are allowed and become rarer. Only voxels that a move newly
covers are tested, 64 at a time (:mod:`voxgran.packing.digital.stamping`), or pairs of grains by tables where grains are
large and alike (:mod:`voxgran.packing.digital.no_fit_tables`). The cost of a move does not depend on the complexity of
the shape. With ``cover="touch"`` the voxels of a grain contain the whole grain: grains that share no voxel do not
overlap, and the packing is free of overlaps between the true solids.

Orientations: each grain has random base orientations of its own, and of each the 24 rotations that map the lattice onto
itself, which need no voxelization. Rotations are about the centroid, which stays at its corner of the lattice.

Schedules: ``random`` selects any grain. ``sorted`` selects 512 times among 64 grains that are neighbors along a
space-filling curve (Morton 1966), then among the next 64, so that their voxels stay in the processor cache.
``sleeping`` skips a grain that has not sunk in 128 attempts, until a grain near it has or a new vibration cycle begins.
Each schedule is a Markov chain of its own.

References
----------
Caulkin et al. 2008 (moves guided by collisions; known by author and year only).
Jia & Williams 2001, A packing algorithm for particles of arbitrary shapes, Powder Technology 120(3), 175-186,
doi:10.1016/S0032-5910(01)00268-6
"""

from functools import partial

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.checkpoint import Held
from voxgran._base.stopping import stop_if_asked
from voxgran.containers.gravity import gravity_vector
from voxgran.containers.model import boundary_of
from voxgran.geometry.rotation import product, quaternions_of
from voxgran.packing.digital.attempts import enter_near, make_attempts, put
from voxgran.packing.digital.bit_columns import UNPACKED
from voxgran.packing.digital.container_lattice import ContainerLattice, container_lattice, positions_on
from voxgran.packing.digital.initial_sites import stand_on_lattice
from voxgran.packing.digital.no_fit_tables import table_bytes
from voxgran.packing.digital.oriented_voxels import lattice_turns
from voxgran.packing.digital.parameters import Digital
from voxgran.packing.digital.precompute import (
    LAZY,
    SHARED,
    bases_of,
    digital_kinds,
    mean_width,
    need_member,
    precomputed_of,
    records,
    tables_pay,
)
from voxgran.packing.digital.proposals import MoveRules, Schedule
from voxgran.packing.digital.schedule import SORT_SWEEPS, begin_schedule, lower_lid, sort_grains
from voxgran.packing.digital.state import COUNTERS, DigitalState
from voxgran.packing.method import NO_ROOM_ON_LATTICE, Cost, PackingMethod
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start
from voxgran.packing.walking.entering import enters_in_turn, falls_at_entry, moving_grains
from voxgran.packing.walking.feeding import SETTLE_SWEEPS, entry_of, feed_share, planned_attempts, usual_seconds
from voxgran.packing.walking.vibration import vibration_schedule
from voxgran.packing.walking.walk import advance, begin, finished

#: farthest site in a checkpoint: those along periodic axes are counted on
FARTHEST = 2**40
#: largest component of the normal of a contact in a checkpoint: that of the voxels in contact times their places
LARGEST_HINT = 2**60
#: CPU time of an attempt on a usual core, in seconds, and of one in a container that is nearly full (measured)
ATTEMPT = 4e-6, 1e-6


def digital_cost(problem: Problem) -> Cost:
    """Return what a run takes."""
    settings = problem.parameters
    lattice = container_lattice(problem)
    width = np.array([mean_width(shape) for shape in problem.shapes])[problem.shape_id] * problem.diameter
    radius = problem.bounding_radii
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


#: mean sinking per grain between two examinations, in voxels, below which the bed is settled
SETTLE_VOXELS = 0.02


class DigitalWalker:
    """What the walk has to know of digital packing: see :class:`voxgran.packing.walking.walk.Walker`."""

    def enter_start(self, problem: Problem, state: DigitalState, start: Start) -> None:
        """Insert the grains of the start on the lattice, each as near to its position as there is room.

        Raises
        ------
        InputError
            If a grain finds no place.
        """
        known = precomputed_of(problem, state)
        # the first rotation of the lattice is none
        bed, upright = records(state, known), 0

        def enter(grain: int, site: Integers, ways: Integers) -> bool:
            return int(enter_near(bed, grain, grain * known.bases, upright, site, ways)) >= 0

        def remove(grain: int, _: Integers) -> None:
            # stamping it once more removes it
            put(bed, state.derived["pairs"], grain)
            state.member[grain] = -1

        stand_on_lattice(problem, start, known.lattice, known.down, put=enter, remove=remove)

    def make_attempts(self, problem: Problem, state: DigitalState, last: int) -> None:
        """Run the kernel up to attempt `last`, or until no grain is waiting or too many were refused."""
        known, tally = precomputed_of(problem, state), state.tally(COUNTERS)
        names, wanted = ("order", "hint", "calm", "depth", "slept", "stirred", "cells"), np.full(1, -1, dtype=np.int64)
        schedule = Schedule(**{name: getattr(state, name) for name in names}, wanted=wanted)
        rules, queue = _rules(problem, state), state.waiting
        try:
            while True:
                run = (rules, schedule, queue, tally, known.key, state.done, last)
                state.done = int(make_attempts(records(state, known), state.derived["pairs"], *run))
                if wanted[0] < 0:
                    break
                stop_if_asked()
                need_member(known, int(wanted[0]))
                wanted[0] = -1
        finally:
            state.count(tally, COUNTERS)

    def between_sweeps(self, problem: Problem, state: DigitalState) -> None:
        """Lower the lid by a voxel where it finds room, and sort the grains."""
        since = state.done - (state.feeding_ended_at or 0)
        if problem.parameters.lid and since:
            lower_lid(problem, state)
        if problem.parameters.schedule == "sorted" and since % (SORT_SWEEPS * state.sweep) == 0:
            sort_grains(state)

    def event_sweeps(self, problem: Problem) -> int:
        """Return the number of sweeps after which the lid is lowered or the grains are sorted."""
        if problem.parameters.lid:
            return 1
        return SORT_SWEEPS if problem.parameters.schedule == "sorted" else SETTLE_SWEEPS

    def poses(self, problem: Problem, state: DigitalState) -> tuple[Floats, Floats]:
        """Return centroids and orientations of the grains that have entered."""
        known, placed = precomputed_of(problem, state), state.grains
        turns = quaternions_of(known.rotations[state.turn[placed]].astype(np.float64))
        position = positions_on(known.lattice, state.site[placed], problem.dimension)
        return position, product(turns, known.base[state.member[placed]])

    def has_settled(self, problem: Problem, state: DigitalState) -> bool:
        """Return whether the bed has hardly sunk, and not risen, since the last call; heights are in voxels."""
        before, state.height = (
            state.height,
            -float(linear.matmul(state.site[state.grains], gravity_vector(problem)).sum()),
        )
        return 0.0 <= before - state.height <= SETTLE_VOXELS * state.placed


WALKER = DigitalWalker()


def prepare(problem: Problem) -> DigitalState:
    """Return the first state.

    Raises
    ------
    InputError
        If gravity points along a periodic axis, no voxel size fits the periodic lengths, or a grain of the start finds
        no place.
    """
    n = problem.count
    state = DigitalState(
        site=np.zeros((n, 3), dtype=np.int64), member=np.full(n, -1, dtype=np.int64), turn=np.zeros(n, dtype=np.int64)
    )
    begin_schedule(problem, state)
    lattice = container_lattice(problem)
    most = len(digital_kinds(problem)[1]) * bases_of(problem) - 1
    state.declared = {
        "site": Held(-FARTHEST, FARTHEST), "member": Held(-1, most), "turn": Held(0, len(lattice_turns(problem)) - 1),
        "order": Held(0, n - 1, "order"), "hint": Held(-LARGEST_HINT, LARGEST_HINT),
        "cells": Held(state.cells, state.cells),
        "lid_layers": Held(0, int(lattice.shape.max())),
    }  # fmt: skip
    return begin(WALKER, problem, state)


def finish(problem: Problem, state: DigitalState) -> Packing:
    """Return the packing of the grains that have entered."""
    edge = _voxel_size(problem)
    return finished(WALKER, problem, state, contact_gap=edge, voxel_size=edge)


def _voxel_size(problem: Problem) -> float:
    """Return the edge of a voxel on the lattice of the container, in median diameters."""
    return container_lattice(problem).voxel_size


def _rules(problem: Problem, state: DigitalState) -> MoveRules:
    """Return how grains move at this stage of the run."""
    settings, known = problem.parameters, precomputed_of(problem, state)
    turns = settings.rotation_share if len(known.turns) * known.bases > 1 else 0.0
    decay, feed = -1.0 if settings.decay is None else settings.decay, feed_share(problem, state)
    return MoveRules(
        known.directions,
        known.classes,
        known.down,
        entry_of(problem, known.gravity),
        settings.feed == "at_once" or not known.down.any(),
        enters_in_turn(problem),
        falls_at_entry(problem),
        moving_grains(problem, state),
        np.array([settings.vibration_up, decay, turns, feed, settings.downward_share, settings.guided]),
        vibration_schedule(problem, state),
    )


registration = PackingMethod(
    summary="grains as voxels move over a lattice, one voxel at a time, under gravity and vibration",
    source="Jia & Williams 2001, doi:10.1016/S0032-5910(01)00268-6",
    parameters=Digital,
    prepare=prepare,
    advance=partial(advance, WALKER),
    finish=finish,
    cost=digital_cost,
    dimensions=(2, 3),
    any_container=True,
    builds_bed=True,
    start="moved",
    obstacles="apart",
    no_room=NO_ROOM_ON_LATTICE,
)
