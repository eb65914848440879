"""How waiting grains enter: in which order, and whether they fall when they do.

Grains enter in turn: one that finds no room is tried again until it does. If any waiting grain were tried instead,
small grains would find room more often, and large ones would enter last and lie on top. The order is random, but in
each part of it there are as many grains of each eighth of the sizes.

With feed "rain" a grain that enters falls straight down to the first contact in the same attempt, and while grains
enter, only the newest ones move. If grains sank through a column by their random steps, small ones would overtake large
ones on the way.

Where grains are inserted at random places at once, any waiting grain is tried, and none falls.
"""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import inlined_kernel
from voxgran._base.seeds import below, stream
from voxgran.containers.gravity import gravity_vector
from voxgran.packing.problem import Problem
from voxgran.packing.walking.state import WalkState

#: number of the newest grains that move while others enter and fall
NEWEST = 64
#: classes of size that are spread evenly over the order of entry
CLASSES = 8


def entry_order(problem: Problem, first: int) -> Integers:
    """Return the queue of all grains of which the first ones have entered: (n,), the waiting ones before the others.

    The last waiting grain is the first to enter.
    """
    waiting = spread_sizes(problem.diameter[first:], stream(problem.seed, "entry order"))
    return np.concatenate([first + waiting[::-1], np.arange(first)]).astype(np.int64)


def spread_sizes(diameter: Floats, draws: np.random.Generator) -> Integers:
    """Return a random order of grains, (n,), in which the classes of their diameters, (n,), are spread evenly."""
    place = np.zeros(len(diameter))
    for grains in np.array_split(np.argsort(diameter, kind="stable"), CLASSES):
        place[grains] = (draws.permutation(len(grains)) + draws.random(len(grains))) / max(len(grains), 1)
    return np.argsort(place, kind="stable")


def enters_in_turn(problem: Problem) -> bool:
    """Return whether a grain that finds no room is tried again before the others."""
    return bool(problem.parameters.feed != "at_once")


def falls_at_entry(problem: Problem) -> bool:
    """Return whether a grain that enters falls straight down to the first contact."""
    return bool(problem.parameters.feed == "rain" and gravity_vector(problem).any())


def moving_grains(problem: Problem, state: WalkState) -> int:
    """Return how many of the newest grains move."""
    enters = state.feeding_ended_at is None and state.layer_ends is None
    return NEWEST if enters and falls_at_entry(problem) else problem.count


@inlined_kernel
def pick_moving(queue: Integers, placed: int, newest: int, word: int) -> int:
    """Return a random one of the newest grains that have entered."""
    if placed > newest:
        return queue[len(queue) - placed + below(word, newest)]
    return queue[len(queue) - 1 - below(word, placed)]


@inlined_kernel
def next_slot(in_turn: bool, waiting: int, word: int) -> int:
    """Return the place in the queue of the grain that is tried next, of those that wait."""
    return waiting - 1 if in_turn else below(word, waiting)
