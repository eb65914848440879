"""Curvature of smooth surfaces."""

from voxgran.shapes.model import Geometry
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres


def largest_curvature(geometry: Geometry) -> float | None:
    """Return the largest outward curvature of a surface, or None if it has sharp edges.

    Parameters
    ----------
    geometry : Geometry
        Geometry with this surface. A union of several spheres has creases, and the curvature of its smallest sphere is
        not representative of the others; it counts as having edges.

    Returns
    -------
    float or None
        Curvature, in the inverse unit of lengths.
    """
    if isinstance(geometry, Spheres) and len(geometry.radii) == 1:
        return 1.0 / float(geometry.radii[0])
    if isinstance(geometry, Outline) and geometry.kind == "disk":
        return 1.0 / geometry.radius
    if isinstance(geometry, Primitive) and geometry.kind == "sphere":
        return 1.0 / geometry.dimensions[0]
    if isinstance(geometry, Primitive) and geometry.kind == "ellipsoid":
        return max(geometry.dimensions) / min(geometry.dimensions) ** 2
    return None
