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
        What the surface bounds. A union of several spheres has creases, and the curvature of its smallest sphere would
        say little of the others: it counts as having edges.

    Returns
    -------
    float or None
        One over a length, in the unit of lengths.
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
