"""What the kernels of digital packing take: the bank, and where the grains are."""

from typing import NamedTuple

from voxgran._base.arrays import Integers, Words


class Members(NamedTuple):
    """The bank as kernels take it; `turns` are signed permutations of the axes.

    kind: of each grain; its members are `bases` from kind * bases on.  at: where each member in each turn begins in the
    bits that all grains share; empty where each grain has bits of its own.
    """

    words: Words
    start: Integers
    low: Integers
    size: Integers
    turns: Integers
    bases: int
    kind: Integers
    at: Integers


class Grains(NamedTuple):
    """Where the grains are: lattice site of the centroid, member of the bank (-1: waiting), turn.

    at: where the bits of each begin now.  own: where its own bits begin, where it has some.
    """

    site: Integers
    member: Integers
    turn: Integers
    bits: Words
    at: Integers
    own: Integers
    scratch: Words
