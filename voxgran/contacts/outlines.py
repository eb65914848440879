"""Contacts of polygons with polygons and disks, in the plane.

The nearest points are those of two edges. The depth of overlapping polygons is found along their edges by branch and
bound: over a piece of an edge the distance from one edge of the other polygon is largest at an end, and the smallest of
these maxima bounds the depth over the whole piece. The contact of a disk is at the edge point nearest to its center.
"""

import math

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran.contacts.depth import ACCURACY, MOST_PATCHES
from voxgran.contacts.inside import inner_distance, placed
from voxgran.contacts.model import Touch, direction
from voxgran.contacts.search import deepest_point
from voxgran.geometry.rotation import stretch_of
from voxgran.shapes.outline import Outline

#: distance, in sizes of the pair, below which rounding could hide an overlap
ROUNDING = 1e-13


def touch_polygons(
    one: Outline, other: Outline, *, matrix: Floats, offset: Floats, reach: float, deepest: bool = True
) -> Touch:
    """Return the contact of two polygons.

    If `deepest` is false, the depth is that of the deepest edge point; the interior is not searched.
    """
    mine = np.array(one.vertices, order="C")
    theirs = linear.matmul(other.vertices, matrix[:2, :2].T) + offset[:2]
    near = np.zeros(4)
    distance = _nearest_edges(mine, theirs, near)
    size = float(np.ptp(np.concatenate([mine, theirs]), axis=0).max())
    nested = _signed(mine, theirs[0, 0], theirs[0, 1], near[:0]) > 0 or (
        _signed(theirs, mine[0, 0], mine[0, 1], near[:0]) > 0
    )
    point, partner = np.array([*near[:2], 0.0]), np.array([*near[2:], 0.0])
    if distance > ROUNDING * size and not nested:
        return Touch.between(distance if distance <= reach else np.inf, point, partner, offset)
    touch = _deepest_edge(mine, theirs, 1e-15 * size, offset)
    back = _deepest_edge(theirs, mine, 1e-15 * size, -offset).flipped()
    touch = touch if touch.gap <= back.gap else back
    if not deepest:
        return touch
    inner = placed(inner_distance(other), matrix=matrix, offset=offset)
    return _deeper(touch, one, inner, mine, theirs, offset)


def touch_disk(
    polygon: Outline, disk: Outline, *, matrix: Floats, offset: Floats, reach: float, deepest: bool = True
) -> Touch:
    """Return the contact, from the polygon to the disk, of a polygon with a disk.

    If `deepest` is false, the depth is that towards the nearest edge; the interior is not searched.
    """
    radius = disk.radius * stretch_of(matrix)
    center = linear.matmul(matrix, np.array([*disk.center, 0.0])) + offset
    near, vertices = np.zeros(2), np.array(polygon.vertices, order="C")
    distance = -float(_signed(vertices, center[0], center[1], near))
    surface = np.array([*near, 0.0])
    gap = max(distance - radius, -radius)
    if gap > reach:
        return Touch.apart()
    normal = direction((center - surface) * (1.0 if distance > 0 else -1.0), offset)
    touch = Touch(gap, normal, surface + 0.5 * gap * normal)
    if distance > 0 or not deepest:
        return touch
    inner = placed(inner_distance(disk), matrix=matrix, offset=offset)
    corners = center[:2] + radius * np.array([[-1.0, -1.0], [1.0, 1.0]])
    return _deeper(touch, polygon, inner, vertices, corners, offset)


def _deeper(touch: Touch, one: Outline, inner: object, mine: Floats, theirs: Floats, offset: Floats) -> Touch:
    """Return the contact, or that at a deeper point inside both grains."""
    low = np.array([*np.maximum(mine.min(axis=0), theirs.min(axis=0)), 0.0])
    high = np.array([*np.minimum(mine.max(axis=0), theirs.max(axis=0)), 0.0])
    depth, point, _ = deepest_point(inner_distance(one), inner, low, high)  # type: ignore[arg-type]
    if depth > -touch.gap * (1 + ACCURACY):
        return Touch(-depth, direction(offset, offset), point)
    return touch


def _deepest_edge(polygon: Floats, edges: Floats, floor: float, fallback: Floats) -> Touch:
    """Return the contact at the deepest point of given edges in a polygon."""
    found = np.zeros(4)
    depth = float(_search_edges(polygon, edges, floor, ACCURACY, MOST_PATCHES, found))
    point, surface = np.array([*found[:2], 0.0]), np.array([*found[2:], 0.0])
    return Touch(-depth, direction(surface - point, fallback), (point + surface) / 2)


@kernel
def _on_segment(ax, ay, bx, by, x, y):  # type: ignore[no-untyped-def]
    """Return the point of a segment nearest to (x, y)."""
    ux, uy = bx - ax, by - ay
    square = ux * ux + uy * uy
    share = ((x - ax) * ux + (y - ay) * uy) / square if square > 0.0 else 0.0
    if share >= 1.0:
        return bx, by
    share = max(share, 0.0)
    return ax + share * ux, ay + share * uy


@kernel
def _signed(polygon, x, y, near):  # type: ignore[no-untyped-def]
    """Return the distance of (x, y) from a polygon's edges, positive inside; write the nearest point on request."""
    best, inside, count = np.inf, False, len(polygon)
    for k in range(count):
        n = (k + 1) % count
        ax, ay, bx, by = polygon[k, 0], polygon[k, 1], polygon[n, 0], polygon[n, 1]
        px, py = _on_segment(ax, ay, bx, by, x, y)
        square = (px - x) ** 2 + (py - y) ** 2
        if square < best:
            best = square
            if len(near) > 0:
                near[0], near[1] = px, py
        if (ay <= y) != (by <= y):
            side = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
            if (side > 0.0) == (by > ay):
                inside = not inside
    return math.sqrt(best) if inside else -math.sqrt(best)


@kernel
def _nearest_edges(one, other, near):  # type: ignore[no-untyped-def]
    """Return the distance of the edges of two polygons, 0 where they cross; write the nearest points."""
    best = np.inf
    for i in range(len(one)):
        n = (i + 1) % len(one)
        ax, ay, bx, by = one[i, 0], one[i, 1], one[n, 0], one[n, 1]
        for j in range(len(other)):
            m = (j + 1) % len(other)
            cx, cy, dx, dy = other[j, 0], other[j, 1], other[m, 0], other[m, 1]
            gap_x = max(min(ax, bx) - max(cx, dx), min(cx, dx) - max(ax, bx), 0.0)
            gap_y = max(min(ay, by) - max(cy, dy), min(cy, dy) - max(ay, by), 0.0)
            if gap_x * gap_x + gap_y * gap_y > best:
                continue
            px, py = _on_segment(ax, ay, bx, by, cx, cy)
            best = _keep(near, best, px, py, cx, cy)
            px, py = _on_segment(cx, cy, dx, dy, ax, ay)
            best = _keep(near, best, ax, ay, px, py)
            wx, wy, ux, uy = dx - cx, dy - cy, bx - ax, by - ay
            before = ux * (cy - ay) - uy * (cx - ax)
            after = ux * (dy - ay) - uy * (dx - ax)
            left = wx * (ay - cy) - wy * (ax - cx)
            right = wx * (by - cy) - wy * (bx - cx)
            if before * after < 0.0 and left * right < 0.0:
                share = before / (before - after)
                near[0], near[1] = cx + share * wx, cy + share * wy
                near[2], near[3] = near[0], near[1]
                return 0.0
    return math.sqrt(best)


@kernel
def _keep(near, best, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Write two points if they are closer than the best ones; return the smaller squared distance."""
    square = (ax - bx) ** 2 + (ay - by) ** 2
    if square < best:
        near[0], near[1], near[2], near[3] = ax, ay, bx, by
        return square
    return best


@kernel
def _bound(polygon, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Return the minimum over the edges of a polygon of the larger distance of two points from the edge."""
    best = np.inf
    for k in range(len(polygon)):
        n = (k + 1) % len(polygon)
        px, py = _on_segment(polygon[k, 0], polygon[k, 1], polygon[n, 0], polygon[n, 1], ax, ay)
        qx, qy = _on_segment(polygon[k, 0], polygon[k, 1], polygon[n, 0], polygon[n, 1], bx, by)
        best = min(best, max((px - ax) ** 2 + (py - ay) ** 2, (qx - bx) ** 2 + (qy - by) ** 2))
    return math.sqrt(best)


@kernel
def _search_edges(polygon, edges, floor, accuracy, most, found):  # type: ignore[no-untyped-def]
    """Bisect edges until no piece can contain a point deeper in the polygon than the best; return its depth."""
    best, steps, near = 0.0, 0, np.zeros(2)
    stack = np.zeros((128, 2))
    for k in range(len(edges)):
        n = (k + 1) % len(edges)
        ax, ay = edges[k, 0], edges[k, 1]
        ux, uy = edges[n, 0] - ax, edges[n, 1] - ay
        half = 0.5 * math.sqrt(ux * ux + uy * uy)
        stack[0, 0], stack[0, 1] = 0.0, 1.0
        depth = 1
        while depth > 0 and steps < most:
            depth -= 1
            steps += 1
            s, t = stack[depth, 0], stack[depth, 1]
            reach = np.inf
            for trip in range(3):
                share = 0.5 * (s + t) if trip == 0 else (s if trip == 1 else t)
                x, y = ax + share * ux, ay + share * uy
                signed = _signed(polygon, x, y, near)
                if trip == 0:
                    reach = signed + (t - s) * half
                if signed > best:
                    best = signed
                    found[0], found[1], found[2], found[3] = x, y, near[0], near[1]
            bar = best * (1.0 + accuracy) + floor
            if reach <= bar or depth + 2 > len(stack):
                continue
            if _bound(polygon, ax + s * ux, ay + s * uy, ax + t * ux, ay + t * uy) <= bar:
                continue
            stack[depth, 0], stack[depth, 1] = s, 0.5 * (s + t)
            stack[depth + 1, 0], stack[depth + 1, 1] = 0.5 * (s + t), t
            depth += 2
    return best
