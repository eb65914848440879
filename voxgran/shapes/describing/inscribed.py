"""The largest sphere inside of a shape (in 2D, the largest circle)."""

import math

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran.geometry.tree import STACK, TriangleTree, grow_tree, is_behind, push_halves, square_to_box
from voxgran.geometry.triangles import closest_on_triangle
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

#: cells along the longest edge of the first lattice, and lattices, each of half the step of the one before
CELLS, LEVELS = 8, 10
#: lattice from which on the deepest center is moved to the next local maximum
MOVED_FROM = 3
#: cells that are kept of each lattice at the most, the deepest ones
KEPT = 250
#: triangles up to which a convex shape is one linear program, and relative difference of the volumes of a shape and its
#: convex hull up to which it counts as convex
FEW, CONVEX = 2_000, 1e-9
#: gain of depth, relative, below which a center is not moved any more
LEAST_GAIN = 1e-9
#: moves of one center at the most
MOST_MOVES = 20
#: exchanges of the simplex method at the most, those after which it takes the first row that is violated, and by how
#: much a row must be
MOST_TURNS, CAREFUL, SLACK = 500, 50, 1e-13


def inscribed_radius(shape: Shape) -> float:
    """Return the radius of the largest sphere (in 2D, the largest circle) inside of a shape; NaN for an open surface.

    Solids in closed form have closed formulas, and convex ones of few faces are one linear program. For others the
    cells of a lattice are bisected as long as they can contain a deeper point than the deepest one that is known: the
    distance from the surface changes at most as much as the place. The deepest center is moved to the local maximum,
    where the sphere touches the surface all around; the radius is that of the tessellation up to rounding. Two local
    maxima that differ by less than 2e-4 of the size may be taken for each other.

    References
    ----------
    .. [1] Garcia-Castellanos & Lombardo 2007, doi:10.1080/14702540801897809: poles of inaccessibility
    .. [2] Hunter & Lange 2004, doi:10.1198/0003130042836: maximization of lower bounds that touch at the present place
    """
    if shape.is_open:
        return float("nan")
    geometry = shape.geometry
    if shape.is_sphere:
        return float(shape.bounding_radius)
    if isinstance(geometry, Primitive):
        return _of_primitive(geometry)
    if isinstance(geometry, Outline) and geometry.kind == "disk":
        return geometry.radius
    if len(shape.faces) <= FEW:
        hull = load("scipy.spatial").ConvexHull(shape.vertices[:, : shape.dimension])
        if hull.volume <= shape.volume * (1 + CONVEX):
            # half-spaces n x + d <= 0 with unit normals, rows (n, d)
            size = shape.bounding_radius
            return size * _best_step(-hull.equations[:, :-1], -hull.equations[:, -1] / size)[1]
    if isinstance(geometry, Outline):
        return _of_tree(_walls(geometry.vertices), axes=2)
    return _of_tree(shape._tree, axes=3)


def _walls(corners: Floats) -> TriangleTree:
    """Return the walls of a prism whose section at z = 0 is a polygon, so high that its ends are far away."""
    end = 2 * float(np.ptp(corners, axis=0).max())
    count = len(corners)
    below, above = (np.column_stack([corners, np.full(count, z)]) for z in (-end, end))
    one, two = np.arange(count), np.roll(np.arange(count), -1)
    faces = np.concatenate([np.column_stack([one, two, two + count]), np.column_stack([one, two + count, one + count])])
    return grow_tree(np.concatenate([below, above]), faces)


def _of_tree(tree: TriangleTree, *, axes: int) -> float:
    """Return the largest depth in a closed surface, in 2D at z = 0."""
    low, high = tree.low[0, :axes], tree.high[0, :axes]
    counts = np.ceil(CELLS * (high - low) / (high - low).max()).astype(int)
    half = (high - low) / counts / 2
    places = low + (2 * np.indices(counts).reshape(axes, -1).T + 1) * half
    children = 2 * np.indices((2,) * axes).reshape(axes, -1).T - 1
    near, best = np.full(len(places), -1), 0.0
    for level in range(LEVELS):
        if level:
            half = half / 2
            places, near = (places[:, None] + children * half).reshape(-1, axes), np.repeat(near, len(children))
        reach = float(linear.norm(half))
        depth = _depths(tree, places, near, reach, best)
        deepest = int(depth.argmax())
        if depth[deepest] > best:
            best = float(depth[deepest])
            if level >= MOVED_FROM:
                best = _local_maximum(tree, places[deepest], best, float(half.max()))
        kept = np.argsort(-depth, kind="stable")[:KEPT]
        kept = kept[depth[kept] + reach > best]
        places, near = places[kept], near[kept]
        if not len(places):
            break
    return best


def _depths(tree: TriangleTree, places: Floats, near: Integers, reach: float, best: float) -> Floats:
    """Return the distances of points from the surface, negative outside, and minus infinity for points around which no
    point within `reach` is deeper than `best` or than one of the points before.

    `near` (n,) is a triangle near each point, -1 where none is known; it becomes the nearest one.
    """
    depth = np.full(len(places), -np.inf)
    _find_depths(_in_space(places), near, *tree.arrays, reach, best, depth)
    return depth


def _in_space(places: Floats) -> Floats:
    """Return points (n, 2) or (n, 3) as (n, 3), at z = 0 in 2D."""
    placed = np.zeros((len(places), 3))
    placed[:, : places.shape[1]] = places
    return placed


def _local_maximum(tree: TriangleTree, center: Floats, depth: float, trust: float) -> float:
    """Return the depth at the local maximum next to a point of known depth.

    The distance from a triangle is a convex function, which its tangent plane at the present place supports from below.
    The smallest of these lower bounds is maximized by a linear program within `trust` along each axis, over all
    triangles that can be the nearest one there; the depth at the maximum is at least as large. Where the sphere touches
    faces only, the bounds are exact.
    """
    for _ in range(MOST_MOVES):
        at = _in_space(center[None])[0]
        near = np.empty((len(tree.corners), 3))
        # the center moves by at most sqrt(3) trust, and depths change by no more than that
        count = _find_near(at[0], at[1], at[2], *tree.arrays[:4], depth + 2 * math.sqrt(3) * trust, near)
        away = at - near[:count]
        distance = linear.norm(away, axis=1)
        step, _ = _best_step((away / distance[:, None])[:, : len(center)], (distance - depth) / trust)
        moved = center + trust * step
        deeper = float(_depths(tree, moved[None], np.full(1, -1), 0.0, 0.0)[0])
        gain = deeper - depth
        if gain > 0:
            center, depth = moved, deeper
        if gain <= LEAST_GAIN * depth:
            break
        trust = min(trust, 2 * trust * float(np.abs(step).max()))
    return depth


def _best_step(ways: Floats, spare: Floats) -> tuple[Floats, float]:
    """Return the step in the cube of edge 2 that maximizes the smallest of ``spare + ways @ step``, and this maximum;
    arrays are (m, d) and (m,), with d of 2 or 3.
    """
    axes = ways.shape[1]
    in_space = np.zeros((len(ways), 3))
    in_space[:, :axes] = ways
    found = _maximin(in_space, np.ascontiguousarray(spare))
    return found[:axes], float(found[3])


@kernel
def _maximin(ways, spare):  # type: ignore[no-untyped-def]
    """Return the step x, y, z of `_best_step` and the maximum, by the simplex method.

    The dual program has a multiplier for each row, whose sum is 1, and for each face of the cube; four of them are not
    0. Their costs are `spare`, and 1 for the faces.
    """
    m = len(spare)
    base, share = np.empty(4, np.int64), np.zeros(4)
    inverse, step, column, turned = np.zeros((4, 4)), np.zeros(4), np.zeros(4), np.zeros(4)
    # the tightest row, and the face of each axis against which it pushes
    first = np.argmin(spare)
    base[3], share[3], inverse[3, 3] = first, 1.0, 1.0
    for axis in range(3):
        side = 1.0 if ways[first, axis] >= 0.0 else -1.0
        base[axis], share[axis] = m + 2 * axis + (0 if side > 0.0 else 1), side * ways[first, axis]
        inverse[axis, axis], inverse[axis, 3] = side, side * ways[first, axis]
    for turn in range(MOST_TURNS):
        for axis in range(4):
            step[axis] = 0.0
            for k in range(4):
                step[axis] += inverse[k, axis] * (spare[base[k]] if base[k] < m else 1.0)
        worst, enters = -SLACK, -1
        for k in range(m + 6):
            if k < m:
                left = spare[k] + ways[k, 0] * step[0] + ways[k, 1] * step[1] + ways[k, 2] * step[2] - step[3]
            else:
                left = 1.0 - step[(k - m) // 2] * (1.0 if (k - m) % 2 == 0 else -1.0)
            # the first one of all, once it may go round in a circle
            if left < worst and not (turn > CAREFUL and enters >= 0):
                worst, enters = left, k
        if enters < 0:
            break
        for axis in range(4):
            column[axis] = 0.0
        if enters < m:
            column[0], column[1], column[2], column[3] = -ways[enters, 0], -ways[enters, 1], -ways[enters, 2], 1.0
        else:
            column[(enters - m) // 2] = 1.0 if (enters - m) % 2 == 0 else -1.0
        least, leaves = np.inf, -1
        for k in range(4):
            turned[k] = 0.0
            for axis in range(4):
                turned[k] += inverse[k, axis] * column[axis]
            if turned[k] > SLACK:
                ratio = share[k] / turned[k]
                if ratio < least or (ratio == least and base[k] < base[leaves]):
                    least, leaves = ratio, k
        if leaves < 0:
            break
        base[leaves] = enters
        for axis in range(4):
            inverse[leaves, axis] /= turned[leaves]
        for k in range(4):
            if k != leaves:
                share[k] = max(share[k] - turned[k] * least, 0.0)
                for axis in range(4):
                    inverse[k, axis] -= turned[k] * inverse[leaves, axis]
        share[leaves] = least
    return step


@kernel
def _find_depths(points, near, corners, low, high, start, normals, reach, best, depth):  # type: ignore[no-untyped-def]
    """Write the depth of each point around which a deeper point than the deepest one so far can lie."""
    stack = np.zeros(STACK, dtype=np.int64)
    leaves = len(low) // 2
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        enough = max(best - reach, 0.0) ** 2
        square, found, feature = np.inf, -1, 0
        qx, qy, qz = x, y, z
        if near[p] >= 0:
            found = near[p]
            qx, qy, qz, feature = closest_on_triangle(corners, found, x, y, z)
            square = (qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2
        stack[0], waiting = 0, 1
        # the search ends with the first triangle that is near enough
        while waiting > 0 and square >= enough:
            waiting -= 1
            node = stack[waiting]
            if square_to_box(low, high, node, x, y, z) >= square:
                continue
            if node < leaves:
                push_halves(low, high, node, x, y, z, stack, waiting)
                waiting += 2
                continue
            for k in range(start[node, 0], start[node, 1]):
                px, py, pz, part = closest_on_triangle(corners, k, x, y, z)
                away = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
                if away < square:
                    square, found, feature = away, k, part
                    qx, qy, qz = px, py, pz
        near[p] = found
        if square < enough:
            continue
        inside = is_behind(normals, found, feature, x - qx, y - qy, z - qz)
        depth[p] = math.sqrt(square) if inside else -math.sqrt(square)
        best = max(best, depth[p])


@kernel
def _find_near(x, y, z, corners, low, high, start, reach, near):  # type: ignore[no-untyped-def]
    """Write the nearest point of each triangle within reach of (x, y, z); return their number."""
    count = 0
    for node in range(len(low) // 2, len(low)):
        if square_to_box(low, high, node, x, y, z) > reach * reach:
            continue
        for k in range(start[node, 0], start[node, 1]):
            px, py, pz, _ = closest_on_triangle(corners, k, x, y, z)
            if (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2 <= reach * reach:
                near[count, 0], near[count, 1], near[count, 2] = px, py, pz
                count += 1
    return count


def _of_primitive(geometry: Primitive) -> float:
    """Return the radius of the largest sphere in a solid in closed form."""
    d = geometry.dimensions
    if geometry.kind == "box":
        return min(d) / 2
    if geometry.kind == "cylinder":
        return min(d[0], d[1] / 2)
    if geometry.kind == "cone":
        return d[0] * d[1] / (d[0] + float(np.hypot(d[0], d[1])))
    return d[0] if geometry.kind == "spherocylinder" else min(d)
