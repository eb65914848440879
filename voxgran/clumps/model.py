"""Clump: the spheres that approximate a grain, with measured errors."""

import os
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Literal

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Floats, as_choice
from voxgran._base.calls import explained_methods
from voxgran._base.lazy import Dataset
from voxgran.clumps.bonds import LEAST_AREA, TOUCHING, Strengths, bonds_of_bodies
from voxgran.shapes.describing.thumbnail import card, portrait
from voxgran.shapes.formats.sphere_files import write_spheres
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import MassProperties, Spheres

#: whose mass properties a clump may have
OF = ("true", "spheres")


@dataclass(frozen=True, slots=True, kw_only=True)
class ClumpErrors(ExplainedAttributes):
    """Errors of a clump relative to its solid; lengths in equivalent diameters.

    Attributes
    ----------
    iou : float
        Volume of the intersection over volume of the union.
    iou_uncertainty : float
        Standard error of `iou`.
    volume : float
        Relative error of the volume of the union; negative where the clump is smaller.
    centroid : float
        Distance of the centroids.
    inertia : float
        Relative error of the inertia tensor, Frobenius norm, each about its own centroid.
    surface_mean, surface_max : float
        Mean and largest distance between the surfaces, taken from both sides.
    """

    iou: float
    iou_uncertainty: float
    volume: float
    centroid: float
    inertia: float
    surface_mean: float
    surface_max: float

    def to_mapping(self) -> dict[str, float]:
        """Return the errors by name."""
        return {field.name: float(getattr(self, field.name)) for field in fields(self)}


@explained_methods
@dataclass(frozen=True, eq=False)
class Clump(ExplainedAttributes):
    """Spheres that approximate a grain.

    Attributes
    ----------
    centers : (n, 3) ndarray of float
        Centers, in the body frame of the shape, in the unit of lengths.
    radii : (n,) ndarray of float
        Radii.
    shape : Shape
        Approximated shape; for voxels, the shape of their surface.
    errors : ClumpErrors
        Measured errors.
    method : str
        Name of the method that fitted the spheres.
    reason : str
        Why there are fewer spheres than asked; ``""`` if there are not.

    Examples
    --------
    >>> import voxgran as vg
    >>> clump = vg.fit_clump(vg.shapes.box(lengths=(1, 1, 2)), method="four_point", max_spheres=3)
    >>> clump.count, clump.centers.shape, clump.method
    (3, (3, 3), 'four_point')
    """

    centers: Floats
    radii: Floats
    shape: Shape
    errors: ClumpErrors
    method: str = ""
    reason: str = ""

    @property
    def count(self) -> int:
        """Number of spheres."""
        return len(self.radii)

    @cached_property
    def _spheres(self) -> Spheres:
        """The spheres as a geometry with the mass properties of their union."""
        return Spheres(self.centers, self.radii)

    @cached_property
    def _true_mass(self) -> MassProperties | None:
        """Mass properties of the shape; None where its spheres are exactly the shape and have them themselves."""
        shape, geometry = self.shape, self.shape.geometry
        if isinstance(geometry, Spheres):
            same = np.array_equal(geometry.centers, self.centers) and np.array_equal(geometry.radii, self.radii)
            if same:
                return geometry.mass
        if shape.is_sphere and self.count == 1 and not self.centers.any() and self.radii[0] == shape.bounding_radius:
            return None
        return MassProperties(shape.volume, np.zeros(3), shape.inertia)

    def mass_properties(self, of: Literal["true", "spheres"] = "true") -> MassProperties:
        """Return volume, centroid and inertia tensor at unit density, in the body frame of the shape.

        Parameters
        ----------
        of : {"true", "spheres"}
            Those of the shape that the spheres stand for, or those of the union of the spheres, whose common volume
            counts once.

        Returns
        -------
        MassProperties
            `volume`, which is the mass at unit density; `centroid` (3,); `inertia` (3, 3) about the centroid.

        Raises
        ------
        InputError
            If `of` is something else.

        Examples
        --------
        >>> import voxgran as vg
        >>> clump = vg.fit_clump(vg.shapes.box(lengths=(1, 1, 2)), method="four_point", max_spheres=3)
        >>> round(clump.mass_properties().volume, 12)  # of the box
        2.0
        """
        if as_choice(of, "of", OF) == "spheres" or self._true_mass is None:
            return self._spheres.union
        return self._true_mass

    def to_shape(self, *, mass_properties: Literal["true", "spheres"] = "true") -> Shape:
        """Return the spheres as a shape, with the origin at its centroid.

        Contacts, voxels and pictures of it are those of the spheres.

        Parameters
        ----------
        mass_properties : {"true", "spheres"}
            Whose volume, centroid and inertia it has: those of the shape that the spheres stand for, so that it takes
            its place at the same position and orientation, or those of the union of the spheres.

        Returns
        -------
        Shape
            With the geometry `Spheres`. Its equivalent diameter is that of the volume that it has.

        Raises
        ------
        InputError
            If `mass_properties` is something else.

        Examples
        --------
        >>> import voxgran as vg
        >>> clump = vg.fit_clump(vg.shapes.box(lengths=(1, 1, 2)), method="four_point", max_spheres=3)
        >>> vg.pack(clump.to_shape(), vg.Box((4, 4, 4)), "rsa", count=5).count
        5
        """
        name = f"{self.shape.name}, {self.count} spheres"
        if as_choice(mass_properties, "mass_properties", OF) == "spheres":
            return Shape.of(self._spheres, name=name, unit=self.shape.unit)
        # the origin is the centroid of the shape
        return Shape(Spheres(self.centers, self.radii, self._true_mass), name=name, unit=self.shape.unit)

    def bonds(
        self,
        *,
        strength: float,
        shear_strength: float | None = None,
        tolerance: float = TOUCHING,
        least_area: float = LEAST_AREA,
    ) -> "Dataset":
        """Return the bonds between the spheres, for a clump that may break.

        All pairs of spheres that overlap or touch are bonded. A bond stands for the circle in which they intersect; for
        the great circle of the smaller one where its center lies beyond that. Where bonds would not join all spheres,
        the pairs with the least gaps that do are added, with a warning.

        Parameters
        ----------
        strength : float
            Strength in tension, force per area, at least 0.
        shear_strength : float, optional
            Strength in shear, force per area, at least 0. Default: `strength`.
        tolerance : float
            Gap up to which spheres touch, as share of the radius of the smaller one.
        least_area : float
            Least area of a bond, as share of the great circle of the smaller sphere, from 0 to 1; spheres that only
            touch have it.

        Returns
        -------
        xarray.Dataset
            Along ``bond``: `first`, `second` (numbers of spheres), `grain` (0), `point` (center of the circle, in the
            body frame of the shape), `normal` (from the first to the second center), `area`, `gap` (negative for an
            overlap), `normal_strength` and `shear_strength` (forces: strength times area).

        Raises
        ------
        InputError
            If a strength or the tolerance is negative, or the least area is not from 0 to 1.

        Warns
        -----
        PackingWarning
            If spheres are bonded that do not touch.

        Examples
        --------
        >>> import voxgran as vg
        >>> clump = vg.fit_clump(vg.shapes.box(lengths=(1, 1, 2)), method="four_point", max_spheres=2)
        >>> clump.bonds(strength=1e6).sizes["bond"]
        1
        """
        return bonds_of_bodies(
            [(self.centers, self.radii)],
            np.zeros(1, dtype=np.int64),
            scale=np.ones(1),
            matrices=np.eye(3)[None],
            position=np.zeros((1, 3)),
            strengths=Strengths.of(strength, shear_strength, tolerance, least_area),
            unit=self.shape.unit or "1",
        )

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        overwrite: bool = False,
        mass_properties: Literal["true", "spheres"] = "true",
        density: float = 1.0,
    ) -> None:
        """Write the clump to a file that :func:`voxgran.load_shape` and programs for spheres read.

        The origin is the centroid. Numbers have as many digits as read back to the same bits, and volume, centroid and
        inertia tensor of unit density stand in comments.

        Parameters
        ----------
        path : path-like
            ``.csv``: a table ``x,y,z,r`` with a header; ``.txt`` or ``.xyzr``: lines ``x y z r clumpId`` as YADE reads
            them; ``.mol`` or ``.molecule``: a molecule file of LAMMPS with masses.
        overwrite : bool
            Whether a file that is there may be replaced.
        mass_properties : {"true", "spheres"}
            Whose mass properties the clump has, as of :meth:`to_shape`.
        density : float
            Density of the material, for the masses of a molecule file.

        Raises
        ------
        FileFormatError
            If the suffix is unknown.
        InputError
            If `path` is no path, `mass_properties` is something else, or the density is not above 0, or not 1 for a
            format without masses.
        OutputExistsError
            If the file is there and `overwrite` is false.
        OutputError
            If it cannot be written; what was there before is untouched.

        Examples
        --------
        >>> import voxgran as vg
        >>> clump = vg.fit_clump(vg.shapes.box(lengths=(1, 1, 2)), method="four_point", max_spheres=3)
        >>> clump.save("clump.csv")
        >>> vg.load_shape("clump.csv").geometry.radii.shape
        (3,)
        """
        write_spheres(self.to_shape(mass_properties=mass_properties), path, overwrite=overwrite, density=density)

    def __repr__(self) -> str:
        """Spheres, shape and overlap."""
        return (
            f"Clump({self.count} spheres of {self.shape.name!r}, {self.method or 'given'}, iou={self.errors.iou:.4f})"
        )

    def _repr_html_(self) -> str:
        """Small picture and numbers, for notebooks."""
        solid = self.to_shape()
        errors = self.errors
        rows = {
            "clump": f"{self.count} spheres of {self.shape.name} ({self.method or 'given'})",
            "intersection over union": f"{errors.iou:.4f} +- {errors.iou_uncertainty:.1g}",
            "volume, true and of the spheres": f"{solid.volume:.6g}, {self._spheres.volume:.6g}",
            "error of the inertia tensor": f"{errors.inertia:.2%}",
            "largest distance of the surfaces": f"{errors.surface_max:.3g} equivalent diameters",
        }
        return card(portrait(solid.vertices[solid.faces], solid.bounding_radius), rows)
