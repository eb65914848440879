"""Cholesky factors of ``1 + J^T diag(w) J`` for bodies in contact: the frontal method.

Bodies are eliminated in a given order, in groups, each in a dense matrix, its front, of the group and of the later
bodies that are coupled to it or, through eliminated ones, will be. In the order of heights a front is a layer of the
bed, about one grain thick. All of the work is matrix products of LAPACK and BLAS.

References
----------
Irons 1970, A frontal solution program for finite element analysis, doi:10.1002/nme.1620020104
Duff & Reid 1983, The multifrontal solution of indefinite sparse symmetric linear, doi:10.1145/356044.356047
"""

from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran._base.lazy import load
from voxgran._base.stopping import stop_if_asked

#: unknowns of a group: with fewer, fronts are copied more often; with more, they are larger
GROUP = 160


class _Front(NamedTuple):
    """One group and its front."""

    own: Integers  # unknowns that are eliminated
    rest: Integers  # unknowns that are coupled to them and come later
    place: Integers  # (b,) where the bodies left over by the group before are in the front
    first: int  # contacts that are added, in the order of the fronts
    last: int


class FrontalMatrix:
    """The matrix ``1 + J^T diag(w) J``, where a row of J couples a body to another, or to none.

    Parameters
    ----------
    i, j : (m,) ndarray of int
        Bodies of each row; j is -1 where there is none.
    values : (m, 2, d) ndarray of float
        Entries of J for the d unknowns of both bodies.
    order : (n,) ndarray of int
        Bodies in the order in which they are eliminated.
    """

    def __init__(self, i: Integers, j: Integers, values: Floats, order: Integers) -> None:
        self._d, n = values.shape[2], len(order)
        place = np.empty(n, dtype=np.int64)
        place[order] = np.arange(n)
        here, there = place[i], np.where(j < 0, -1, place[j])
        values = values.copy()
        self_touching = here == there
        values[self_touching, 0] += values[self_touching, 1]
        there[self_touching] = -1
        swap = (there >= 0) & (there < here)
        here[swap], there[swap] = there[swap], here[swap]
        values[swap] = values[swap, ::-1]
        self._rows = np.argsort(here, kind="stable")
        self._values = np.ascontiguousarray(values[self._rows])
        self._local = np.empty((len(i), 2), dtype=np.int64)
        self._fronts = list(self._fronts_of(order, here[self._rows], there[self._rows]))
        sizes = [(len(front.own), len(front.rest)) for front in self._fronts]
        # inverses of the factors on the diagonal, and the factors below them
        self._factors = [(np.zeros((p, p)), np.empty((b, p))) for p, b in sizes]
        self._updates = np.empty((2, max((b for _, b in sizes), default=0) ** 2))

    def _fronts_of(self, order: Integers, here: Integers, there: Integers) -> Any:
        """Yield the fronts, and write where the bodies of each row are in them."""
        n, d, size = len(order), self._d, max(1, GROUP // self._d)
        left = np.zeros(0, dtype=np.int64)
        unknown = np.arange(d)
        for begin in range(0, n, size):
            end = min(begin + size, n)
            first, last = (int(at) for at in np.searchsorted(here, [begin, end]))
            far = there[first:last]
            rest = np.union1d(left[left >= end], far[far >= end])
            bodies = np.concatenate([np.arange(begin, end), rest])
            self._local[first:last, 0] = here[first:last] - begin
            self._local[first:last, 1] = np.where(far < 0, -1, np.searchsorted(bodies, far))
            own = (order[begin:end, None] * d + unknown).ravel()
            yield _Front(own, (order[rest, None] * d + unknown).ravel(), np.searchsorted(bodies, left), first, last)
            left = rest

    def factorize(self, weights: Floats) -> bool:
        """Compute the factors for weights w (m,), at least 0; return whether the matrix is positive definite.

        In exact numbers it is; with weights that are too large it may not be.
        """
        lapack, blas = load("scipy.linalg.lapack"), load("scipy.linalg.blas")
        weights, old = weights[self._rows], self._updates[0][:0].reshape(0, 0)
        for k, (front, (own, side)) in enumerate(zip(self._fronts, self._factors, strict=True)):
            stop_if_asked()
            b, some = len(front.rest), slice(front.first, front.last)
            update = self._updates[k % 2][: b * b].reshape(b, b)
            _assemble(own, side, update, old, front.place, self._local[some], self._values[some], weights[some])
            # transposed views have the order of LAPACK: upper factors there are lower ones here
            if lapack.dpotrf(own.T, lower=0, overwrite_a=1, clean=0)[1]:
                return False
            # products with the inverse are several times as fast as solutions
            lapack.dtrtri(own.T, lower=0, overwrite_c=1)
            if b:
                blas.dtrmm(1.0, own.T, side.T, trans_a=1, overwrite_b=1)
                blas.dsyrk(-1.0, side.T, beta=1.0, c=update.T, trans=1, overwrite_c=1)
            old = update
        return True

    def solve(self, right: Floats) -> Floats:
        """Return the solution x (n d,) for a right-hand side, with the factors that were computed last."""
        x = right.copy()
        for front, (own, side) in zip(self._fronts, self._factors, strict=True):
            x[front.own] = own @ x[front.own]
            x[front.rest] -= side @ x[front.own]
        for front, (own, side) in zip(reversed(self._fronts), reversed(self._factors), strict=True):
            x[front.own] = (x[front.own] - x[front.rest] @ side) @ own
        return x


@bare_kernel
def _assemble(own, side, rest, update, place, local, values, weights):  # type: ignore[no-untyped-def]
    """Write the lower triangle of a front: the unit matrix, what was left over before, and contacts."""
    p, d, size = len(own), values.shape[2], len(own) + len(rest)
    for to in range(size):
        for c in range(min(p, to + 1)):
            if to < p:
                own[to, c] = 1.0 if c == to else 0.0
            else:
                side[to - p, c] = 0.0
        for c in range(to - p + 1):
            rest[to - p, c] = 1.0 if c == to - p else 0.0
    for a in range(len(place)):
        for r in range(d):
            source, to = update[a * d + r], place[a] * d + r
            for b in range(a + 1):
                column, many = place[b] * d, d if b < a else r + 1
                # what was left over of a body has its part of the unit matrix
                if to < p:
                    for c in range(many):
                        own[to, column + c] = source[b * d + c]
                elif column < p:
                    for c in range(many):
                        side[to - p, column + c] = source[b * d + c]
                else:
                    for c in range(many):
                        rest[to - p, column - p + c] = source[b * d + c]
    for k in range(len(local)):
        for one in range(2):
            for other in range(one + 1):
                if local[k, one] < 0:
                    continue
                for r in range(d):
                    to, push = local[k, one] * d + r, weights[k] * values[k, one, r]
                    for c in range(d):
                        column = local[k, other] * d + c
                        if column > to:
                            continue
                        if to < p:
                            own[to, column] += push * values[k, other, c]
                        elif column < p:
                            side[to - p, column] += push * values[k, other, c]
                        else:
                            rest[to - p, column - p] += push * values[k, other, c]
