"""Products of matrices and small linear algebra with the same bits on every processor.

NumPy and SciPy hand these to BLAS and LAPACK, in which the order of summation depends on the processor and the number
of threads. Here it is fixed: the functions run as kernels, or as sums of NumPy.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats
from voxgran._base.kernels import Kernel, bare_kernel, numba_is_loaded

#: multiplications up to which a product is made by NumPy where numba is not loaded: 20 ms, where loading takes 400
FEW = 200_000
#: rows and columns up to which a matrix is factorized as plain Python where numba is not loaded: a millisecond
SMALL = 6
#: columns of a matrix up to which products with a vector are sums from left to right
COLUMNS = 8
#: most sweeps of Jacobi's method, which ends after 5 to 10
SWEEPS = 60
#: steps of Newton's method to the nodes of a quadrature, whose first guess has three digits at least
NEWTON = 5
#: scalar product of two unit vectors below which they count as orthogonal, in units in the last place of 1
ORTHOGONAL = 2.0**-52


def matmul(a: ArrayLike, b: ArrayLike) -> Any:
    """Return the matrix product, as the operator ``@`` does: of vectors, matrices and stacks of them.

    Sums of two vectors are those of `numpy.sum`, of a matrix of more than eight columns and a vector those of
    `numpy.einsum`; all others go from left to right. Whole numbers stay whole.
    """
    one, other = np.asarray(a), np.asarray(b)
    if one.dtype.kind in "iub" and other.dtype.kind in "iub":
        return one @ other  # bits: whole numbers
    one, other = one.astype(np.float64, copy=False), other.astype(np.float64, copy=False)
    if one.ndim == 2 and other.ndim == 2:
        return _products(one, other)
    if one.ndim == 1 and other.ndim == 1:
        return (one * other).sum()
    if one.ndim == 1:
        return _products(one[None], other)[..., 0, :]
    if other.ndim == 1:
        return _products(one, other[:, None])[..., 0]
    return _products(one, other)


def _products(a: Floats, b: Floats) -> Floats:
    """Return the products of stacks of matrices, which broadcast."""
    k, m = b.shape[-2:]
    if a.shape[-1] != k:
        raise ValueError(f"matrices of {a.shape} and {b.shape} have no product: {a.shape[-1]} columns and {k} rows")
    if m == 1 and k > COLUMNS:
        # sums over long rows
        return np.asarray(einsum("...ik,...kj->...i", a, b)[..., None])
    if a.ndim > 2 and b.ndim == 2:
        # one matrix for all rows
        return _products(a.reshape(math.prod(a.shape[:-1]), k), b).reshape(*a.shape[:-1], m)
    if a.ndim == 2 and b.ndim == 2 and k and numba_is_loaded():
        out = np.empty((1, len(a), m))
        _multiply(_own(a)[None], _own(b)[None], out)
        return out[0]
    stack = np.broadcast_shapes(a.shape[:-2], b.shape[:-2])
    shape = (*stack, a.shape[-2], m)
    if k == 0:
        return np.zeros(shape)
    if not numba_is_loaded() and math.prod(shape) * k <= FEW:
        total = a[..., :, 0, None] * b[..., None, 0, :]
        for column in range(1, k):
            total += a[..., :, column, None] * b[..., None, column, :]
        return total
    out = np.empty((math.prod(stack), *shape[-2:]))
    _multiply(_stacked(a, stack), _stacked(b, stack), out)
    return out.reshape(shape)


def _stacked(matrices: Floats, stack: tuple[int, ...]) -> Floats:
    """Return matrices as one stack (n, p, q), or a stack of one for all."""
    if math.prod(matrices.shape[:-2]) != 1:
        matrices = np.broadcast_to(matrices, (*stack, *matrices.shape[-2:]))
    return _own(matrices.reshape(math.prod(matrices.shape[:-2]), *matrices.shape[-2:]))


def _own(matrices: Floats) -> Floats:
    """Return matrices in rows that may be written: a kernel is compiled again for those that may not."""
    return np.require(matrices, requirements=["C", "W"])


@bare_kernel
def _multiply(a: Floats, b: Floats, out: Floats) -> None:
    """Write the products of matrices (n, p, k) and (n, k, m); a stack of one matrix is used for all."""
    n, p, m = out.shape
    k = a.shape[2]
    for s in range(n):
        one, other = min(s, len(a) - 1), min(s, len(b) - 1)
        if k == 3 and m == 3:
            b00, b01, b02 = b[other, 0, 0], b[other, 0, 1], b[other, 0, 2]
            b10, b11, b12 = b[other, 1, 0], b[other, 1, 1], b[other, 1, 2]
            b20, b21, b22 = b[other, 2, 0], b[other, 2, 1], b[other, 2, 2]
            for i in range(p):
                x, y, z = a[one, i, 0], a[one, i, 1], a[one, i, 2]
                out[s, i, 0] = x * b00 + y * b10 + z * b20
                out[s, i, 1] = x * b01 + y * b11 + z * b21
                out[s, i, 2] = x * b02 + y * b12 + z * b22
        elif m == 1:
            for i in range(p):
                total = a[one, i, 0] * b[other, 0, 0]
                for c in range(1, k):
                    total += a[one, i, c] * b[other, c, 0]
                out[s, i, 0] = total
        else:
            for i in range(p):
                x = a[one, i, 0]
                for j in range(m):
                    out[s, i, j] = x * b[other, 0, j]
                for c in range(1, k):
                    x = a[one, i, c]
                    for j in range(m):
                        out[s, i, j] += x * b[other, c, j]


def norm(vectors: ArrayLike, axis: int | None = None, *, keepdims: bool = False) -> Any:
    """Return the Euclidean length of vectors along an axis, or of all numbers as one vector."""
    squares = np.square(np.asarray(vectors, dtype=np.float64))
    if squares.ndim == 1 and 0 < len(squares) <= 4 and not keepdims:
        return np.sqrt(sum(squares.tolist()[1:], squares[0]))
    if axis in (-1, squares.ndim - 1) and 0 < squares.shape[-1] <= 4 and not keepdims:
        # several times as fast as a sum over an axis of three
        total = squares[..., 0].copy()
        for column in range(1, squares.shape[-1]):
            total += squares[..., column]
        return np.sqrt(total)
    return np.sqrt(squares.sum(axis=axis, keepdims=keepdims))


def einsum(subscripts: str, *arrays: ArrayLike) -> Any:
    """Return sums of products as `numpy.einsum` does by its own loops, which do not depend on the processor."""
    return np.einsum(subscripts, *map(np.asarray, arrays), optimize=False)  # bits: no BLAS


def determinant(matrices: ArrayLike) -> Any:
    """Return the determinants of matrices (..., d, d) of one to three rows, expanded by the first one."""
    m = np.asarray(matrices, dtype=np.float64)
    size = m.shape[-1]
    if size == 1:
        return m[..., 0, 0]
    if size == 2:
        return m[..., 0, 0] * m[..., 1, 1] - m[..., 0, 1] * m[..., 1, 0]
    # numbers of Python are quicker than arrays without axes
    (a, b, c), (d, e, f), (g, h, i) = m.tolist() if m.ndim == 2 else np.moveaxis(m, (-2, -1), (0, 1))
    return a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)


def solve(matrices: ArrayLike, right: ArrayLike) -> Floats:
    """Return x of ``matrices @ x = right`` for stacks (..., k, k) and (..., k, m), or one (k,), by elimination.

    Each column is eliminated by its largest entry. Where there is none but 0 the solution is not finite.
    """
    matrix, wanted = np.array(matrices, dtype=np.float64), np.array(right, dtype=np.float64)
    if wanted.ndim == 1:
        return solve(matrix, wanted[:, None])[:, 0]
    k = matrix.shape[-1]
    stack = np.broadcast_shapes(matrix.shape[:-2], wanted.shape[:-2])
    rows = np.array(np.broadcast_to(matrix, (*stack, k, k)).reshape(-1, k, k))
    x = np.array(np.broadcast_to(wanted, (*stack, k, wanted.shape[-1])).reshape(len(rows), k, -1))
    _called(_eliminate, k * len(rows))(rows, x)
    return x.reshape(*stack, k, -1)


def inverse(matrices: ArrayLike) -> Floats:
    """Return the inverses of matrices (..., k, k)."""
    return solve(matrices, np.eye(np.shape(matrices)[-1]))


@bare_kernel
def _eliminate(matrix: Floats, x: Floats) -> None:
    """Replace right-hand sides (n, k, m) by solutions; the matrices (n, k, k) are lost."""
    n, k, m = x.shape
    for s in range(n):
        for c in range(k):
            best = c
            for r in range(c + 1, k):
                if abs(matrix[s, r, c]) > abs(matrix[s, best, c]):
                    best = r
            if best != c:
                for j in range(k):
                    matrix[s, c, j], matrix[s, best, j] = matrix[s, best, j], matrix[s, c, j]
                for j in range(m):
                    x[s, c, j], x[s, best, j] = x[s, best, j], x[s, c, j]
            for r in range(c + 1, k):
                part = matrix[s, r, c] / matrix[s, c, c]
                for j in range(c + 1, k):
                    matrix[s, r, j] -= part * matrix[s, c, j]
                for j in range(m):
                    x[s, r, j] -= part * x[s, c, j]
        for c in range(k - 1, -1, -1):
            for j in range(m):
                x[s, c, j] /= matrix[s, c, c]
                for r in range(c):
                    x[s, r, j] -= matrix[s, r, c] * x[s, c, j]


def eigh(matrices: ArrayLike) -> tuple[Floats, Floats]:
    """Return the eigenvalues (..., k), rising, and eigenvectors (..., k, k), in columns, of symmetric matrices.

    The largest component of each vector is positive. By the cyclic method of Jacobi, which is as accurate as numbers
    allow (Demmel and Veselic 1992, doi:10.1137/0613074).
    """
    given = np.asarray(matrices, dtype=np.float64)
    k = given.shape[-1]
    rows = np.array(given.reshape(-1, k, k))
    values, vectors = np.empty(rows.shape[:2]), np.empty(rows.shape)
    _called(_diagonalize, k * len(rows))(rows, values, vectors)
    return values.reshape(given.shape[:-1]), vectors.reshape(given.shape)


@bare_kernel
def _diagonalize(matrix: Floats, values: Floats, vectors: Floats) -> None:
    """Write the eigenvalues (n, k) and eigenvectors (n, k, k) of matrices (n, k, k), which become diagonal."""
    n, k = values.shape
    for s in range(n):
        for r in range(k):
            for c in range(k):
                vectors[s, r, c] = 1.0 if r == c else 0.0
        for _ in range(SWEEPS):
            turned = False
            for p in range(k):
                for q in range(p + 1, k):
                    off, one, other = matrix[s, p, q], matrix[s, p, p], matrix[s, q, q]
                    if abs(off) <= 2.0**-54 * math.sqrt(abs(one)) * math.sqrt(abs(other)) or (
                        abs(one) + abs(off) == abs(one) and abs(other) + abs(off) == abs(other)
                    ):
                        matrix[s, p, q] = matrix[s, q, p] = 0.0
                        continue
                    if not math.isfinite(off):
                        continue
                    turned = True
                    half = (other - one) / (2.0 * off)
                    t = math.copysign(1.0, half) / (abs(half) + math.sqrt(half * half + 1.0))
                    cosine = 1.0 / math.sqrt(t * t + 1.0)
                    sine = t * cosine
                    matrix[s, p, p], matrix[s, q, q] = one - t * off, other + t * off
                    matrix[s, p, q] = matrix[s, q, p] = 0.0
                    for r in range(k):
                        if r not in (p, q):
                            x, y = matrix[s, r, p], matrix[s, r, q]
                            matrix[s, r, p] = matrix[s, p, r] = cosine * x - sine * y
                            matrix[s, r, q] = matrix[s, q, r] = sine * x + cosine * y
                        x, y = vectors[s, r, p], vectors[s, r, q]
                        vectors[s, r, p], vectors[s, r, q] = cosine * x - sine * y, sine * x + cosine * y
            if not turned:
                break
        for p in range(k):
            values[s, p] = matrix[s, p, p]
        for p in range(k):
            first = p
            for q in range(p + 1, k):
                if values[s, q] < values[s, first]:
                    first = q
            values[s, p], values[s, first] = values[s, first], values[s, p]
            most = 0
            for r in range(k):
                vectors[s, r, p], vectors[s, r, first] = vectors[s, r, first], vectors[s, r, p]
                if abs(vectors[s, r, p]) > abs(vectors[s, most, p]):
                    most = r
            if vectors[s, most, p] < 0.0:
                for r in range(k):
                    vectors[s, r, p] = -vectors[s, r, p]


def svd(matrix: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return u (..., n, k), singular values (..., k), falling, and v (..., k, m), where ``u * values @ v`` is a matrix
    (..., n, m) and k the smaller of n and m.

    The largest component of each row of v is positive. A column of u whose value is 0 is 0. By the one-sided method of
    Jacobi (Hestenes 1958, doi:10.1137/0106005).
    """
    given = np.asarray(matrix, dtype=np.float64)
    if given.shape[-2] < given.shape[-1]:
        v, values, u = svd(np.swapaxes(given, -1, -2))
        u, v = np.swapaxes(u, -1, -2), np.swapaxes(v, -1, -2)
        sign = _signs(v)
        return u * np.swapaxes(sign, -1, -2), values, v * sign
    (n, k), stack = given.shape[-2:], given.shape[:-2]
    columns = np.array(np.swapaxes(given, -1, -2).reshape(-1, k, n), order="C")
    values, v = np.empty(columns.shape[:2]), np.empty((len(columns), k, k))
    _called(_orthogonalize, n * len(columns))(columns, values, v)
    u = np.swapaxes(columns, 1, 2).reshape(*stack, n, k)
    return u, values.reshape(*stack, k), v.reshape(*stack, k, k)


def _signs(rows: Floats) -> Floats:
    """Return the signs (..., k, 1) of the largest components of rows (..., k, m)."""
    most = np.take_along_axis(rows, np.abs(rows).argmax(axis=-1)[..., None], axis=-1)
    return np.where(most < 0.0, -1.0, 1.0)


@bare_kernel
def _orthogonalize(rows: Floats, values: Floats, turns: Floats) -> None:
    """Turn the rows of matrices (n, k, m) until they are orthogonal; write their lengths (n, k), falling, and the turns
    (n, k, k). The rows become unit vectors.
    """
    n, k, m = rows.shape
    for s in range(n):
        for r in range(k):
            for c in range(k):
                turns[s, r, c] = 1.0 if r == c else 0.0
        for _ in range(SWEEPS):
            turned = False
            for p in range(k):
                for q in range(p + 1, k):
                    one = other = off = 0.0
                    for j in range(m):
                        x, y = rows[s, p, j], rows[s, q, j]
                        one += x * x
                        other += y * y
                        off += x * y
                    if not abs(off) > ORTHOGONAL * math.sqrt(one) * math.sqrt(other):
                        continue
                    turned = True
                    half = (other - one) / (2.0 * off)
                    t = math.copysign(1.0, half) / (abs(half) + math.sqrt(half * half + 1.0))
                    cosine = 1.0 / math.sqrt(t * t + 1.0)
                    sine = t * cosine
                    for j in range(m):
                        x, y = rows[s, p, j], rows[s, q, j]
                        rows[s, p, j], rows[s, q, j] = cosine * x - sine * y, sine * x + cosine * y
                    for j in range(k):
                        x, y = turns[s, p, j], turns[s, q, j]
                        turns[s, p, j], turns[s, q, j] = cosine * x - sine * y, sine * x + cosine * y
            if not turned:
                break
        for p in range(k):
            total = 0.0
            for j in range(m):
                total += rows[s, p, j] * rows[s, p, j]
            values[s, p] = math.sqrt(total)
        for p in range(k):
            first, most = p, 0
            for q in range(p + 1, k):
                if values[s, q] > values[s, first]:
                    first = q
            values[s, p], values[s, first] = values[s, first], values[s, p]
            for j in range(k):
                turns[s, p, j], turns[s, first, j] = turns[s, first, j], turns[s, p, j]
                if abs(turns[s, p, j]) > abs(turns[s, p, most]):
                    most = j
            sign = -1.0 if turns[s, p, most] < 0.0 else 1.0
            for j in range(k):
                turns[s, p, j] *= sign
            length = sign * values[s, p] if values[s, p] > 0.0 else 1.0
            for j in range(m):
                rows[s, p, j], rows[s, first, j] = rows[s, first, j], rows[s, p, j]
                rows[s, p, j] /= length


def pseudoinverse(matrix: ArrayLike) -> Floats:
    """Return the pseudoinverse (m, n) of a matrix (n, m); values below 1e-15 times the largest count as 0."""
    u, values, v = svd(matrix)
    kept = values > 1e-15 * values.max(initial=0.0)
    return np.asarray(matmul(v.T / np.where(kept, values, np.inf), u.T))


def across(direction: ArrayLike) -> Floats:
    """Return unit vectors (d - 1, d) that are orthogonal to a unit vector (d,) and to each other, and with it, in this
    order, make a right-handed frame in space.
    """
    one = np.asarray(direction, dtype=np.float64)
    if len(one) == 2:
        return np.array([[-one[1], one[0]]])
    k = int(np.abs(one).argmin())
    p, q = (k + 1) % 3, (k + 2) % 3
    found = first, second = np.zeros((2, 3))
    # products of vectors of which one component is 0
    first[p], first[q] = -one[q], one[p]
    first /= norm(first)
    second[k], second[p], second[q] = one[p] * first[q] - one[q] * first[p], -one[k] * first[q], one[k] * first[p]
    return found


def nearest_rotations(matrices: ArrayLike) -> Floats:
    """Return the rotations nearest to matrices (..., 3, 3) (Kabsch 1976, doi:10.1107/S0567739476001873)."""
    u, values, v = svd(matrices)
    # what the smaller values leave open is completed to a rotation
    first, second = u[..., :, 0], u[..., :, 1]
    aside = np.cross(first, np.eye(3)[np.abs(first).argmin(axis=-1)])
    aside /= norm(aside, -1, keepdims=True)
    second = np.where((values[..., 1] > 1e-15 * values[..., 0])[..., None], second, aside)
    u = np.stack([first, second, np.cross(first, second) * np.asarray(determinant(v))[..., None]], axis=-1)
    return np.asarray(matmul(u, v))


def conjugate_gradient(
    matrix: Any, right: Floats, *, relative: float, absolute: float = 0.0, most: int = 1000
) -> Floats:
    """Return x (n,) of ``matrix @ x = right`` for a sparse, symmetric matrix whose diagonal is positive where a row is
    not empty.

    It ends when the norm of the residual is at most `absolute` or `relative` times that of the right-hand side, or
    after `most` steps (Hestenes and Stiefel 1952, doi:10.6028/jres.049.044; with the diagonal as preconditioner).
    """
    diagonal = matrix.diagonal()
    diagonal = np.where(diagonal > 0.0, diagonal, 1.0)
    x, residual = np.zeros_like(right), right.copy()
    enough = max(absolute, relative * float(norm(right)))
    direction, product = np.zeros_like(right), 1.0
    for _ in range(most):
        if float(norm(residual)) <= enough:
            break
        scaled = residual / diagonal
        before, product = product, float((residual * scaled).sum())
        direction = scaled + product / before * direction
        pushed = matrix @ direction  # bits: sparse
        step = product / float((direction * pushed).sum())
        x += step * direction
        residual -= step * pushed
    return x


def gauss_legendre(count: int) -> tuple[Floats, Floats]:
    """Return the nodes, rising, and the weights of the Gauss-Legendre rule on (-1, 1), by Newton's method.

    `numpy.polynomial.legendre.leggauss` begins with eigenvalues of LAPACK.
    """
    nodes = np.array([-math.cos(math.pi * (k + 0.75) / (count + 0.5)) for k in range(count)])
    slope = np.ones(count)
    for _ in range(NEWTON):
        before, value = np.ones(count), nodes.copy()
        for degree in range(2, count + 1):
            before, value = value, ((2 * degree - 1) * nodes * value - (degree - 1) * before) / degree
        slope = count * (nodes * value - before) / (nodes**2 - 1.0)
        nodes -= value / slope
    nodes = (nodes - nodes[::-1]) / 2.0
    weights = 2.0 / ((1.0 - nodes**2) * slope**2)
    return nodes, (weights + weights[::-1]) / 2.0


def _called(kernel: Kernel, size: int) -> Callable[..., Any]:
    """Return a kernel, or the same as plain Python where the matrix is small and numba is not loaded."""
    return kernel.plain if size <= SMALL and not numba_is_loaded() else kernel
