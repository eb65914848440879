"""Volume of spheres inside an upright cylinder, by slices across its axis.

A slice of the sphere and a slice of the cylinder are disks, whose common area is a closed form. Over the height it is
smooth but for half-integer powers at the ends of the sphere and where the two circles touch; between these heights the
substitution ``sin`` makes it analytic, and Gauss-Legendre quadrature converges exponentially.
"""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.geometry.halfspaces import cut_spheres

#: points of the quadrature between two special heights, and of the coarser one that gives the error
POINTS = 40
FEWER = 30


def cut_spheres_by_cylinder(
    centers: Floats, radii: Floats, *, radius: float, lower: float, upper: float
) -> tuple[Floats, Floats]:
    """Return the volume of each sphere inside the cylinder ``x**2 + y**2 <= radius**2``, ``lower <= z <= upper``.

    Centers are (n, 3) and radii (n,). Returned are the volumes (n,) and their differences (n,) from a coarser
    quadrature.
    """
    low, high = np.array([-np.inf, -np.inf, lower]), np.array([np.inf, np.inf, upper])
    volumes, errors = cut_spheres(centers, radii, lower=low, upper=high), np.zeros(len(radii))
    apart = np.hypot(centers[:, 0], centers[:, 1])
    volumes[apart - radii >= radius] = 0.0
    cut = np.flatnonzero((volumes > 0) & (apart + radii > radius))
    if len(cut):
        size = radii[cut]
        ends = np.clip(np.stack([lower - centers[cut, 2], upper - centers[cut, 2]]) / size, -1.0, 1.0)
        scaled = apart[cut] / size, radius / size, ends
        fine, coarse = _quadrature(*scaled, POINTS), _quadrature(*scaled, FEWER)
        volumes[cut], errors[cut] = fine * size**3, np.abs(fine - coarse) * size**3
    return volumes, errors


def _quadrature(apart: Floats, radius: Floats, ends: Floats, points: int) -> Floats:
    """Integrate the common area of the slices of unit spheres and of the cylinder over the height."""
    touch = [np.sqrt(np.maximum(0.0, 1.0 - r**2)) for r in (np.abs(apart - radius), apart + radius)]
    marks = np.stack([ends[0], -touch[0], -touch[1], touch[1], touch[0], ends[1]])
    marks = np.clip(marks, ends[0], ends[1])
    nodes, weights = np.polynomial.legendre.leggauss(points)
    places, slopes = np.sin(np.pi / 2 * nodes), np.pi / 2 * np.cos(np.pi / 2 * nodes) * weights
    half = np.diff(marks, axis=0) / 2
    middle = (marks[1:] + marks[:-1]) / 2
    heights = middle[..., None] + half[..., None] * places
    slice_radius = np.sqrt(np.maximum(0.0, 1.0 - heights**2))
    area = _common_area(slice_radius, radius[:, None], apart[:, None])
    return np.asarray((area * slopes * half[..., None]).sum(axis=(0, 2)))


def _common_area(one: Floats, other: Floats, apart: Floats) -> Floats:
    """Return the common area of two disks."""
    inside, outside = apart <= np.abs(one - other), apart >= one + other
    # any length above 0 where the disks do not cross, for which the result is not used
    distance = np.where(inside | outside, 1.0, apart)
    near = (distance + (one - other) * (one + other) / distance) / 2
    far = distance - near
    chord = np.sqrt(np.maximum(0.0, (one - near) * (one + near)))
    lens = one**2 * np.arctan2(chord, near) + other**2 * np.arctan2(chord, far) - distance * chord
    return np.where(inside, np.pi * np.minimum(one, other) ** 2, np.where(outside, 0.0, lens))
