"""The grains of a packing as rigid bodies of an engine: spheres, clumps, polyhedra or meshes, in SI units."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, read_only
from voxgran.contacts.assembly import Assembly, by_shape
from voxgran.geometry.rotation import quaternions_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

#: rounds in which a polyhedron gets the volume of a round solid: it is nearer by a factor of 3 or more in each
ROUNDS = 30
#: what a grain is for an engine
Kind = Literal["sphere", "clump", "polyhedron", "mesh", "level_set", "convex_parts"]


class Frame(NamedTuple):
    """Principal frame of a body of unit density."""

    moments: Floats  # (3,), in ascending order
    axes: Floats  # (3, 3), from the principal frame to the body frame; right-handed


@dataclass(frozen=True, eq=False)
class Template:
    """One shape as bodies of an engine have it, at its own size and unit density, with the origin at its centroid.

    Attributes
    ----------
    name : str
        Name in files: letters, digits and underscores, different for each template.
    kind : {"sphere", "clump", "polyhedron", "mesh", "level_set", "convex_parts"}
        How the engine holds it.
    shape : Shape
        Its geometry: spheres of a clump, a sphere, or the solid itself.
    approximated : str
        What the engine's geometry leaves out of the true shape, as a sentence; ``""`` where it is exact.
    """

    name: str
    kind: Kind
    shape: Shape
    approximated: str = ""

    @cached_property
    def spheres(self) -> tuple[Floats, Floats]:
        """Centers (s, 3) and radii (s,) of a sphere or a clump; none of other bodies."""
        if self.kind == "sphere":
            return np.zeros((1, 3)), np.array([self.shape.bounding_radius])
        geometry = self.shape.geometry
        if self.kind == "clump" and isinstance(geometry, Spheres):
            return geometry.centers, geometry.radii
        return np.zeros((0, 3)), np.zeros(0)

    @cached_property
    def polyhedron(self) -> Mesh:
        """What an engine of convex polyhedra has in place of the shape."""
        return polyhedron_of(self.shape)[0]

    @cached_property
    def principal(self) -> Frame:
        """Principal moments and axes of inertia."""
        moments, axes = linear.eigh(self.shape.inertia)
        if linear.determinant(axes) < 0:
            axes[:, 2] *= -1
        return Frame(read_only(moments), read_only(axes))


@dataclass(frozen=True, eq=False)
class Bodies:
    """All grains in SI units.

    Attributes
    ----------
    templates : tuple of Template
        The different shapes.
    assembly : Assembly
        Poses of the grains, in metres: `shape_id` is the number of the template, `scale` the factor on its lengths,
        `position` (n, 3) that of the centroid, `matrices` (n, 3, 3) the rotation from its body frame, `density` in
        kg/m^3.
    """

    templates: tuple[Template, ...]
    assembly: Assembly

    @property
    def count(self) -> int:
        """Number of grains."""
        return self.assembly.count

    @property
    def densities(self) -> tuple[float, ...]:
        """Density of each template, kg/m^3."""
        return by_shape(self.assembly.density, len(self.templates))

    @property
    def mass(self) -> Floats:
        """True masses (n,), kg."""
        return self.assembly.masses

    @cached_property
    def _moment_factors(self) -> Floats:
        """Factors (n,) from the moments of inertia of a template to those of a grain, kg/m^3."""
        return self.assembly.densities * libm.power(self.assembly.scale, self.assembly.dimension + 2)

    @cached_property
    def inertia(self) -> Floats:
        """Inertia tensors about the centroids in the frame of the container, (n, 3, 3), kg m^2."""
        grains, of_template = self.assembly, np.array([one.shape.inertia for one in self.templates]).reshape(-1, 3, 3)
        body = of_template[grains.shape_id] * self._moment_factors[:, None, None]
        return read_only(linear.matmul(linear.matmul(grains.matrices, body), grains.matrices.transpose(0, 2, 1)))

    @cached_property
    def moments(self) -> Floats:
        """Principal moments of inertia (n, 3), kg m^2, in ascending order."""
        of_template = np.array([one.principal.moments for one in self.templates]).reshape(-1, 3)
        return read_only(of_template[self.assembly.shape_id] * self._moment_factors[:, None])

    @cached_property
    def principal_orientation(self) -> Floats:
        """Unit quaternions (n, 4), (w, x, y, z), from the principal frames to the container."""
        axes = np.array([one.principal.axes for one in self.templates]).reshape(-1, 3, 3)
        return read_only(quaternions_of(linear.matmul(self.assembly.matrices, axes[self.assembly.shape_id])))

    @cached_property
    def spheres(self) -> tuple[Floats, Floats, Integers]:
        """Centers (s, 3) and radii (s,) of all spheres in metres, and the grain (s,) of each; grain by grain."""
        grains = self.assembly
        counts = np.array([len(one.spheres[1]) for one in self.templates], dtype=np.int64)
        grain = np.repeat(np.arange(self.count), counts[grains.shape_id] if self.count else 0)
        centers, radii = np.zeros((len(grain), 3)), np.zeros(len(grain))
        for k, template in enumerate(self.templates):
            mine = np.flatnonzero(grains.shape_id == k)
            places = np.flatnonzero(grains.shape_id[grain] == k)
            turned = linear.einsum("gij,sj->gsi", grains.matrices[mine], template.spheres[0])
            world = turned * grains.scale[mine, None, None] + grains.position[mine, None]
            centers[places] = world.reshape(-1, 3)
            radii[places] = (grains.scale[mine, None] * template.spheres[1]).reshape(-1)
        return read_only(centers), read_only(radii), read_only(grain)

    def of_kind(self, *kinds: Kind) -> Integers:
        """Return the grains that are of some kinds."""
        mine = np.array([template.kind in kinds for template in self.templates], dtype=np.bool_)
        return np.flatnonzero(mine[self.assembly.shape_id]) if self.count else np.zeros(0, dtype=np.int64)

    def moving(self, kind: Kind) -> Integers:
        """Return the grains of a kind that are not fixed."""
        return np.intersect1d(self.of_kind(kind), np.flatnonzero(self.assembly.movable))

    @property
    def kinds(self) -> frozenset[Kind]:
        """Kinds of all templates."""
        return frozenset(template.kind for template in self.templates)

    @cached_property
    def least_radius(self) -> float:
        """Least radius of a sphere, or least equivalent radius of a grain without spheres, in metres."""
        return float(self._sizes[0].min())

    @cached_property
    def quickest(self) -> tuple[float, float]:
        """Radius in metres and density in kg/m^3 of the sphere, or of the equivalent sphere of a grain without spheres,
        that waves cross in the least time: of the least radius times root of the density.
        """
        radii, grain = self._sizes
        densities = self.assembly.densities[grain]
        least = int((radii * np.sqrt(densities)).argmin())
        return float(radii[least]), float(densities[least])

    @property
    def _sizes(self) -> tuple[Floats, Integers]:
        """Radii (s,) of spheres, and equivalent ones of grains without spheres, with the grain of each."""
        _, radii, grain = self.spheres
        others = self.of_kind("polyhedron", "mesh", "level_set", "convex_parts")
        return np.concatenate([radii, self.assembly.diameters[others] / 2]), np.concatenate([grain, others])


def is_round(shape: Shape) -> bool:
    """Return whether a shape is a solid of which a polyhedron has thousands of corners, where a clump is as near."""
    return isinstance(shape.geometry, Primitive) and shape.geometry.kind in ("sphere", "ellipsoid", "spherocylinder")


def polyhedron_of(shape: Shape) -> tuple[Mesh, float]:
    """Return a polyhedron in place of a convex solid, and the largest distance of the surfaces.

    Round solids become polyhedra of less than 200 corners with the same volume: the polyhedron that is inscribed in a
    solid that is slightly larger all around.
    """
    solid = shape.geometry
    if not is_round(shape) or not isinstance(solid, Primitive):
        return Mesh(shape.vertices, shape.faces), shape.tessellation_error
    (first, *others), capsule, factor = solid.dimensions, solid.kind == "spherocylinder", 1.0
    for _ in range(ROUNDS):
        # a spherocylinder becomes thicker, and longer by as much
        dimensions = (first * factor, *(length if capsule else length * factor for length in others))
        vertices, faces, error = Primitive(solid.kind, dimensions, solid.rotation).tessellation(coarse=True)
        mesh = Mesh(vertices, faces)
        factor *= (solid.volume / float(mesh.volume)) ** (1 / 3)
    beyond = (factor - 1.0) * (first if capsule else solid.bounding_radius)
    return mesh, max(error, beyond)


def names_of(shapes: Sequence[Shape]) -> list[str]:
    """Return a name in files for each shape, such as ``"rock_2"``; all are different, also in capitals."""
    found = []
    for number, shape in enumerate(shapes):
        kept = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in shape.name)
        stem = "_".join(word for word in kept.split("_") if word)[:30]
        found.append(f"{stem or 'shape'}_{number}".lower())
    return found
