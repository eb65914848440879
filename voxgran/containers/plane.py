"""Regions of the plane z = 0 that loops of straight edges bound: their checks, their triangles and their walls.

The walls are those of a prism upon the region, so high that its ends are never the nearest wall of a point in the
plane: what knows the distance from a closed mesh knows that from a polygon with holes, by the same tree.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers, as_array, as_floats, as_points, check_lengths, read_only
from voxgran._base.errors import InputError, shown
from voxgran._base.lazy import load
from voxgran.shapes.mesh import Mesh

#: pairs of edges that are compared at a time
PAIRS = 2**20
#: width of a loop, in its lengths, below which its corners lie on one line
NO_WIDTH = 1e-14


def points_in_plane(points: "ArrayLike") -> Floats:
    """Return (n, 2 or 3) points as (n, 3) with z = 0.

    Raises
    ------
    InputError
        If the points are not finite numbers in two or three columns.
    """
    array = as_array(points, "points")
    given = as_floats(points, "points", shape=(None, 2 if array.ndim == 2 and array.shape[1] == 2 else 3))
    return np.column_stack([given[:, :2], np.zeros(len(given))])


def as_loops(corners: "ArrayLike", holes: "Sequence[ArrayLike]") -> tuple[Floats, ...]:
    """Return the loops (n, 2) of a region: the outer one counterclockwise, then its holes clockwise.

    A last corner that repeats the first one is left out.

    Raises
    ------
    InputError
        If a loop has fewer than three corners or no area, loops meet themselves or each other, or a hole lies outside
        of the region or in another hole.
    """
    _check_list(holes)
    names = ["corners", *(f"holes[{k}]" for k in range(len(holes)))]
    loops = [
        _as_loop(loop, name, turn=1 if name == "corners" else -1)
        for name, loop in zip(names, [corners, *holes], strict=True)
    ]
    check_lengths(np.ptp(loops[0], axis=0), "extent of the polygon")
    _refuse_meeting(loops, names)
    low, high = (np.array([end(loop, axis=0) for loop in loops]) for end in (np.min, np.max))
    for k, loop in enumerate(loops[1:], 1):
        if not _contains(loops[0], loop[0]):
            raise InputError(f"{names[k]} lies outside of the polygon: a hole is a part that is left out; move it")
        for other in np.flatnonzero(((low <= loop[0]) & (loop[0] <= high)).all(axis=1)):
            if other not in (0, k) and _contains(loops[other], loop[0]):
                raise InputError(f"{names[k]} lies in {names[other]}: holes must lie apart; leave one of them out")
    return tuple(read_only(loop) for loop in loops)


def _check_list(holes: Any) -> None:
    """Check that holes are a list of loops."""
    several = isinstance(holes, Sequence) and not isinstance(holes, str | bytes)
    if not several and not (isinstance(holes, np.ndarray) and holes.ndim):
        raise InputError(f"holes is {shown(holes)}: it must be a list of loops, each a list of corners; give one")
    first = holes[0] if len(holes) else None
    if isinstance(first, Sequence | np.ndarray) and len(first) and np.isscalar(first[0]):
        raise InputError(
            f"holes begins with {shown(first)}: it must be a list of loops, one for each hole; add brackets"
        )


def area_of(loop: Floats) -> float:
    """Return the area within a loop (n, 2), negative where it runs clockwise."""
    x, y = (loop - loop[0]).T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def triangles_of(loops: Sequence[Floats]) -> Integers:
    """Return the triangles (m, 3) of a region, counterclockwise, as indices of the corners of all of its loops."""
    lower, size = loops[0].min(axis=0), float(np.ptp(loops[0], axis=0).max())
    faces = load("manifold3d").triangulate([np.ascontiguousarray((loop - lower) / size) for loop in loops])
    return np.array(faces, dtype=np.int64).reshape(-1, 3)


def prism_of(loops: Sequence[Floats], half: float) -> Mesh:
    """Return the prism upon a region from z = -half to half, its triangles counterclockwise from outside."""
    flat, cap = np.concatenate(loops), triangles_of(loops)
    n = len(flat)
    vertices = np.concatenate([np.column_stack([flat, np.full(n, z)]) for z in (-half, half)])
    a = np.arange(n)
    b = np.concatenate([np.roll(part, -1) for part in np.split(a, np.cumsum([len(loop) for loop in loops])[:-1])])
    sides = np.concatenate([np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n])])
    return Mesh(vertices, np.concatenate([cap[:, ::-1], cap + n, sides]))


def _as_loop(loop: "ArrayLike", name: str, *, turn: int) -> Floats:
    """Return the corners of a loop in the sense of a turn: 1 counterclockwise, -1 clockwise."""
    # without the sign of a zero, so that loops that are equal have the same bits
    points = as_points(loop, name, dimension=2) + 0.0
    if len(points) > 1 and (points[0] == points[-1]).all():
        points = points[:-1]
    if len(points) < 3:
        raise InputError(f"{name} has {len(points)} corners: a loop needs at least 3; add corners")
    twice = np.flatnonzero((points == np.roll(points, -1, axis=0)).all(axis=1))
    if len(twice):
        raise InputError(
            f"{name}[{twice[0]}] and the next one are both {points[twice[0]].tolist()}: an edge has a length; leave "
            "one of them out"
        )
    widths = linear.svd(points - points.mean(axis=0))[1]
    if widths[1] <= NO_WIDTH * widths[0]:
        raise InputError(f"{name} has no area: its corners must not lie on one line; move them")
    return points[::-1].copy() if area_of(points) * turn < 0 else points.copy()


def _refuse_meeting(loops: Sequence[Floats], names: Sequence[str]) -> None:
    """Check that the edges of loops have no point in common but the corners that follow each other."""
    loop = np.repeat(np.arange(len(loops)), [len(part) for part in loops])
    edge = np.concatenate([np.arange(len(part)) for part in loops])
    a, b = np.concatenate(loops), np.concatenate([np.roll(part, -1, axis=0) for part in loops])
    low, high = np.minimum(a, b), np.maximum(a, b)
    order = np.argsort(low[:, 0], kind="stable")
    # of the edges in their order from left to right, those that begin before an edge ends
    until = np.searchsorted(low[order, 0], high[order, 0], side="right")
    many = until - np.arange(len(order)) - 1
    begin = 0
    while begin < len(order):
        end = max(begin + 1, int(np.searchsorted(np.cumsum(many[begin:]), PAIRS, side="right")) + begin)
        first = np.repeat(np.arange(begin, end), many[begin:end])
        ahead = np.arange(len(first)) - np.repeat(np.cumsum(many[begin:end]) - many[begin:end], many[begin:end])
        i, j = order[first], order[first + 1 + ahead]
        near = ((low[i] <= high[j]) & (low[j] <= high[i])).all(axis=1)
        i, j = i[near], j[near]
        meets = np.flatnonzero(_meet(a, b, i, j))
        if len(meets):
            one, two = sorted((int(i[meets[0]]), int(j[meets[0]])))
            where = f"edge {edge[one]} of {names[loop[one]]} meets edge {edge[two]} of {names[loop[two]]}"
            raise InputError(
                f"{where}: loops must neither cross nor touch themselves or each other; move their corners"
            )
        begin = end


def _meet(a: Floats, b: Floats, i: Integers, j: Integers) -> Booleans:
    """Return which pairs of edges i, j have a point in common other than a corner in which one follows the other."""
    one, two = _side(a[i], b[i], a[j]), _side(a[i], b[i], b[j])
    three, four = _side(a[j], b[j], a[i]), _side(a[j], b[j], b[i])
    meet = (one * two <= 0) & (three * four <= 0)
    after, before = (b[i] == a[j]).all(axis=1), (a[i] == b[j]).all(axis=1)
    # edges that follow each other meet elsewhere only where one folds back onto the other
    along = ((b[i] - a[i]) * (b[j] - a[j])).sum(axis=1)
    folded = (one == 0) & (two == 0) & (along < 0)
    empty = (a[i] == b[i]).all(axis=1) | (a[j] == b[j]).all(axis=1)
    return np.asarray(np.where(after | before, folded | empty | (after & before), meet))


def _side(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the orientation of triangles a, b, c as a sign."""
    u, v = b - a, c - a
    return np.asarray(np.sign(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]))


def _contains(loop: Floats, point: Floats) -> bool:
    """Return whether a point that is on no edge lies within a loop."""
    a, b = loop, np.roll(loop, -1, axis=0)
    side = (b[:, 0] - a[:, 0]) * (point[1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (point[0] - a[:, 0])
    crosses = ((a[:, 1] <= point[1]) != (b[:, 1] <= point[1])) & ((side > 0) == (b[:, 1] > a[:, 1]))
    return bool(crosses.sum() % 2)
