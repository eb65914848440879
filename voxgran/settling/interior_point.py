"""Forces at contacts without friction, by an interior point: the question whether grains rest.

It is a quadratic program: of all accelerations a with ``a_n >= 0`` at the contacts those nearest to gravity, weighted
by mass and moment of inertia; the forces f are its multipliers. An iteration solves linear equations of the matrix
``1 + J^T diag(w) J``, where J holds the normals and the moments of their arms. Its factors are most of the work, so
that each serves several corrections of a step.

The factors are those of Cholesky, by the frontal method: bodies are eliminated in a given order, in groups, each in a
dense matrix, its front, of the group and of the later bodies that are coupled to it or, through eliminated ones, will
be. In the order of heights a front is a layer of the bed, about one grain thick. Most of the work is products of
matrices, in tiles.

References
----------
Mehrotra 1992, On the implementation of a primal-dual interior point method, doi:10.1137/0802028
Gondzio 1996, Multiple centrality corrections in a primal-dual method for linear programming, doi:10.1007/bf00249643
Irons 1970, A frontal solution program for finite element analysis, doi:10.1002/nme.1620020104
Duff & Reid 1983, The multifrontal solution of indefinite sparse symmetric linear, doi:10.1145/356044.356047
"""

import math
from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arithmetic.tiles import COLUMNS, ROWS, add_tile, padded
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.lazy import load
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.manifolds.rows import ARM_I, ARM_J, NORMAL, OUTLINE, SPHERE, SURFACE
from voxgran.settling.balance import LoadedContacts
from voxgran.settling.bed import Bed

#: unknowns of a group, whole tiles: with fewer, fronts are copied more often; with more, the factors on the diagonal
#: take longer than the products (60 was the fastest of 60 to 160 for layers of 16 to 256 bodies)
GROUP = 60


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
        self._factors = [(np.zeros((p, p)), np.zeros((padded(b, ROWS), padded(p, COLUMNS)))) for p, b in sizes]
        most = max((b for _, b in sizes), default=0)
        self._updates = np.zeros((2, padded(most, ROWS) * padded(most, COLUMNS)))

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
        weights, old = weights[self._rows], self._updates[0][:0].reshape(0, 0)
        for k, (front, (own, side)) in enumerate(zip(self._fronts, self._factors, strict=True)):
            stop_if_asked()
            b, some = len(front.rest), slice(front.first, front.last)
            shape = padded(b, ROWS), padded(b, COLUMNS)
            update, below = self._updates[k % 2][: shape[0] * shape[1]].reshape(shape), np.zeros_like(side)
            parts = self._local[some], self._values[some], weights[some]
            _assemble(own, below[:b], update[:b], old, front.place, *parts)
            if not _eliminate(own, below, side, update):
                return False
            old = update
        return True

    def solve(self, right: Floats) -> Floats:
        """Return the solution x (n d,) for a right-hand side, with the factors that were computed last."""
        x = right.copy()
        pairs = zip(self._fronts, self._factors, strict=True)
        factors = [(own, side[: len(front.rest), : len(own)]) for front, (own, side) in pairs]
        for front, (own, side) in zip(self._fronts, factors, strict=True):
            x[front.own] = linear.matmul(own, x[front.own])
            x[front.rest] -= linear.matmul(side, x[front.own])
        for front, (own, side) in zip(reversed(self._fronts), reversed(factors), strict=True):
            x[front.own] = linear.matmul(x[front.own] - linear.matmul(x[front.rest], side), own)
        return x


@kernel
def _eliminate(own, below, side, update):  # type: ignore[no-untyped-def]
    """Eliminate the p unknowns of a front; return False where the matrix is not positive definite.

    own: (p, p) lower triangle; becomes the inverse of its factor.  below: (b, p) entries below it.  side: becomes the
    factor below it.  update: (b, b) lower triangle of the rest, from which the square of `side` is subtracted. All but
    the first are as large as whole tiles, with zeros.
    """
    p = len(own)
    upper, inverse = own.T.copy(), np.zeros((p, p))
    for k in range(p):
        if not upper[k, k] > 0.0:
            return False
        root = math.sqrt(upper[k, k])
        for j in range(k, p):
            upper[k, j] /= root
        for i in range(k + 1, p):
            part = upper[k, i]
            for j in range(i, p):
                upper[i, j] -= part * upper[k, j]
    # products with the inverse are several times as fast as solutions
    for i in range(p - 1, -1, -1):
        inverse[i, i] = 1.0
        for k in range(i + 1, p):
            part = upper[i, k]
            for j in range(k, p):
                inverse[i, j] -= part * inverse[k, j]
        for j in range(i, p):
            inverse[i, j] /= upper[i, i]
            own[j, i] = inverse[i, j]
    strip, strips = np.zeros((p, COLUMNS)), np.zeros((update.shape[1] // COLUMNS * p, COLUMNS))
    for j in range(0, side.shape[1], COLUMNS):
        for k in range(p):
            for c in range(COLUMNS):
                strip[k, c] = inverse[k, j + c] if j + c < p else 0.0
        for i in range(0, len(side), ROWS):
            for r in range(i, i + ROWS):
                for c in range(j, j + COLUMNS):
                    side[r, c] = 0.0
            add_tile(side, below, strip, i, j, 0, min(p, j + COLUMNS))
    for i in range(len(side)):
        begin, c = i // COLUMNS * p, i % COLUMNS
        for k in range(p):
            strips[begin + k, c] = -side[i, k]
    for i in range(0, len(side), ROWS):
        for j in range(0, i + ROWS, COLUMNS):
            add_tile(update, side, strips, i, j, j // COLUMNS * p, p)
    return True


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


#: most factorizations
ITERATIONS = 80
#: part of the way to the nearest bound that a step goes
SHORT_OF_BOUND = 0.99
#: most corrections of a step, by how much each is to lengthen it, and the part of that from which on it is kept
CORRECTIONS, LONGER, KEPT = 3, 0.3, 0.1
#: force at a contact, and slack, at the beginning
FIRST = 1.0
#: grains in a layer of unit area, and the largest product of unknowns and the square of those of a layer
LAYER, MOST_WORK = 1.2, 1e10
#: range of the products of slack and force, in means, into which a correction brings them
LEAST, MOST = 0.1, 10.0


def frictionless_forces(
    contacts: LoadedContacts, *, accuracy: float, height: Floats | None = None
) -> tuple[Floats, Floats, int]:
    """Return normal forces (m,), accelerations (n + 1, 6) and the number of factorizations.

    accuracy: to which all conditions hold at the end, in units of gravity.  height: (n,) by which the grains are sorted
    before the equations are solved, layer by layer; left out, they are numbered by height.
    """
    m, bodies = len(contacts.i), contacts.bodies
    jacobian, freedoms, weight = _program(contacts)
    # the lid, which may be coupled to all, is the last
    order = np.arange(len(bodies)) if height is None else np.append(np.argsort(height, kind="stable"), len(height))
    x, force, made = weight, np.zeros(0), 0
    if m:
        matrix = FrontalMatrix(contacts.i, contacts.j, jacobian.data.reshape(m, 2, len(freedoms)), order)
        x, force, made = _solved(jacobian, matrix, weight, accuracy)
    accelerations = np.zeros((len(bodies), 6))
    accelerations[:-1, :3] = np.where(bodies[:-1, 6:7] > 0.0, contacts.gravity, 0.0)
    accelerations[:, freedoms] = x.reshape(len(bodies), -1) * np.sqrt(_inverse_masses(bodies)[:, freedoms])
    return force, accelerations, made


def is_direct(bed: Bed) -> bool:
    """Return whether forces without friction are computed to the end: grains are convex or spheres, and layers small.

    The time grows with the number of unknowns and the square of those of a layer, which a container of some width has.
    """
    if {SURFACE, OUTLINE} & bed.finders.kinds:
        return False
    lower, upper = bed.assembly.container.bounds
    height = float(linear.matmul(upper - lower, np.abs(bed.gravity)))
    unknowns = (6 if bed.finders.kinds - {SPHERE} else 3) * bed.assembly.count
    area = bed.assembly.container.volume / max(height, 1.0)
    return unknowns * min(unknowns, LAYER * area * unknowns / max(bed.assembly.count, 1)) ** 2 <= MOST_WORK


def _inverse_masses(bodies: Floats) -> Floats:
    """Return the inverse masses and moments of inertia of all six freedoms, (n + 1, 6)."""
    return np.repeat(bodies[:, 6:8], 3, axis=1)


def _program(contacts: LoadedContacts) -> tuple[Any, Integers, Floats]:
    """Return the Jacobian of the gaps (m, (n + 1) d) as a sparse matrix, the d freedoms that occur, and the weight.

    All are scaled by the square roots of mass and moment of inertia.
    """
    row, i, j, bodies, gravity, _ = contacts
    normal, lid = row[:, NORMAL : NORMAL + 3], len(bodies) - 1
    root = np.sqrt(_inverse_masses(bodies))
    one = -np.hstack([normal, np.cross(row[:, ARM_I : ARM_I + 3], normal)]) * root[i]
    other = np.hstack([normal, np.cross(row[:, ARM_J : ARM_J + 3], normal)]) * root[j]
    at_lid = j == lid
    other[at_lid] = np.hstack(
        [np.outer(linear.matmul(normal[at_lid], gravity), gravity), np.zeros((int(at_lid.sum()), 3))]
    )
    other[at_lid] *= root[lid]
    other[j < 0] = 0.0
    pull = np.hstack([np.tile(gravity, (lid + 1, 1)), np.zeros((lid + 1, 3))]) / np.where(root > 0.0, root, np.inf)
    # arms of spheres have no moments, and nothing leaves a plane
    used = [np.abs(part).max(axis=0, initial=0.0) for part in (one, other)]
    freedoms = np.flatnonzero((np.maximum(*used) > 1e-9) | (np.arange(6) == np.argmax(np.abs(gravity))))
    values, d = np.stack([one[:, freedoms], other[:, freedoms]], axis=1), len(freedoms)
    column = np.stack([i, np.where(j < 0, 0, j)], axis=1)[:, :, None] * d + np.arange(d)
    arrays = (values.ravel(), column.ravel(), np.arange(len(i) + 1) * 2 * d)
    jacobian = load("scipy.sparse").csr_array(arrays, shape=(len(i), (lid + 1) * d))
    return jacobian, freedoms, pull[:, freedoms].ravel()


def _solved(jacobian: Any, matrix: FrontalMatrix, weight: Floats, accuracy: float) -> tuple[Floats, Floats, int]:
    """Return the scaled accelerations, the forces, and the number of factorizations."""
    transposed, force = jacobian.T.tocsr(), np.full(jacobian.shape[0], FIRST)
    x = weight + transposed @ force  # bits: sparse
    slack = np.maximum(jacobian @ x, FIRST)  # bits: sparse
    made = 0
    while made < ITERATIONS:
        stop_if_asked()
        rest, short = x - weight - transposed @ force, jacobian @ x - slack  # bits: sparse
        mean = float(linear.matmul(slack, force)) / len(force)
        worst = max(float(np.abs(one).max()) for one in (rest, short))
        if mean < accuracy**2 and worst < accuracy:
            break
        step = _Step(jacobian, transposed, matrix, slack, force, rest, short)
        if not matrix.factorize(force / slack):
            # as accurate as numbers allow
            break
        made += 1
        part, (dx, ds, df) = step.best(mean)
        part = min(1.0, SHORT_OF_BOUND * part)
        x, slack, force = x + part * dx, slack + part * ds, force + part * df
    return x, force, made


class _Step(NamedTuple):
    """The linear equations of a step."""

    jacobian: Any
    transposed: Any
    matrix: FrontalMatrix
    slack: Floats
    force: Floats
    rest: Floats  # what the forces miss of the accelerations
    short: Floats  # what the slacks miss

    def towards(self, excess: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the changes of x, slack and force that lessen the products of the last two by an excess."""
        pull = -(excess + self.force * self.short) / self.slack
        dx = self.matrix.solve(self.transposed @ pull - self.rest)  # bits: sparse
        change = self.jacobian @ dx  # bits: sparse
        return dx, change + self.short, pull - self.force * change / self.slack

    def length(self, ds: Floats, df: Floats) -> float:
        """Return the part of a change, at most 1, up to which slacks and forces stay above 0."""
        return min(_part(self.slack, ds), _part(self.force, df))

    def best(self, mean: float) -> tuple[float, tuple[Floats, Floats, Floats]]:
        """Return the longest step found, and the part of it that can be made; mean: of the products now."""
        excess = self.slack * self.force
        _, ds, df = self.towards(excess)
        reached = linear.matmul(self.slack + _part(self.slack, ds) * ds, self.force + _part(self.force, df) * df)
        target = (float(reached) / len(ds) / mean) ** 3 * mean
        excess = excess + ds * df - target
        found = self.towards(excess)
        part = self.length(*found[1:])
        for _ in range(CORRECTIONS):
            wanted = min(1.0, part + LONGER)
            product = (self.slack + wanted * found[1]) * (self.force + wanted * found[2])
            change = np.maximum(np.clip(product, LEAST * target, MOST * target) - product, -MOST * target)
            other = self.towards(excess - change)
            longer = self.length(*other[1:])
            if longer < part + KEPT * LONGER:
                break
            part, found, excess = longer, other, excess - change
        return part, found


def _part(values: Floats, change: Floats) -> float:
    """Return the part of a change, at most 1, up to which no value falls below 0."""
    falls = change < 0.0
    return min(1.0, float((-values[falls] / change[falls]).min())) if falls.any() else 1.0
