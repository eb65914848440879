"""Random streams: the kernel draws what NumPy's Philox draws, and streams do not mix."""

import numpy as np
import pytest
from scipy import stats

from voxgran._base.errors import InputError
from voxgran._base.seeds import below, philox_block, philox_key, shuffled, stream, unit_float


@pytest.mark.parametrize("counter", [0, 1, 17, 2**40, 2**63])
@pytest.mark.parametrize("draw", [0, 3])
def test_block_is_numpys_philox(counter, draw):
    key = philox_key(7, "digital")
    block = philox_block(key[0], key[1], np.uint64(counter + 1), np.uint64(draw))
    # NumPy adds one to the counter before it draws
    twin = np.random.Philox(key=key, counter=[counter, draw, 0, 0]).random_raw(4)
    assert [int(word) for word in block] == twin.tolist()


def test_streams_repeat_and_differ():
    first = stream(1, "sizes", 4).random(8)
    assert np.array_equal(first, stream(1, "sizes", 4).random(8))
    for other in (stream(2, "sizes", 4), stream(1, "shapes", 4), stream(1, "sizes", 5)):
        assert not np.array_equal(first, other.random(8))


def test_numbers_are_uniform():
    key = philox_key(3, "test")
    words = [np.uint64(philox_block(*key, np.uint64(k), np.uint64(0))[k % 4]) for k in range(4000)]
    floats = np.array([unit_float(word) for word in words])
    assert floats.min() >= 0
    assert floats.max() < 1
    assert stats.kstest(floats, "uniform").pvalue > 1e-3
    counts = np.bincount([below(word, 26) for word in words], minlength=26)
    assert len(counts) == 26
    assert stats.chisquare(counts).pvalue > 1e-3


@pytest.mark.parametrize("seed", [-1, 1.5, True, "1"])
def test_bad_seed_is_refused(seed):
    with pytest.raises(InputError, match="seed"):
        stream(seed, "sizes")


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 63, 1000, 4097])
def test_a_shuffle_is_a_permutation_and_depends_on_the_key(size):
    one, other = philox_key(1, "shuffle"), philox_key(2, "shuffle")
    found = [int(shuffled(k, size, one[0], one[1])) for k in range(size)]
    assert sorted(found) == list(range(size))
    if size > 60:
        assert found != [int(shuffled(k, size, other[0], other[1])) for k in range(size)]


def test_a_shuffle_is_random():
    # mean and correlation of neighbours, and the number of ascents, as of a random permutation
    key, n = philox_key(3, "shuffle"), 20_000
    found = np.array([int(shuffled(k, n, key[0], key[1])) for k in range(n)]) / n
    assert abs(found[: n // 2].mean() - 0.5) < 4 * 0.5 / np.sqrt(12 * n / 2)
    assert abs(np.corrcoef(found[1:], found[:-1])[0, 1]) < 4 / np.sqrt(n)
    assert abs(np.count_nonzero(np.diff(found) > 0) - (n - 1) / 2) < 4 * np.sqrt((n + 1) / 12)
