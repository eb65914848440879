"""`fit_clump`: spheres for a shape or for voxels, with measured errors."""

from typing import Any

import numpy as np

from voxgran._base.arrays import as_count, as_number, check_type
from voxgran._base.calls import Parameters, chosen
from voxgran._base.errors import InputError
from voxgran.clumps.errors import clump_errors
from voxgran.clumps.method import Wanted, clump_methods, clump_registry
from voxgran.clumps.model import Clump
from voxgran.lattice.label import connected_components
from voxgran.lattice.surface import smooth_surface
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.bodies import split
from voxgran.shapes.spheres import Spheres
from voxgran.voxels.model import Voxels
from voxgran.voxels.occupy import voxelize

__all__ = ["clump_methods", "fit_clump"]

#: keywords beside the parameters of the method, suggested for unknown ones
BESIDE = ("max_spheres", "target", "tolerance")
#: voxels per equivalent diameter at which a shape is voxelized
RESOLUTION = 64
#: largest number of spheres without any other stopping rule, and with one
DEFAULT_SPHERES, MOST_SPHERES = 100, 100_000
#: width of the smoothing filter for surfaces of voxels, in voxels
SMOOTHING = 0.7


def fit_clump(
    shape_or_voxels: Shape | Voxels,
    *,
    method: str | Parameters = "inscribed",
    max_spheres: int | None = None,
    target: float | None = None,
    tolerance: float | None = None,
    **parameters: Any,
) -> Clump:
    """Fit a clump of overlapping spheres to a solid.

    Parameters
    ----------
    shape_or_voxels : Shape or Voxels
        Solid to approximate; three-dimensional.
    method : str or parameter object, optional
        Name of a clump method, or its parameters, such as ``vg.clumps.Inscribed(min_radius=2)``. Default:
        ``"inscribed"``.
    max_spheres : int, optional
        Largest number of spheres. Default: 100, or 100 000 if `target` or `tolerance` is given.
    target : float, optional
        Intersection over union by voxel centers (``errors.iou``) at which the fit stops, in (0, 1]. Default: 1.
    tolerance : float, optional
        Largest distance, in equivalent diameters, of the solid from the clump at which the fit stops. Default: 0, no
        such limit.
    **parameters
        Parameters of the method; `voxgran methods` lists them.

    Returns
    -------
    Clump
        Spheres in the body frame of the shape, with errors.

    Raises
    ------
    InputError
        If a value breaks a rule, the shape is flat or an open surface, or no sphere fits.
    UnknownNameError
        If the method or a parameter is unknown.
    """
    _, entry, settings = chosen(clump_registry(), method, parameters, where="clump method", beside=BESIDE)
    shape, voxels = _both(shape_or_voxels)
    if max_spheres is None:
        most = DEFAULT_SPHERES if target is None and tolerance is None else MOST_SPHERES
    else:
        most = as_count(max_spheres, "max_spheres", at_least=1)
    wanted = Wanted(
        max_spheres=most,
        target=1.0 if target is None else as_number(target, "target", above=0.0, at_most=1.0),
        tolerance=0.0 if tolerance is None else as_number(tolerance, "tolerance", at_least=0.0) * shape.diameter,
    )
    centers, radii = entry.fit(voxels, wanted, settings)
    if len(radii) == 0:
        raise InputError(f"no sphere that is large enough fits in {shape.name!r}: allow smaller ones, or finer voxels")
    return Clump(centers, radii, shape, clump_errors(voxels, shape, Spheres(centers.copy(), radii.copy())))


def _both(given: Shape | Voxels) -> tuple[Shape, Voxels]:
    """Return the solid both as a shape and as voxels."""
    if isinstance(given, Voxels):
        if not given.mask.any() or given.mask.shape[2] == 1:
            raise InputError(
                f"voxels have shape {given.mask.shape} and {given.mask.sum()} taken: a clump needs a solid"
            )
        shape = _surface_of(given)
        moved = Voxels(given.mask, np.asarray(given.origin) - np.array(shape.offset), given.voxel_size, given.cover)
        return shape, moved
    check_type(given, Shape, "shape_or_voxels", "a Shape or Voxels; make_shape and load_shape make a shape")
    if given.dimension == 2:
        raise InputError(f"shape {given.name!r} is flat: a clump of spheres needs a solid; use disks in two dimensions")
    given.refuse_open("clumps of spheres")
    return given, voxelize(given, voxel_size=given.diameter / RESOLUTION)


def _surface_of(voxels: Voxels) -> Shape:
    """Return the solid of the voxels: a smooth surface of equal volume."""
    count = connected_components(voxels.mask, connectivity=26)[1]
    if count > 1:
        raise InputError(f"voxels hold {count} separate bodies: a clump stands for one; fit them one by one")
    vertices, faces = smooth_surface(voxels.mask, smoothing=SMOOTHING)
    # small bodies separated by the smoothing are dropped
    points, triangles = split(vertices, faces)[0]
    return Shape.from_mesh(points * voxels.voxel_size + np.asarray(voxels.origin), triangles, name="voxels")
