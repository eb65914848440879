"""Type and registry of clump methods.

All methods see the solid that a clump approximates as a `Body` of unit equivalent diameter, with its centroid at the
origin. They ask it for what they need, and nothing else is computed: points on the surface, depths, voxels, medial
spheres.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.registry import Registry
from voxgran._base.seeds import stream
from voxgran.geometry.triangles import areas_of, normals_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.voxels.model import Voxels
from voxgran.voxels.occupy import voxelize


class SurfacePoints(NamedTuple):
    """Points of equal share of a surface."""

    points: Floats  # (n, 3)
    normals: Floats  # (n, 3) unit normals, outward
    area: float  # area of which each point stands for


class Body:
    """A solid scaled to unit equivalent diameter, its centroid at the origin.

    Parameters
    ----------
    shape : Shape
        Solid of any size.
    """

    def __init__(self, shape: Shape) -> None:
        self.shape = shape.scaled(1.0 / shape.diameter)
        self.name = shape.name
        self._voxels: dict[float, Voxels] = {}

    @cached_property
    def volume(self) -> float:
        """True volume, pi / 6 up to rounding."""
        return self.shape.volume

    def surface(self, count: int, seed: int) -> SurfacePoints:
        """Return points spread evenly over the tessellation, in the order of its triangles."""
        corners = self.shape.vertices[self.shape.faces]
        areas, generator = areas_of(corners), stream(seed, "surface points")
        total = float(areas.sum())
        level = (np.arange(count) + generator.random(count)) * (total / count)
        face = np.minimum(np.searchsorted(np.cumsum(areas), level), len(areas) - 1)
        pair = np.mod(np.arange(count)[:, None] * np.array(EVEN) + generator.random(2), 1.0)
        root = np.sqrt(pair[:, :1])
        a, b, c = np.moveaxis(corners[face], 1, 0)
        points = (1 - root) * a + root * (1 - pair[:, 1:]) * b + root * pair[:, 1:] * c
        normals = normals_of(corners[face])
        normals /= linear.norm(normals, axis=1, keepdims=True)
        return SurfacePoints(np.ascontiguousarray(points), normals, total / count)

    def depth(self, points: Floats) -> Floats:
        """Return the distances of (n, 3) points from the surface, positive inside."""
        geometry = self.shape.geometry
        if isinstance(geometry, Mesh):
            return -geometry.tree.signed_distance(points)
        return -self.shape.signed_distance(points)

    def voxels(self, resolution: float) -> Voxels:
        """Return the voxels of the solid, with `resolution` of them along the equivalent diameter.

        Raises
        ------
        InputError
            If the solid is too thin for the voxels.
        """
        if resolution not in self._voxels:
            made = voxelize(self.shape, voxel_size=1.0 / resolution)
            missed = abs(made.volume / self.volume - 1.0)
            if missed > MISSED:
                # the error falls at least as fast as the size of the voxels
                fine = int(np.ceil(resolution * missed / MISSED))
                raise InputError(
                    f"shape {self.name!r} is too thin for {resolution:g} voxels along its equivalent diameter, which "
                    f"miss {missed:.0%} of its volume: give a resolution of about {fine}"
                )
            self._voxels[resolution] = made
        return self._voxels[resolution]

    def lattice_points(self, resolution: float, seed: int) -> tuple[Floats, Floats]:
        """Return points well inside and well outside of the solid, one somewhere in each voxel away from the surface.

        Those outside are at most `AROUND` voxels away from the solid. In a thin solid there are none inside.
        """
        voxels = voxelize(self.shape, voxel_size=1.0 / resolution)
        mask = np.pad(voxels.mask, AROUND)
        ndimage = load("scipy.ndimage")
        inner = np.argwhere(ndimage.binary_erosion(mask))
        near = ndimage.binary_dilation(mask)
        outer = np.argwhere(ndimage.binary_dilation(near, iterations=AROUND - 1) & ~near)
        generator, low = stream(seed, "jitter"), np.asarray(voxels.origin) - AROUND / resolution
        jitter = [generator.uniform(0.25, 0.75, places.shape) for places in (inner, outer)]
        return low + (inner + jitter[0]) / resolution, low + (outer + jitter[1]) / resolution

    def inner_points(self, resolution: float, seed: int) -> Floats:
        """Return points well inside of the solid, at least one.

        Raises
        ------
        InputError
            If the solid is too thin for the voxels.
        """
        found = self.lattice_points(resolution, seed)[0]
        if not len(found):
            raise InputError(
                f"shape {self.name!r} is too thin: no voxel of {1.0 / resolution:.3g} equivalent diameters lies "
                "inside; allow overlap and radii that differ, or thicken the shape"
            )
        return found

    def medial_spheres(self, surface: SurfacePoints, chosen: Integers) -> tuple[Floats, Floats]:
        """Return centers and radii of the largest inner spheres that touch the surface at the chosen points.

        A large sphere tangent at the point shrinks until it contains no other point of the surface (Ma, Bae & Choi
        2012, doi:10.1007/s00371-011-0594-7).
        """
        tree = load("scipy.spatial").cKDTree(surface.points)
        foot, inward = surface.points[chosen], -surface.normals[chosen]
        radius = np.full(len(foot), 0.5 * float(np.ptp(surface.points, axis=0).max()))
        moving = np.arange(len(foot))
        for _ in range(SHRINKS):
            centers = foot[moving] + inward[moving] * radius[moving, None]
            near, other = tree.query(centers)
            apart = foot[moving] - surface.points[other]
            square, along = (apart**2).sum(axis=1), -(apart * inward[moving]).sum(axis=1)
            inside = (near < radius[moving] * (1 - SLACK) - LEAST_SLACK) & (along > 0) & (square > 0)
            if not inside.any():
                break
            moving = moving[inside]
            radius[moving] = np.minimum(radius[moving], square[inside] / (2 * along[inside]))
        return foot + inward * radius[:, None], radius


class Fitted(NamedTuple):
    """Spheres that a method returns, in the frame and unit of the body."""

    centers: Floats  # (n, 3)
    radii: Floats  # (n,)
    #: why there are fewer than asked, as half a sentence such as "the spheres cover every voxel"; "" if there are not
    reason: str = ""
    #: radii before they were changed so that the union has the volume of the solid; None where they were not
    unmatched: Floats | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ClumpMethod:
    """One registered clump method.

    `fit` takes the body, the number of spheres asked, the parameters and the seed. It returns at most that number.
    """

    name: str = ""  # the name of the file or entry point
    summary: str  # one line
    source: str  # reference
    parameters: type  # parameter class
    fit: Callable[[Body, int, Any, int], Fitted]


def clump_registry() -> Registry[ClumpMethod]:
    """Return the registry of clump methods."""
    return Registry("clump method", "voxgran.clumps.methods", ClumpMethod, group="voxgran.clump_methods")


@explained(hint="clump_methods()")
def clump_methods() -> tuple[str, ...]:
    """Return the names of all clump methods.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.clump_methods()
    ('cluster', 'dynamic', 'four_point', 'inner_normal', 'inscribed', 'optimal')
    """
    return clump_registry().names()


#: share of the volume by which voxels may miss it before the body counts as too thin for them
MISSED = 0.1
#: layers of voxels around the solid in which points outside of it are taken
AROUND = 4
#: steps of the plastic sequence, by which pairs of numbers fill a square evenly
EVEN = (0.7548776662466927, 0.5698402909980532)
#: share of its radius, and lengths, by which a medial sphere may contain points of the surface
SLACK, LEAST_SLACK = 1e-3, 2e-3
#: largest number of steps in which a sphere shrinks to the medial one
SHRINKS = 40
