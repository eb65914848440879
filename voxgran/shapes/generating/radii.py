"""Radii of a solid in all directions from its centroid."""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.shapes.model import Shape

#: faces whose directions are looked up at once
AT_ONCE = 4000
#: part of a radius within which two crossings are one, at an edge of two faces
SAME = 1e-9
#: rounding of the side of an edge on which a ray lies
ROUNDING = 1e-12


def radii_of(shape: Shape, directions: Floats) -> tuple[Floats, float]:
    """Return the distances (n,) at which rays from the centroid leave a solid for the last time, and the share of rays
    that leave it more than once.

    Raises
    ------
    InputError
        If some rays do not leave it, since the centroid lies outside.
    """
    if shape.is_sphere:
        return np.full(len(directions), shape.bounding_radius), 0.0
    radii = np.zeros(len(directions))
    rays, places = [], []
    tree = load("scipy.spatial").cKDTree(directions)
    for k in range(0, len(shape.faces), AT_ONCE):
        corners = shape.vertices[shape.faces[k : k + AT_ONCE]]
        unit = corners / np.maximum(linear.norm(corners, axis=2, keepdims=True), 1e-300)
        middle = unit.sum(axis=1)
        middle /= np.maximum(linear.norm(middle, axis=1, keepdims=True), 1e-300)
        # a face with the centroid in its plane may be seen in half of all directions
        reach = linear.norm(unit - middle[:, None], axis=2).max(axis=1) * (1 + 1e-6) + 1e-12
        reach = np.where(reach > 1.0, 2.0, reach)
        near = tree.query_ball_point(middle, reach)
        face = np.repeat(np.arange(len(corners)), [len(one) for one in near])
        ray = np.concatenate([np.asarray(one, dtype=np.int64) for one in near])
        far = _crossings(corners[face], directions[ray])
        rays.append(ray[far > 0])
        places.append(far[far > 0])
    ray, place = np.concatenate(rays), np.concatenate(places)
    np.maximum.at(radii, ray, place)
    if (radii <= 0).any():
        share = float((radii > 0).mean())
        raise InputError(
            f"like is {shape.name!r}, which only {share:.0%} of the rays from its centroid meet: its centroid must lie "
            "inside; take another shape"
        )
    nearer = np.unique(ray[place < radii[ray] * (1 - SAME)])
    return radii, len(nearer) / len(directions)


def _crossings(corners: Floats, rays: Floats) -> Floats:
    """Return where rays (n, 3) from the origin leave a solid through its triangles (n, 3, 3), 0 where they do not."""
    a, b, c = np.moveaxis(corners, 1, 0)
    parts = np.stack([(rays * np.cross(p, q)).sum(axis=1) for p, q in ((b, c), (c, a), (a, b))])
    total, volume = parts.sum(axis=0), (a * np.cross(b, c)).sum(axis=1)
    # a ray through an edge, up to rounding, leaves through both of its faces
    outward = (parts >= -ROUNDING * np.abs(parts).max(axis=0)).all(axis=0) & (total > 0) & (volume > 0)
    return np.divide(volume, total, out=np.zeros(len(rays)), where=outward)
