"""A union of spheres as the true geometry of a grain: a clump or a sphere assembly."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import (
    Booleans,
    Floats,
    Integers,
    as_floats,
    as_points,
    as_positive,
    as_vector,
    check_lengths,
    check_type,
    read_only,
)
from voxgran._base.calls import explained_methods
from voxgran._base.errors import InputError
from voxgran._base.kernels import kernel
from voxgran.geometry.sphere_pairs import spheres_near
from voxgran.shapes.boolean import united
from voxgran.shapes.mesh import Moments
from voxgran.shapes.sphere_union import contained, union_moments
from voxgran.shapes.tessellate import sphere

#: largest number of triangles of all spheres before they are united
MOST_TRIANGLES = 80_000
#: largest distance of centers in radii of the largest sphere: beyond, few digits of the spheres are left
FARTHEST = 1e4
#: relative error up to which an inertia tensor is symmetric and that of a solid
ROUNDING = 1e-9


@explained_methods
@dataclass(frozen=True, eq=False)
class MassProperties:
    """Volume, centroid and inertia tensor of a solid of unit density.

    Attributes
    ----------
    volume : float
        Volume, which is the mass at unit density; above 0.
    centroid : (3,) ndarray of float
        Centroid, in the unit of lengths.
    inertia : (3, 3) ndarray of float
        Inertia tensor about the centroid at unit density; symmetric, with principal moments that a solid can have.

    Raises
    ------
    InputError
        If a value is not finite or has the wrong shape, the volume is not above 0, the tensor is not symmetric, or a
        principal moment is not above 0 or is larger than the sum of the other two.

    Examples
    --------
    >>> import numpy as np
    >>> from voxgran.clumps import MassProperties
    >>> float(MassProperties(1.0, np.zeros(3), np.eye(3) / 6).inertia.trace())  # of a cube of edge 1
    0.5
    """

    volume: float
    centroid: Floats
    inertia: Floats

    def __post_init__(self) -> None:
        volume = as_positive(self.volume, "volume")
        centroid = as_vector(self.centroid, "centroid").copy()
        inertia = as_floats(self.inertia, "inertia", shape=(3, 3)).copy()
        allowed = ROUNDING * float(np.abs(inertia).max())
        if float(np.abs(inertia / 2 - inertia.T / 2).max()) > allowed:
            raise InputError(f"inertia is {inertia.tolist()}: it must be symmetric; give I[i, j] equal to I[j, i]")
        low, middle, high = (float(value) for value in linear.eigh(inertia)[0])
        if low <= 0 or high > low + middle + allowed:
            raise InputError(
                f"inertia has the principal moments {low:g}, {middle:g}, {high:g}: those of a solid are above 0 and "
                "none is above the sum of the other two; give the tensor about the centroid"
            )
        object.__setattr__(self, "volume", volume)
        object.__setattr__(self, "centroid", read_only(centroid))
        # symmetric to the last bit
        object.__setattr__(self, "inertia", read_only(inertia / 2 + inertia.T / 2))

    def __eq__(self, other: object) -> bool:
        """Compare by bits."""
        return self.content() == other.content() if isinstance(other, MassProperties) else NotImplemented

    def __hash__(self) -> int:
        """Hash by content."""
        return hash(self.content())

    def __repr__(self) -> str:
        """Volume, centroid and principal moments of inertia."""
        moments = ", ".join(f"{value:.6g}" for value in linear.eigh(self.inertia)[0])
        x, y, z = (float(value) for value in self.centroid)
        return f"MassProperties(volume={self.volume:.6g}, centroid=({x:.3g}, {y:.3g}, {z:.3g}), moments=({moments}))"

    def content(self) -> bytes:
        """Return the bytes by which two of them are compared; -0 counts as 0."""
        return np.concatenate([[self.volume], self.centroid + 0.0, self.inertia.ravel() + 0.0]).tobytes()

    def moved(self, offset: Floats) -> "MassProperties":
        """Return those of the solid shifted by a (3,) offset."""
        return MassProperties(self.volume, self.centroid + offset, self.inertia)

    def rotated(self, matrix: Floats) -> "MassProperties":
        """Return those of the solid rotated about the origin by a (3, 3) rotation matrix."""
        return MassProperties(
            self.volume,
            linear.matmul(matrix, self.centroid),
            linear.matmul(linear.matmul(matrix, self.inertia), matrix.T),
        )

    def scaled(self, factor: float) -> "MassProperties":
        """Return those of the solid scaled about the origin."""
        return MassProperties(self.volume * factor**3, self.centroid * factor, self.inertia * factor**5)


@dataclass(frozen=True, eq=False)
class Spheres(Moments):
    """A union of spheres, whose common volume counts once.

    Where `mass` is given, volume, centroid and inertia are those of the solid that the spheres stand for; all else,
    such as points inside, surface area and contacts, is that of the spheres.

    Attributes
    ----------
    centers : (n, 3) ndarray of float
        Centers, in the unit of lengths.
    radii : (n,) ndarray of float
        Radii, above 0.
    mass : MassProperties or None
        Mass properties in place of those of the union, in the same frame.

    Raises
    ------
    InputError
        If there is no sphere, the numbers of centers and radii differ, a radius is not between 1e-60 and 1e60, centers
        are too far apart, or `mass` is something else than MassProperties.
    """

    centers: Floats
    radii: Floats
    mass: MassProperties | None = None

    dimension = 3

    def __post_init__(self) -> None:
        centers = as_points(self.centers, "centers").copy()
        radii = as_floats(self.radii, "radii", shape=(len(centers),)).copy()
        if not len(radii):
            raise InputError("spheres has no sphere: a union needs at least one; give a center and a radius")
        if radii.min() <= 0:
            worst = int(radii.argmin())
            raise InputError(f"radius of sphere {worst} is {radii[worst]}: it must be above 0; remove the sphere")
        check_lengths(radii, "radius of a sphere")
        if (apart := float(np.ptp(centers, axis=0).max())) > FARTHEST * radii.max():
            raise InputError(
                f"centers of spheres are {apart:g} apart and the largest radius is {radii.max():g}: a union is at most "
                f"{FARTHEST:g} radii long; remove the sphere that is far away"
            )
        object.__setattr__(self, "centers", read_only(centers))
        if self.mass is not None:
            check_type(self.mass, MassProperties, "mass", "MassProperties, or None for those of the union")
        object.__setattr__(self, "radii", read_only(radii))

    @property
    def surface_area(self) -> float:
        """Area of the outer surface and of the inner surfaces of enclosed cavities."""
        return self._union[3]

    @property
    def union(self) -> MassProperties:
        """Mass properties of the union of the spheres."""
        return MassProperties(*self._union[:3])

    @property
    def _moments(self) -> tuple[float, Floats, Floats]:
        """Volume, centroid and inertia that the geometry has."""
        return self._union[:3] if self.mass is None else (self.mass.volume, self.mass.centroid, self.mass.inertia)

    @cached_property
    def bounding_radius(self) -> float:
        """Largest distance of a point of the union from the origin of the frame."""
        return float((linear.norm(self.centers, axis=1) + self.radii).max())

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner."""
        reach = self.radii[:, None]
        return (self.centers - reach).min(axis=0), (self.centers + reach).max(axis=0)

    @cached_property
    def _union(self) -> tuple[float, Floats, Floats, float]:
        """Volume, centroid, inertia and area of the union; a central point preserves digits far from the origin."""
        low = (self.centers - self.radii[:, None]).min(axis=0)
        high = (self.centers + self.radii[:, None]).max(axis=0)
        middle = (low + high) / 2
        volume, first, second, area = union_moments(self.centers - middle, self.radii)
        offset = first / volume
        second = second - volume * np.outer(offset, offset)
        inertia = np.trace(second) * np.eye(3) - second
        return volume, read_only(middle + offset), read_only(inertia), area

    def contains(self, points: Floats) -> Booleans:
        """Return the mask of the (n, 3) points in the closed union."""
        queries = as_points(points)
        inside = np.zeros(len(queries), dtype=np.bool_)
        inside[spheres_near(queries, np.zeros(len(queries)), self.centers, self.radii)[0]] = True
        return inside

    def content(self) -> bytes:
        """Return the bytes from which the key of the shape is computed."""
        spheres = b"spheres" + self.centers.tobytes() + self.radii.tobytes()
        return spheres if self.mass is None else spheres + b"mass" + self.mass.content()

    def moved(self, offset: Floats) -> "Spheres":
        """Return the union shifted by a (3,) offset."""
        return Spheres(self.centers + offset, self.radii, self.mass and self.mass.moved(offset))

    def rotated(self, matrix: Floats) -> "Spheres":
        """Return the union rotated about the origin by a (3, 3) rotation matrix."""
        return Spheres(linear.matmul(self.centers, matrix.T), self.radii, self.mass and self.mass.rotated(matrix))

    def scaled(self, factor: float) -> "Spheres":
        """Return the union scaled about the origin."""
        return Spheres(self.centers * factor, self.radii * factor, self.mass and self.mass.scaled(factor))

    def tessellation(self) -> tuple[Floats, Integers, float]:
        """Return vertices, faces and their largest distance from the true surface.

        The spheres are inscribed icospheres, as fine as their number allows. At the intersection of two spheres the
        union of the polyhedra is deeper than each of them; the error is measured there.
        """
        bare = ~contained(self.centers, self.radii)
        centers, radii = self.centers[bare], self.radii[bare]
        level = int(np.clip(math.log(MOST_TRIANGLES / (20 * len(radii)), 4), 1, 4))
        unit, faces, error = sphere(level)
        solids = ((c + r * unit, faces) for c, r in zip(centers, radii, strict=True))
        vertices, triangles = united(solids)
        paths = np.zeros(len(vertices))
        _measure_way_out(vertices, centers, radii, paths)
        return vertices, triangles, max(error * float(radii.max()), float(paths.max()))


@kernel
def _measure_way_out(points, centers, radii, paths):  # type: ignore[no-untyped-def]
    """Move each point out of the spheres that contain it, the deepest first, and write its displacement."""
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        for _ in range(100):
            deepest, hit = 0.0, -1
            for b in range(len(radii)):
                dx, dy, dz = x - centers[b, 0], y - centers[b, 1], z - centers[b, 2]
                depth = radii[b] - math.sqrt(dx * dx + dy * dy + dz * dz)
                if depth > deepest and depth > 1e-9 * radii[b]:
                    deepest, hit = depth, b
            if hit < 0:
                break
            dx, dy, dz = x - centers[hit, 0], y - centers[hit, 1], z - centers[hit, 2]
            # half as far again, so that few steps lead out of a crease
            step = 1.5 * deepest / (radii[hit] - deepest)
            x, y, z = x + step * dx, y + step * dy, z + step * dz
        dx, dy, dz = x - points[p, 0], y - points[p, 1], z - points[p, 2]
        paths[p] = math.sqrt(dx * dx + dy * dy + dz * dz)
