"""A surface of triangles as the true geometry of a grain: a sheet, a shell or a skin, without interior."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from voxgran._base.arrays import Floats, Integers, read_only
from voxgran._base.errors import DirtyMeshError, InputError
from voxgran.geometry.crossing import count_crossings
from voxgran.geometry.triangles import areas_of
from voxgran.lattice.label import components
from voxgran.shapes.triangles import Triangles

#: area, in squares of the longest edge, up to which a triangle counts as degenerate
NO_AREA = 1e-12


@dataclass(frozen=True, eq=False, init=False)
class Surface(Triangles):
    """A surface of triangles with equivalent sides; the orientation of the faces is irrelevant.

    It is called open, since it has no interior, also where it is closed.
    """

    @property
    def volume(self) -> float:
        """Volume: 0."""
        return 0.0

    @cached_property
    def centroid(self) -> Floats:
        """Centroid of the area, (3,)."""
        middle = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        share = self.areas / self.areas.sum()
        return np.asarray(middle + share @ (self.triangles - middle).mean(axis=1))

    @property
    def inertia(self) -> Floats:
        """Raise an error, since the inertia at unit density is that of a solid.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(
            "an open surface has no volume and so no inertia at unit density: use geometry.area_inertia, that at unit "
            "mass per area, or give it thickness"
        )

    @cached_property
    def area_inertia(self) -> Floats:
        """Inertia tensor about the centroid at unit mass per area, (3, 3)."""
        corners = self.triangles - self.centroid
        total = corners.sum(axis=1)
        # the integral of x x^T over a triangle is a closed form of its corners
        second = np.einsum("f,fki,fkj->ij", self.areas, corners, corners)
        second = (second + np.einsum("f,fi,fj->ij", self.areas, total, total)) / 12
        return read_only(np.trace(second) * np.eye(3) - second)


def refuse_unfit(vertices: Floats, faces: Integers, name: str) -> None:
    """Raise unless triangles of merged vertices make one surface, which may be closed.

    Raises
    ------
    DirtyMeshError
        If there are no triangles, one is degenerate, they are not connected or intersect.
    """
    if not len(faces):
        raise DirtyMeshError(f"{name} has no faces: a surface must have triangles; check the file")
    triangles = vertices[faces]
    longest = ((triangles - np.roll(triangles, 1, axis=1)) ** 2).sum(axis=2).max(axis=1)
    flat = int((areas_of(triangles) <= NO_AREA * longest).sum())
    start, end = faces.ravel(), np.roll(faces, 1, axis=1).ravel()
    parts = len(np.unique(components(len(vertices), start, end)))
    rules = (
        (flat, f"{flat} faces without area", "each must be a triangle; leave them out"),
        (parts - 1, f"{parts} separate parts", "a grain must be one piece; save each in a file of its own"),
    )
    for wrong, what, rule in rules:
        if wrong:
            raise DirtyMeshError(f"{name} has {what}: {rule}")
    crossings = count_crossings(vertices, faces)
    if crossings:
        raise DirtyMeshError(f"{name} has {crossings} pairs of faces that cut through each other: mend the mesh")
