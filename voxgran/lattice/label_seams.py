"""What the surfaces of labels have in common where a window with some of them ends, and the next one begins."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Integers
from voxgran.lattice.label_net import Net


@dataclass(slots=True)
class Seams:
    """Points and quadrangles between labels that are done and others."""

    shape: Integers  # (3,) corners of voxels of the image
    corner: Integers  # (3,) first corner of the window
    whole: Booleans  # (labels + 1,) labels that lie within the window
    points: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (n,) rising
    moved: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), dtype=np.float32))
    quads: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (m,) rising
    crossed: Booleans = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))

    def put(self, net: Net, moved: NDArray[np.float32], held: Booleans, crossed: Booleans) -> None:
        """Move points and cut quadrangles of a window as they are known, and hold these points."""
        points = self._points(net)
        here, known = _common(points, self.points)
        moved[here], held[here] = self.moved[known], True
        here, known = _common(self._quads(net, points), self.quads)
        crossed[here] = self.crossed[known]

    def keep(
        self, net: Net, moved: NDArray[np.float32], crossed: Booleans, done: Booleans, later: Booleans, first: int
    ) -> None:
        """Keep what labels of this window that are done share with later ones, and forget what lies before a plane."""
        shared = np.zeros((2, len(net.at)), dtype=np.bool_)
        for of, some in zip(shared, (done, later), strict=True):
            of[net.quad[some[np.maximum(net.side, 0)].any(axis=1)]] = True
        both = np.asarray(shared.all(axis=0))
        below, above = np.maximum(net.side, 0).T
        between = (done[below] & later[above]) | (later[below] & done[above])
        points = self._points(net)
        plane = int(first * self.shape[1] * self.shape[2])
        self.points, self.moved = _merged(self.points, self.moved, points[both], moved[both], plane)
        quads = self._quads(net, points)[between]
        self.quads, self.crossed = _merged(self.quads, self.crossed, quads, crossed[between], 3 * plane)

    def _points(self, net: Net) -> Integers:
        """Return a number of each point of a net in the whole image."""
        at = net.at.T.astype(np.int64) + self.corner[:, None]
        return np.asarray(np.ravel_multi_index(tuple(at), tuple(self.shape.tolist())), dtype=np.int64)

    @staticmethod
    def _quads(net: Net, points: Integers) -> Integers:
        """Return a number of each quadrangle in the whole image."""
        return np.asarray(3 * points[net.quad[:, 0]] + net.axis, dtype=np.int64)


def _common(here: Integers, known: Integers) -> tuple[Integers, Integers]:
    """Return where numbers occur in a rising list: their places, and those in the list."""
    place = np.minimum(np.searchsorted(known, here), max(len(known) - 1, 0))
    some = np.flatnonzero(known[place] == here) if len(known) else np.zeros(0, dtype=np.int64)
    return some, place[some]


def _merged(old: Integers, values: Any, new: Integers, more: Any, first: int) -> tuple[Integers, Any]:
    """Return rising numbers from `first` on, and their values, of two lists; known values stay."""
    both, index = np.unique(np.concatenate([old, new]), return_index=True)
    late = both >= first
    return both[late], np.concatenate([values, more])[index[late]]
