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

    shape: Integers  # (3,) corners of voxels of the image; along a periodic axis the last one is the first one
    corner: Integers  # (3,) first corner of the window
    whole: Booleans  # (labels + 1,) labels that lie within the window
    own: Booleans  # (labels + 1,) labels whose surfaces are wanted
    due: Booleans  # (labels + 1,) these, and later ones that lie within the window, whose volumes must be right as well
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

    def keep(self, net: Net, moved: NDArray[np.float32], crossed: Booleans, later: Booleans, first: int) -> None:
        """Keep what labels of this window that are its own share with later ones, and forget what lies before a plane.

        Where all points of a quadrangle are kept its diagonal is, also between two later labels: with the other one its
        triangles might cross others, and no point would be left that can be moved.
        """
        both = self.touched(net, self.own) & self.touched(net, later)
        quads = np.flatnonzero(both[net.quad[:, 0]])
        quads = quads[both[net.quad[quads]].all(axis=1)]
        points = self._points(net)
        plane = int(first * self.shape[1] * self.shape[2])
        numbers = self._quads(net, points)[quads]
        self.quads, self.crossed = _merged(self.quads, self.crossed, numbers, crossed[quads], 3 * plane)
        self.points, self.moved = _merged(self.points, self.moved, points[both], moved[both], plane)

    @staticmethod
    def touched(net: Net, some: Booleans) -> Booleans:
        """Return which points of a net some labels touch, (labels + 1,)."""
        touched = np.zeros(len(net.at), dtype=np.bool_)
        touched[net.quad[some[np.maximum(net.side, 0)].any(axis=1)]] = True
        return touched

    @staticmethod
    def beside(net: Net, points: Booleans, labels: int) -> Booleans:
        """Return which of some labels, (labels + 1,), have faces at some points of a net."""
        beside = np.zeros(labels, dtype=np.bool_)
        beside[np.maximum(net.side[points[net.quad].any(axis=1)], 0)] = True
        return beside

    def _points(self, net: Net) -> Integers:
        """Return a number of each point of a net in the whole image."""
        number: Integers = np.zeros(len(net.at), dtype=np.int64)
        # axis by axis, as there are many points
        for axis in range(3):
            number *= self.shape[axis]
            number += (net.at[:, axis] + self.corner[axis]) % self.shape[axis]
        return number

    @staticmethod
    def _quads(net: Net, points: Integers) -> Integers:
        """Return a number of each quadrangle in the whole image."""
        number: Integers = points[net.quad[:, 0]]
        number *= 3
        number += net.axis
        return number


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
