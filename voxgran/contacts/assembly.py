"""Grains in a container as plain arrays: few shapes, many poses, and one density or one for each shape."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import (
    Booleans,
    Floats,
    Integers,
    as_array,
    as_count,
    as_floats,
    as_indices,
    as_points,
    as_positive,
    as_quaternions,
    check_lengths,
    float_array,
    read_only,
)
from voxgran._base.errors import InputError, shown
from voxgran.containers.model import Container, check_container
from voxgran.containers.size_limits import check_grain_sizes
from voxgran.geometry.rotation import rotation_matrices
from voxgran.shapes.model import Shape

#: that of all shapes, or one for each shape
Density: TypeAlias = float | tuple[float, ...]
#: density of grains whose density is not stated
NOT_STATED = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class Lid:
    """A flat wall that lies on the grains.

    `normal` is the (3,) direction along an axis, away from the grains; `level` is the position along it, from the
    origin.
    """

    normal: Floats
    level: float


@dataclass(frozen=True, eq=False)
class Assembly:
    """Shapes and poses of the grains in a container.

    Attributes
    ----------
    shapes : tuple of Shape
        The different shapes.
    shape_id : (n,) ndarray of int
        Index of the shape of each grain.
    scale : (n,) ndarray of float
        Factor on the lengths of the shape.
    position : (n, 3) ndarray of float
        Centroids, in the unit of lengths; z = 0 in 2D.
    orientation : (n, 4) ndarray of float
        Unit quaternions (w, x, y, z) from the body frame to the container.
    container : Container
        Container of the grains.
    density : float or tuple of float
        Density of the material, mass per volume in the user's units: one number, or one for each shape.
    lid : Lid, optional
        Additional flat wall on the grains.
    fixed : (n,) ndarray of bool or None
        Which grains are fixed: obstacles that never move. None where all grains are free.

    Raises
    ------
    InputError
        If there are more or fewer densities than shapes, one is no finite number above 0, or `fixed` holds no True or
        False for each grain.
    """

    shapes: tuple[Shape, ...]
    shape_id: Integers
    scale: Floats
    position: Floats
    orientation: Floats
    container: Container
    density: Density = NOT_STATED
    lid: Lid | None = field(default=None, kw_only=True)
    fixed: Booleans | None = field(default=None, kw_only=True)

    @classmethod
    def of(
        cls,
        shapes: Sequence[Shape],
        container: Container,
        *,
        position: "ArrayLike",
        scale: "ArrayLike | None" = None,
        shape_id: "ArrayLike | None" = None,
        orientation: "ArrayLike | None" = None,
        density: float | Sequence[float] = NOT_STATED,
    ) -> "Assembly":
        """Make an assembly from array-likes; by default scales are 1, shape indices 0 and orientations the identity.

        Raises
        ------
        GrainTooLargeError
            If a grain contains a sphere wider than a period, or is beyond all proportion to the container.
        InputError
            If an array has the wrong length, a scale is not above 0, a shape index is no whole number or out of
            range, the dimension of a shape is not that of the container, a grain lies off the plane in 2D, or the
            density is neither one number above 0 nor one for each shape.
        """
        arrays = checked_arrays(shapes, container, position, scale, shape_id, orientation, copied=True)
        return cls(*arrays, container, as_density(density, len(arrays[0])))

    def __post_init__(self) -> None:
        for array in (self.shape_id, self.scale, self.position, self.orientation):
            read_only(array)
        object.__setattr__(self, "density", as_density(self.density, len(self.shapes)))
        object.__setattr__(self, "fixed", _as_fixed(self.fixed, self.count))

    @property
    def count(self) -> int:
        """Number of grains."""
        return len(self.position)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.container.dimension

    @cached_property
    def matrices(self) -> Floats:
        """Rotation matrices, (n, 3, 3)."""
        return read_only(rotation_matrices(self.orientation))

    @cached_property
    def volumes(self) -> Floats:
        """True volumes of the grains (areas in 2D), (n,)."""
        return read_only(
            self._of_shapes([shape.volume for shape in self.shapes]) * libm.power(self.scale, self.dimension)
        )

    @cached_property
    def densities(self) -> Floats:
        """Densities of the grains, (n,)."""
        return read_only(self._of_shapes(by_shape(self.density, len(self.shapes))))

    @cached_property
    def masses(self) -> Floats:
        """True masses of the grains, (n,): density times volume, in 2D times area.

        They are in kg where the density is in kg/m³ and lengths are in m, as those of ``to_unit("m")``; with lengths in
        mm they are in 1e-9 kg.
        """
        return read_only(self.densities * self.volumes)

    @property
    def mean_density(self) -> float:
        """Mass of all grains over their volume; exactly the density where there is one."""
        if isinstance(self.density, float):
            return self.density
        return float(self.masses.sum() / self.volumes.sum()) if self.count else NOT_STATED

    @cached_property
    def relative_densities(self) -> Floats:
        """Densities of the grains over the mean by volume of free ones, (n,); exactly 1 where all are equal."""
        if not self.count or self.densities.min() == self.densities.max():
            return read_only(np.ones(self.count))
        # ratios first: they, and so all that follows, have the same bits in other units of density
        ratio, some = self.densities / self.densities.max(), self.movable if self.movable.any() else slice(None)
        return read_only(ratio / ((ratio * self.volumes)[some].sum() / self.volumes[some].sum()))

    @cached_property
    def surface_areas(self) -> Floats:
        """True surface areas of the grains (perimeters in 2D, of open surfaces that of one side), (n,)."""
        return read_only(
            self._of_shapes([shape.surface_area for shape in self.shapes]) * libm.power(self.scale, self.dimension - 1)
        )

    @cached_property
    def diameters(self) -> Floats:
        """Equivalent diameters of the grains, (n,), in the unit of lengths."""
        return read_only(self._of_shapes([shape.diameter for shape in self.shapes]) * self.scale)

    @property
    def movable(self) -> Booleans:
        """Which grains are not fixed, (n,)."""
        return np.ones(self.count, dtype=np.bool_) if self.fixed is None else ~self.fixed

    @cached_property
    def median_diameter(self) -> float:
        """Median equivalent diameter of the grains that are not fixed, or of all where all are; 1 without grains."""
        sizes = self.diameters if self.fixed is None or self.fixed.all() else self.diameters[~self.fixed]
        return float(np.median(sizes)) if self.count else 1.0

    @cached_property
    def bounding_radii(self) -> Floats:
        """Radii of the bounding spheres about the centroids, (n,)."""
        return read_only(self._of_shapes([shape.bounding_radius for shape in self.shapes]) * self.scale)

    def refuse_fixed(self, what: str) -> None:
        """Refuse fixed grains, named after what they are for.

        Raises
        ------
        InputError
            If a grain is fixed.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 4, 4)), position=[(2, 2, 2)]).refuse_fixed("compression")
        """
        if self.fixed is not None:
            raise InputError(
                f"{int(self.fixed.sum())} grains are fixed: {what} takes none; free them with "
                "dataclasses.replace(packing, fixed=None), or leave them out with packing[packing.movable]"
            )

    def world_vertices(self, grain: int) -> Floats:
        """Return the vertices (v, 3) of the tessellation of one grain in its pose.

        Examples
        --------
        >>> import voxgran as vg
        >>> bed = vg.pack(vg.shapes.box(lengths=(1, 1, 1)), vg.Box((4, 4, 4)), "rsa", count=3)
        >>> bed.world_vertices(0).shape
        (8, 3)
        """
        as_count(grain, "grain", at_most=len(self.scale) - 1)
        body = self.shapes[self.shape_id[grain]].vertices * self.scale[grain]
        return linear.matmul(body, self.matrices[grain].T) + self.position[grain]

    def _of_shapes(self, values: Sequence[float]) -> Floats:
        """Return for each grain the value of its shape."""
        return np.array(values, dtype=np.float64)[self.shape_id] if values else np.zeros(0)


def checked_arrays(
    shapes: Sequence[Shape],
    container: Container,
    position: "ArrayLike",
    scale: "ArrayLike | None",
    shape_id: "ArrayLike | None",
    orientation: "ArrayLike | None",
    *,
    copied: bool = False,
) -> tuple[tuple[Shape, ...], Integers, Floats, Floats, Floats]:
    """Return shapes, shape_id, scale, position and orientation in the form that an assembly stores.

    Arrays that are given in this form are returned as they are, or are `copied`.

    Raises
    ------
    InputError
        As :meth:`Assembly.of`.
    """
    check_container(container)
    given = float_array(position)
    points = np.zeros((0, 3)) if given is not None and not given.size else as_points(position, "position")
    n = len(points)
    scales = np.ones(n) if scale is None else as_floats(scale, "scale", shape=(n,))
    if n and scales.min() <= 0:
        raise InputError(
            f"scale is {scales.min()} for grain {int(scales.argmin())}: it must be above 0; remove the grain"
        )
    check_lengths(scales, "scale")
    index = as_indices(np.zeros(n) if shape_id is None else shape_id, "shape_id", length=n, below=len(shapes))
    for shape in shapes:
        if shape.dimension != container.dimension:
            raise InputError(
                f"shape {shape.name!r} has dimension {shape.dimension}: the container has "
                f"{container.dimension}; use shapes and container of one dimension"
            )
    if container.dimension == 2 and points[:, 2].any():
        worst = int(np.abs(points[:, 2]).argmax())
        raise InputError(
            f"position of grain {worst} has z = {points[worst, 2]:g}: grains in 2D lie in the plane; use z = 0"
        )
    if orientation is None:
        turns = np.zeros((n, 4))
        turns[:, 0] = 1.0
    else:
        rows = float_array(orientation)
        flat = rows is not None and rows.size == 4 * n
        turns = as_quaternions(np.reshape(rows, (n, 4)) if rows is not None and flat else orientation)
        if len(turns) != n:
            raise InputError(f"orientation has {len(turns)} rows: there are {n} grains; give a quaternion for each")
    check_grain_sizes(shapes, container, index, scales)
    if copied:
        scales, points, turns = scales.copy(), points.copy(), turns if orientation is None else turns.copy()
    return tuple(shapes), index, scales, points, turns


def _as_fixed(value: Any, count: int) -> Booleans | None:
    """Return which of so many grains are fixed, read-only; None where none is.

    Raises
    ------
    InputError
        If it is no array of True and False for each grain.
    """
    if value is None:
        return None
    mask = as_array(value, "fixed")
    if mask.shape != (count,) or (count and mask.dtype != np.bool_):
        raise InputError(
            f"fixed has shape {mask.shape} and type {mask.dtype}: it must have one of True and False for each of the "
            f"{count} grains; give a mask"
        )
    return read_only(mask.copy()) if mask.any() else None


def as_density(value: Any, shapes: int, name: str = "density") -> Density:
    """Return a density, or one for each of so many shapes; a single number where they are all equal.

    Raises
    ------
    InputError
        If there are more or fewer values than shapes, or one is no finite number above 0.
    """
    if type(value) is float and 0.0 < value < math.inf:
        return value
    if isinstance(value, Mapping):
        raise InputError(f"{name} is {shown(value)}: it must be one number or a list of one for each shape, in order")
    if isinstance(value, str | bytes) or not isinstance(value, Iterable) or getattr(value, "ndim", 1) == 0:
        return as_positive(value, name)
    given = list(value)
    if len(given) != shapes:
        raise InputError(
            f"{name} is {shown(value)}: it must be one number, or {shapes}, one for each shape; give as many as shapes"
        )
    return merged([as_positive(one, f"{name} of shape {number}") for number, one in enumerate(given)])


def merged(densities: Sequence[float]) -> Density:
    """Return the densities of shapes, as one number where they are all equal."""
    return tuple(densities) if len(set(densities)) != 1 else densities[0]


def by_shape(density: Density, shapes: int) -> tuple[float, ...]:
    """Return the density of each of so many shapes."""
    return density if isinstance(density, tuple) else (density,) * shapes


def density_text(density: Density, form: str = "g") -> str:
    """Return a density in words: one number, or the different ones in the order of the shapes."""
    return ", ".join(format(one, form) for one in dict.fromkeys(by_shape(density, 1)))


def common_shapes(one: Assembly, other: Assembly) -> tuple[tuple[Shape, ...], Density, Integers, Integers]:
    """Return the different shapes of two packings with their densities, and which of them each grain of one and of the
    other has; a shape of two densities is there twice.
    """
    kinds = [list(zip(each.shapes, by_shape(each.density, len(each.shapes)), strict=True)) for each in (one, other)]
    place = {kind: k for k, kind in enumerate(dict.fromkeys((*kinds[0], *kinds[1])))}
    mine, its = (
        np.array([place[kind] for kind in own], int)[each.shape_id]
        for own, each in zip(kinds, (one, other), strict=True)
    )
    return tuple(shape for shape, _ in place), merged([density for _, density in place]), mine, its


def shapes_by_density(
    shapes: Sequence[Shape], shape_id: Integers, densities: "ArrayLike"
) -> tuple[tuple[Shape, ...], Integers, Density]:
    """Return shapes, the shape of each grain and the densities of the shapes, of grains with densities of their own.

    A shape of which grains have several densities is there once for each.

    Parameters
    ----------
    shapes : sequence of Shape
        The shapes.
    shape_id : (n,) ndarray of int
        Which shape each grain has.
    densities : (n,) array_like of float
        Density of each grain.
    """
    values: Floats = np.asarray(densities, dtype=np.float64)
    if len(np.unique(values)) <= 1:
        return tuple(shapes), shape_id, float(values[0]) if len(values) else NOT_STATED
    pairs, place = np.unique(np.column_stack([shape_id, values]), axis=0, return_inverse=True)
    chosen = tuple(shapes[int(number)] for number, _ in pairs)
    return chosen, place.reshape(-1).astype(np.int64), merged(pairs[:, 1].tolist())
