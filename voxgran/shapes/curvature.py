"""How strongly smooth surfaces curve."""

from voxgran.shapes.model import Geometry
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres


def largest_curvature(geometry: Geometry) -> float | None:
    """Return the largest curvature with which a surface bulges outward, or None where it has sharp edges.

    Parameters
    ----------
    geometry : Geometry
        What the surface bounds. Between the balls of a union it is not smooth, but there it bulges inward.

    Returns
    -------
    float or None
        One over a length, in the unit of lengths.
    """
    if isinstance(geometry, Spheres):
        return 1.0 / float(geometry.radii.min())
    if isinstance(geometry, Outline) and geometry.kind == "disk":
        return 1.0 / geometry.radius
    if isinstance(geometry, Primitive) and geometry.kind == "sphere":
        return 1.0 / geometry.dimensions[0]
    if isinstance(geometry, Primitive) and geometry.kind == "ellipsoid":
        return max(geometry.dimensions) / min(geometry.dimensions) ** 2
    return None
