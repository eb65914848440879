"""Bits against plain masks."""

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.lattice import packed as module
from voxgran.lattice.packed import PackedMask

SHAPES = [(1, 1, 1), (3, 4, 63), (5, 2, 64), (4, 3, 65), (1, 1, 4096), (7, 6, 130)]


@pytest.fixture(params=[1, 2**20], ids=["plane by plane", "at once"])
def block(request, monkeypatch):
    monkeypatch.setattr(module, "BLOCK", request.param)


@pytest.mark.usefixtures("block")
@pytest.mark.parametrize("shape", SHAPES)
def test_what_bits_tell_is_what_the_mask_tells(shape):
    mask = stream(1, "mask").random(shape) < 0.4
    bits = PackedMask.from_mask(mask)
    assert bits.words.nbytes == shape[0] * shape[1] * -(-shape[2] // 64) * 8
    assert np.array_equal(bits.unpacked(), mask)
    out = np.ones(shape, dtype=bool)
    assert bits.unpacked(out) is out
    assert np.array_equal(out, mask)
    assert bits.count() == mask.sum()
    if mask.any():
        assert np.allclose(bits.centroid(), np.argwhere(mask).mean(axis=0) + 0.5, rtol=1e-14)
        low, high = bits.bounds()
        assert np.array_equal(low, np.argwhere(mask).min(axis=0))
        assert np.array_equal(high, np.argwhere(mask).max(axis=0) + 1)
    padded = np.pad(mask, 1)
    assert bits.face_count() == sum(int((np.diff(padded, axis=axis)).sum()) for axis in range(3))


@pytest.mark.usefixtures("block")
def test_nothing_and_everything():
    nothing = PackedMask.empty((3, 2, 70))
    assert nothing.count() == 0
    assert nothing.face_count() == 0
    assert np.isnan(nothing.centroid()).all()
    assert [end.tolist() for end in nothing.bounds()] == [[0, 0, 0], [0, 0, 0]]
    full = PackedMask.from_mask(np.ones((3, 2, 64), dtype=bool))
    assert full.face_count() == 2 * (3 * 2 + 2 * 64 + 3 * 64)
    assert full.centroid().tolist() == [1.5, 1.0, 32.0]
