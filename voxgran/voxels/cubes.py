"""Whether cubes meet an ellipsoid, a cylinder or a cone, exactly up to round-off.

In the frame in which an ellipsoid is the unit sphere a cube is a parallelepiped, and its nearest point to the middle
lies inside it, in a face, on an edge or at a corner: each is tried. A cylinder is looked at along its axis and a cone
from its apex; both are disks then, and the part of the cube between the ends of the solid is a convex polygon.
"""

import itertools

import numpy as np

from voxgran._base.arrays import Booleans, Floats

#: widening of closed comparisons, relative to the size of the solid in voxels
CLOSED = 1e-9
#: corners of the unit cube about the origin, and its edges as pairs of them
_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
_EDGES = np.array([(a, b) for a, b in itertools.combinations(range(8), 2) if bin(a ^ b).count("1") == 1])


def meets_cubes(middles: Floats, stretch: Floats, curve: Floats, ends: Floats, kind: str) -> Booleans:
    """Return whether unit cubes with centers (n, 3), from the centroid in voxels, meet a solid of revolution, (n,).

    Arguments are as for :func:`voxgran.voxels.round_shares.round_shares`.
    """
    if kind in ("sphere", "ellipsoid"):
        return _nearest_square(middles @ stretch.T, stretch) <= (1.0 + CLOSED) ** 2
    corners = (middles[:, None] + _CORNERS) @ stretch.T
    top = ends[1] if kind == "cylinder" else ends[1] - 1e-9 * (ends[1] - ends[0])
    points = _between(corners, ends[0] - CLOSED, top + (CLOSED if kind == "cylinder" else 0.0))
    flat, radius = points[:, :, :2], np.sqrt(curve[0])
    if kind == "cone":
        flat, radius = flat / (ends[1] - points[:, :, 2:]), np.sqrt(curve[2])
    return _hull_distance(flat) <= radius * (1.0 + CLOSED)


def _nearest_square(middle: Floats, edges: Floats) -> Floats:
    """Return the least squared distance from the origin of parallelepipeds with edges in the columns of a matrix."""
    best = np.full(len(middle), np.inf)
    for fixed in itertools.product((None, -0.5, 0.5), repeat=3):
        free = [axis for axis in range(3) if fixed[axis] is None]
        start = middle + edges @ np.array([0.0 if value is None else value for value in fixed])
        place = -np.linalg.lstsq(edges[:, free], start.T, rcond=None)[0].T if free else np.zeros((len(middle), 0))
        valid = (np.abs(place) <= 0.5 + 1e-12).all(axis=1)
        square = ((start + place @ edges[:, free].T) ** 2).sum(axis=1)
        best = np.where(valid, np.minimum(best, square), best)
    return best


def _between(corners: Floats, low: float, high: float) -> Floats:
    """Return the corners (n, 32, 3) of cubes cut by two levels of t; NaN if there is none."""
    a, b = corners[:, _EDGES[:, 0]], corners[:, _EDGES[:, 1]]
    found = [np.where(((corners[:, :, 2] >= low) & (corners[:, :, 2] <= high))[:, :, None], corners, np.nan)]
    for level in (low, high):
        rise = b[:, :, 2] - a[:, :, 2]
        share = (level - a[:, :, 2]) / np.where(rise == 0, np.inf, rise)
        crosses = (np.minimum(a[:, :, 2], b[:, :, 2]) < level) & (np.maximum(a[:, :, 2], b[:, :, 2]) > level)
        found.append(np.where(crosses[:, :, None], a + share[:, :, None] * (b - a), np.nan))
    return np.concatenate(found, axis=1)


def _hull_distance(points: Floats) -> Floats:
    """Return the distance of the origin from the convex hulls of (n, m, 2) points; NaN points do not count."""
    first, second = np.triu_indices(points.shape[1], k=0)
    a, b = points[:, first], points[:, second]
    along = b - a
    length = (along**2).sum(axis=2)
    share = np.clip(-(a * along).sum(axis=2) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    nearest = np.sqrt(((a + share[:, :, None] * along) ** 2).sum(axis=2))
    # the origin lies inside where no angle between neighbours is half a turn or more
    angle = np.sort(np.arctan2(points[:, :, 1], points[:, :, 0]), axis=1)
    gap = np.diff(np.concatenate([angle, angle[:, :1] + 2 * np.pi], axis=1), axis=1)
    count = np.isfinite(angle).sum(axis=1)
    wrap = angle[:, 0] + 2 * np.pi - np.take_along_axis(angle, np.maximum(count - 1, 0)[:, None], axis=1)[:, 0]
    widest = np.maximum(np.nanmax(np.where(np.isfinite(gap), gap, 0.0), axis=1), wrap)
    distance = np.min(np.where(np.isfinite(nearest), nearest, np.inf), axis=1)
    return np.where((count > 0) & (widest < np.pi), 0.0, distance)
