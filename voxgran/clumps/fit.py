"""`fit_clump`: spheres for a shape or for voxels, with measured errors, also in place of other shapes."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arrays import as_choice, as_count, as_number, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, PackingWarning, shown, warn
from voxgran._base.registry import Parameters
from voxgran.clumps.errors import clump_errors
from voxgran.clumps.method import Body, ClumpMethod, Fitted, clump_methods, clump_registry
from voxgran.clumps.model import Clump, ClumpErrors
from voxgran.lattice.label import connected_components
from voxgran.lattice.surface import smooth_surface
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.bodies import split
from voxgran.shapes.spheres import Spheres
from voxgran.voxels.model import Voxels

__all__ = ["clump_methods", "fit_clump"]

#: keywords beside the parameters of the method, suggested for unknown ones
BESIDE = ("max_spheres", "target", "value", "seed")
#: what an error that is to be reached is called
TARGETS = ("iou", "volume", "inertia", "surface")
#: number of spheres without a target, and the largest number that is tried for one
DEFAULT_SPHERES, MOST_SPHERES = 50, 1000
#: largest clump that may be asked for
LARGEST = 100_000
#: errors of spheres that are exactly the shape
EXACT = ClumpErrors(
    iou=1.0, iou_uncertainty=0.0, volume=0.0, centroid=0.0, inertia=0.0, surface_mean=0.0, surface_max=0.0
)
#: width of the smoothing filter for surfaces of voxels, in voxels
SMOOTHING = 0.7


@explained(hint="fit_clump(shape, max_spheres=20)")
def fit_clump(
    shape_or_voxels: Shape | Voxels,
    *,
    method: str | Parameters = "optimal",
    max_spheres: int | None = None,
    target: str | None = None,
    value: float | None = None,
    seed: int = 0,
    **parameters: Any,
) -> Clump:
    """Fit a clump of overlapping spheres to a solid.

    Parameters
    ----------
    shape_or_voxels : Shape or Voxels
        Solid to approximate; three-dimensional.
    method : str or parameter object, optional
        Name of a clump method, or its parameters, such as ``vg.clumps.Inscribed(min_radius=0.1)``. Default:
        ``"optimal"``.
    max_spheres : int, optional
        Number of spheres; with a target the largest number that is tried. Default: 50, or 1000 with a target.
    target : {"iou", "volume", "inertia", "surface"}, optional
        Error that is to be reached with the fewest spheres: the intersection over union, the relative error of the
        volume or of the inertia tensor, or the largest distance between the surfaces in equivalent diameters. Default:
        none; the clump has `max_spheres` spheres. The volume is that before a method changes the radii to match that of
        the solid, which any number of spheres can.
    value : float, optional
        Value of the target: at least this for ``"iou"``, at most this for the others. Required with `target`.
    seed : int, optional
        Random seed, of at least 0. Default: 0.
    **parameters
        Parameters of the method; `voxgran methods` lists them.

    Returns
    -------
    Clump
        Spheres in the body frame of the shape, with errors. Where it has fewer spheres than asked, `reason` says why;
        where a volume that met a target was matched afterwards, what it was before.

    Raises
    ------
    InputError
        If a value breaks a rule, the shape is flat, an open surface or too thin for the voxels of the method, no sphere
        fits, or the target is not reached; the message then says what was.
    UnknownNameError
        If the method or a parameter is unknown.

    Warns
    -----
    PackingWarning
        If there are fewer spheres than asked, except where they are exactly the shape.

    Examples
    --------
    >>> import voxgran as vg
    >>> clump = vg.fit_clump(vg.shapes.ellipsoid(aspect=(1, 1, 2)), max_spheres=3)
    >>> clump.count, clump.errors.iou > 0.8
    (3, True)
    """
    _, entry, settings = clump_registry().chosen(method, parameters, where="clump method", beside=BESIDE)
    level = _level(target, value)
    default = DEFAULT_SPHERES if target is None else MOST_SPHERES
    most = default if max_spheres is None else as_count(max_spheres, "max_spheres", at_least=1, at_most=LARGEST)
    shape = _solid(shape_or_voxels)
    fit = _Fit(shape, entry, settings, as_count(seed, "seed", at_most=None))
    if target is None:
        clump = fit.tried(most).clump
        if clump.reason and _own_spheres(shape, most) is None:
            warn(f"{shape.name!r} has {clump.count} spheres: {clump.reason}", PackingWarning)
        return clump
    return _fewest(fit, target, level, most)


class _Tried(NamedTuple):
    """A clump, and the errors by which it is compared with a target: those before a matching that meets one."""

    clump: Clump
    errors: ClumpErrors


class _Fit:
    """Clumps of one solid by one method, with any number of spheres."""

    def __init__(self, shape: Shape, entry: ClumpMethod, settings: Any, seed: int) -> None:
        self.shape = shape
        self._body = Body(shape)
        self._entry, self._settings, self._seed = entry, settings, seed

    def tried(self, count: int) -> _Tried:
        """Return the clump of at most so many spheres.

        Raises
        ------
        InputError
            If no sphere fits.
        """
        size = self.shape.diameter
        own = _own_spheres(self.shape, count)
        if own is not None:
            return _Tried(Clump(own.centers, own.radii, self.shape, EXACT, self._entry.name, own.reason), EXACT)
        made = self._entry.fit(self._body, count, self._settings, self._seed)
        found = Fitted(made.centers * size, made.radii * size, made.reason)
        if len(found.radii) == 0:
            reason = found.reason or "every sphere is too small"
            raise InputError(f"no sphere fits in {self.shape.name!r}: {reason}; allow smaller ones, or finer voxels")
        errors = clump_errors(self._body, Spheres(found.centers / size, found.radii / size))
        clump = Clump(found.centers, found.radii, self.shape, errors, self._entry.name, found.reason)
        if made.unmatched is None:
            return _Tried(clump, errors)
        return _Tried(
            clump, replace(errors, volume=Spheres(made.centers, made.unmatched).volume / self._body.volume - 1)
        )


def _own_spheres(shape: Shape, count: int) -> Fitted | None:
    """Return the spheres of a shape that is a union of at most so many; None for all others."""
    geometry = shape.geometry
    if shape.is_sphere:
        reason = "" if count == 1 else "the shape is exactly one sphere"
        return Fitted(np.zeros((1, 3)), np.array([shape.bounding_radius]), reason)
    if isinstance(geometry, Spheres) and len(geometry.radii) <= count:
        reason = "" if count == len(geometry.radii) else "the shape is exactly these spheres"
        return Fitted(geometry.centers.copy(), geometry.radii.copy(), reason)
    return None


def _level(target: str | None, value: float | None) -> float:
    """Return the value of the target, checked; 0 without one."""
    if (target is None) != (value is None):
        given, missing = ("target", "value") if value is None else ("value", "target")
        raise InputError(f"{given} is given without {missing}: give both, such as target='iou', value=0.95")
    if target is None or value is None:
        return 0.0
    as_choice(target, "target", TARGETS)
    return as_number(value, "value", above=0.0, at_most=np.inf if target == "surface" else 1.0)


def _fewest(fit: _Fit, target: str, level: float, most: int) -> Clump:
    """Return the clump with the fewest spheres that reaches a target, by doubling and then halving their number.

    Raises
    ------
    InputError
        If none reaches it.
    """

    def reached(tried: _Tried) -> bool:
        return _distance(tried, target) <= (1.0 - level if target == "iou" else level)

    low, high = 0, 1
    best = found = fit.tried(1)
    while not reached(found):
        if high >= most or found.clump.reason:
            raise InputError(_unreached(best, target, level, most))
        low, high = high, min(2 * high, most)
        found = fit.tried(high)
        best = min(best, found, key=lambda tried: _distance(tried, target))
    while high - low > 1:
        middle = (low + high) // 2
        tried = fit.tried(middle)
        if reached(tried):
            high, found = middle, tried
        else:
            low = middle
    if target == "volume" and found.errors.volume != found.clump.errors.volume:
        met = (
            f"{target} within {_distance(found, target):.4g} before it was matched, with an intersection over union of "
            f"{found.clump.errors.iou:.3g}"
        )
        return replace(found.clump, reason="; ".join(filter(None, (found.clump.reason, met))))
    return found.clump


def _distance(tried: _Tried, target: str) -> float:
    """Return how far a clump is from its solid in the sense of a target."""
    found = getattr(tried.errors, "surface_max" if target == "surface" else target)
    return 1.0 - float(found) if target == "iou" else abs(float(found))


def _unreached(best: _Tried, target: str, level: float, most: int) -> str:
    """Say what was reached in place of the target."""
    distance = _distance(best, target)
    found = 1.0 - distance if target == "iou" else distance
    side = "at least" if target == "iou" else "at most"
    why = f": {best.clump.reason}" if best.clump.reason else ""
    return (
        f"{target} of {side} {level:g} is not reached with up to {most} spheres; the best is {found:.4g}, with "
        f"{best.clump.count}{why}; ask for less, or raise max_spheres"
    )


def _solid(given: Shape | Voxels) -> Shape:
    """Return the solid as a shape: that of voxels is their smooth surface."""
    if isinstance(given, Voxels):
        if not given.mask.any() or given.mask.shape[2] == 1:
            raise InputError(
                f"voxels have shape {given.mask.shape} and {given.mask.sum()} taken: a clump needs a solid"
            )
        return _surface_of(given)
    check_type(given, Shape, "shape_or_voxels", "a Shape or Voxels; make_shape and load_shape make a shape")
    if given.dimension == 2:
        raise InputError(f"shape {given.name!r} is flat: a clump of spheres needs a solid; use disks in two dimensions")
    given.refuse_open("clumps of spheres")
    return given


def _surface_of(voxels: Voxels) -> Shape:
    """Return the solid of the voxels: a smooth surface of equal volume."""
    count = connected_components(voxels.mask, connectivity=26)[1]
    if count > 1:
        raise InputError(f"voxels hold {count} separate bodies: a clump stands for one; fit them one by one")
    vertices, faces = smooth_surface(voxels.mask, smoothing=SMOOTHING)
    # small bodies separated by the smoothing are dropped
    points, triangles = split(vertices, faces)[0]
    return Shape.from_mesh(points * voxels.voxel_size + np.asarray(voxels.origin), triangles, name="voxels")


#: relative difference of volume and inertia up to which a clump is that of a shape
ALIKE = 1e-6


def as_clumps(
    shapes: Sequence[Shape], clumps: Clump | Sequence[Clump | None] | None, fitting: dict[str, Any]
) -> tuple[tuple[Shape, ...], list[dict[str, Any] | None]]:
    """Return the shapes as clumps, those given or else fitted, and what provenance says of each; spheres, disks and
    clumps stay, with None.

    `fitting` are keywords of :func:`fit_clump`.

    Raises
    ------
    InputError
        If there are not as many clumps as shapes, one is no clump or that of another shape, a shape cannot be fitted,
        or parameters are given beside clumps.
    """
    changed = [not (isinstance(shape.geometry, Spheres) or shape.is_sphere) for shape in shapes]
    if clumps is None:
        given = [fit_clump(shape, **fitting) if other else None for shape, other in zip(shapes, changed, strict=True)]
    elif fitting:
        raise InputError(f"{', '.join(fitting)} is given beside clumps, which are fitted already: leave it out")
    else:
        given = _one_each(clumps, changed)
        for number, (clump, shape) in enumerate(zip(given, shapes, strict=True)):
            if clump is not None:
                _refuse_other(_in_unit(clump.shape, shape.unit), shape, number)
    made = (
        shape if one is None else replace(_in_unit(one.to_shape(), shape.unit), unit=shape.unit)
        for shape, one in zip(shapes, given, strict=True)
    )
    return tuple(made), [None if one is None else record_of(one) for one in given]


def _one_each(clumps: Any, changed: list[bool]) -> list[Clump | None]:
    """Return one clump or None for each shape."""
    wanted = "a Clump, or a list of one for each shape with None for shapes that stay; fit_clump makes one"
    count, few = sum(changed), isinstance(clumps, Clump)
    if few and count > 1:
        raise InputError(f"clumps is a single Clump for {count} shapes: give a list of one for each shape")
    if few:
        return [clumps if other else None for other in changed]
    if isinstance(clumps, int | np.integer):
        given = shown(clumps)
        raise InputError(f"clumps is {given}: it must be {wanted}; a number of spheres is max_spheres={given}")
    check_type(clumps, Sequence, "clumps", wanted)
    if len(clumps) != len(changed):
        raise InputError(f"clumps has {len(clumps)} entries for {len(changed)} shapes: it must be {wanted}")
    for clump in clumps:
        check_type(clump, (Clump, type(None)), "an entry of clumps", wanted)
    return [clump if other else None for clump, other in zip(clumps, changed, strict=True)]


def _in_unit(shape: Shape, unit: str | None) -> Shape:
    """Return a shape in a unit, where both are known; else as it is."""
    return shape if None in (shape.unit, unit) else shape.to_unit(str(unit))


def _refuse_other(solid: Shape, shape: Shape, number: int) -> None:
    """Refuse a clump whose solid is another shape.

    Raises
    ------
    InputError
        If volumes or inertia tensors differ.
    """
    if solid == shape:
        return
    shape.refuse_open("clumps of spheres")
    size = float(np.abs(shape.inertia).max())
    apart = abs(solid.volume / shape.volume - 1), float(np.abs(solid.inertia - shape.inertia).max()) / size
    if max(apart) > ALIKE:
        raise InputError(
            f"clump {number} is that of {solid.name!r} with a volume of {solid.volume:.6g}, shape {number} "
            f"is {shape.name!r} with {shape.volume:.6g}: volume and inertia must agree; fit it to that shape"
        )


def record_of(clump: Clump) -> dict[str, Any]:
    """Return what provenance says of a clump."""
    made = {"shape": clump.shape.name, "spheres": clump.count, "method": clump.method}
    return {**made, "errors": clump.errors.to_mapping()} | ({"reason": clump.reason} if clump.reason else {})
