"""Random numbers: Philox streams keyed by (seed, stage, index), so that no result depends on order or threads.

Philox is a counter-based generator (Salmon et al. 2011, Parallel random numbers: as easy as 1, 2, 3,
doi:10.1145/2063384.2063405): block n of a stream is a function of the key and n alone. A packing attempt that draws
block n therefore gets the same numbers whatever the chunk in which it is computed, and a checkpoint needs no
generator state.
"""

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import as_count
from voxgran._base.kernels import instruction, kernel
from voxgran._base.lazy import load

#: largest seed; larger ones would not fit in the headers of files
MOST_SEED = 2**128 - 1


def stream(seed: int, stage: str, *index: int) -> np.random.Generator:
    """Return the generator of one stage, such as ``"sizes"``, of a run, independent of those of all other keys.

    Further keys are grain, chunk and so on; all keys are whole numbers of at least 0.

    Examples
    --------
    >>> from voxgran._base.seeds import stream
    >>> first, again = stream(1, "order").random(), stream(1, "order").random()
    >>> first == again, first == stream(1, "turns").random()
    (True, False)
    """
    return np.random.Generator(np.random.Philox(_sequence(seed, stage, *index)))


def philox_key(seed: int, stage: str) -> NDArray[np.uint64]:
    """Return the (2,) uint64 key under which kernels draw the blocks of a stage."""
    return _sequence(seed, stage).generate_state(2, np.uint64).astype(np.uint64)


def _sequence(seed: int, stage: str, *index: int) -> np.random.SeedSequence:
    """Mix seed, stage and indices."""
    key = (zlib.crc32(stage.encode()), *(as_count(value, "index", at_most=None) for value in index))
    return np.random.SeedSequence(as_count(seed, "seed", at_most=MOST_SEED), spawn_key=key)


@kernel
def philox_block(
    key_0: np.uint64, key_1: np.uint64, counter: np.uint64, draw: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return the four random words of Philox4x64-10 for counter (counter, draw, 0, 0)."""
    c0, c1, c2, c3 = counter, draw, np.uint64(0), np.uint64(0)
    k0, k1 = key_0, key_1
    for _ in range(10):
        low_0 = np.uint64(0xD2E7470EE14C6C93) * c0
        high_0 = _multiply_high(np.uint64(0xD2E7470EE14C6C93), c0)
        low_1 = np.uint64(0xCA5A826395121157) * c2
        high_1 = _multiply_high(np.uint64(0xCA5A826395121157), c2)
        c0, c1, c2, c3 = high_1 ^ c1 ^ k0, low_1, high_0 ^ c3 ^ k1, low_0
        k0 += np.uint64(0x9E3779B97F4A7C15)
        k1 += np.uint64(0xBB67AE8584CAA73B)
    return c0, c1, c2, c3


@kernel
def unit_float(word: np.uint64) -> float:
    """Return the uniform number in [0, 1) that the top 53 bits of a random word stand for."""
    return np.float64(word >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def below(word: np.uint64, bound: int) -> np.int64:
    """Return a whole number in [0, bound) from the top 32 bits of a random word; bound < 2**31.

    The bias of the multiplication is below bound / 2**32 and the same on every machine.
    """
    return np.int64(((word >> np.uint64(32)) * np.uint64(bound)) >> np.uint64(32))


@kernel
def shuffled(index: int, size: int, key_0: np.uint64, key_1: np.uint64) -> np.int64:
    """Return where 0 ... size - 1 is sent by a random permutation, without a table of it.

    A Feistel network permutes the whole numbers below the next power of 4; those that leave the range go on until they
    come back (Black & Rogaway 2002, Ciphers with arbitrary finite domains, doi:10.1007/3-540-45760-7_9).
    """
    half = np.uint64(1)
    while np.uint64(size) > np.uint64(1) << (half + half):
        half += np.uint64(1)
    mask = (np.uint64(1) << half) - np.uint64(1)
    x = np.uint64(index)
    while True:
        left, right = x >> half, x & mask
        for turn in range(8):
            word = (right ^ key_0) + np.uint64(turn + 1) * key_1 * np.uint64(2) + np.uint64(turn)
            word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            left, right = right, left ^ ((word ^ (word >> np.uint64(31))) & mask)
        x = (left << half) | right
        if x < np.uint64(size):
            return np.int64(x)


@instruction
def _multiply_high(_: Any, a: Any, b: Any) -> Any:
    """Return the upper 64 bits of the 128-bit product."""
    word = load("numba").types.uint64

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        ir = load("llvmlite.ir")
        product = builder.mul(*(builder.zext(factor, ir.IntType(128)) for factor in args))
        return builder.trunc(builder.lshr(product, ir.Constant(ir.IntType(128), 64)), ir.IntType(64))

    return word(a, b), generate
