"""Pieces of labels: those of any image, against SciPy label by label."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.lattice.label_pieces import keep_largest_pieces


def by_label(labels, count, wraps):
    """Return which labels have several pieces, and the image of the largest ones, by connected components."""
    several, kept = [], labels.copy()
    for label in range(1, count + 1):
        piece, pieces = vg.connected_components(labels == label, periodic=tuple(wraps.tolist()))
        if pieces > 1:
            several.append(label)
            kept[(piece > 0) & (piece != 1 + np.bincount(piece.ravel())[1:].argmax())] = 0
    return several, kept


@pytest.mark.parametrize("seed", range(40))
def test_the_largest_piece_of_each_label_is_kept(seed):
    draw = stream(seed, "pieces")
    for _ in range(5):
        count = int(draw.integers(1, 5))
        labels = draw.integers(0, count + 1, draw.integers(1, 9, 3)).astype(np.int32)
        wraps = draw.random(3) < 0.5
        several, kept = by_label(labels, count, wraps)
        some = labels.copy()
        assert keep_largest_pieces(some, np.arange(count + 1) == 1, wraps) == several[: several[:1] == [1]]
        assert np.array_equal(some, np.where(labels == 1, kept, labels))
        assert keep_largest_pieces(labels, np.ones(count + 1, dtype=bool), wraps) == several
        assert np.array_equal(labels, kept)


def test_of_equally_large_pieces_the_first_is_kept():
    labels = np.array([[[1, 0, 1, 0, 2, 2]]], dtype=np.int32)
    assert keep_largest_pieces(labels, np.ones(3, dtype=bool), np.zeros(3, dtype=bool)) == [1]
    assert labels.tolist() == [[[1, 0, 0, 0, 2, 2]]]
