"""Clump: the spheres that approximate a grain, with measured errors."""

from dataclasses import dataclass, fields

from voxgran._base.arrays import Floats
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres


@dataclass(frozen=True, slots=True, kw_only=True)
class ClumpErrors:
    """Errors of a clump relative to its solid; lengths in equivalent diameters.

    Attributes
    ----------
    iou : float
        Volume of the intersection over volume of the union, from voxels.
    iou_uncertainty : float
        Standard error of `iou` from the size of the voxels.
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


@dataclass(frozen=True, eq=False)
class Clump:
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
    """

    centers: Floats
    radii: Floats
    shape: Shape
    errors: ClumpErrors

    @property
    def count(self) -> int:
        """Number of spheres."""
        return len(self.radii)

    def to_shape(self) -> Shape:
        """Return the union of the spheres as a shape, centered at its own centroid."""
        return Shape.of(
            Spheres(self.centers.copy(), self.radii.copy()),
            name=f"{self.shape.name}, {self.count} spheres",
            unit=self.shape.unit,
        )
