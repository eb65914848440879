"""Grains as a sequence: what Python users expect of something that holds many things, with tables,
meshes and a card for notebooks.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Literal, Self, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_choice, as_indices, as_number, check_type, read_only
from voxgran._base.calls import explained
from voxgran._base.errors import GrainIndexError, InputError, shown
from voxgran._base.lazy import Dataset, load
from voxgran._base.units import NO_UNIT, as_unit
from voxgran.clumps.bonds import LEAST_AREA, TOUCHING, Strengths, bonds_of_bodies
from voxgran.contacts.assembly import Assembly, Lid, checked_arrays
from voxgran.contacts.forces import check_forces
from voxgran.contacts.model import Contacts
from voxgran.contacts.surfaces import merged_surfaces
from voxgran.containers.gravity import as_down
from voxgran.packing.start import copies_of, free_volume
from voxgran.settling.relaxation import Relaxation
from voxgran.shapes.model import Shape
from voxgran.shapes.size_laws.distribution import SizeDistribution
from voxgran.shapes.spheres import Spheres

#: why a method stopped
STOP_REASONS = (
    *("settled", "count", "solid_fraction", "saturated", "full", "steps", "interrupted", "compressed", "yielded"),
)
#: what the colours of grains show in pictures
ColorBy: TypeAlias = Literal["diameter", "height", "shape", "density", "coordination", "distance", "force", "residual"]


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Grain(ExplainedAttributes):
    """One grain of a packing.

    Attributes
    ----------
    shape : Shape
        Its shape in the body frame, at the size of the shape.
    position : (3,) ndarray of float
        Centroid, in the unit of lengths.
    orientation : (4,) ndarray of float
        Unit quaternion (w, x, y, z) from the body frame to the container.
    scale : float
        Factor on the lengths of the shape.
    diameter : float
        Equivalent diameter, in the unit of lengths.
    """

    _instead: ClassVar[Mapping[str, str]] = {
        "radius": "grain.diameter / 2",
        "volume": "grain.shape.volume * grain.scale**3",
    }
    #: what is said where the shape of a grain is taken for it
    _without_place: ClassVar[str] = (
        ", which is not at its size and place; packing[[k]].to_pyvista() is the surface of grain k there"
    )

    shape: Shape
    position: Floats
    orientation: Floats
    scale: float
    diameter: float

    def __eq__(self, other: object) -> bool:
        return self._values() == other._values() if isinstance(other, Grain) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._values())

    def _values(self) -> tuple[Any, ...]:
        """Return what two equal grains share."""
        return self.shape, tuple(self.position.tolist()), tuple(self.orientation.tolist()), self.scale, self.diameter


@dataclass(frozen=True, eq=False)
class GrainSequence(ExplainedAttributes, Assembly):
    """An assembly whose grains are counted, visited and chosen as the items of a sequence are."""

    _instead: ClassVar[Mapping[str, str]] = {
        "append": "packing + other",
        "concat": "packing + other",
        "copy": "copy.copy(packing); what it holds never changes",
        "crop": "packing[packing.position[:, 2] < 1.0], the grains below a height",
        "filter": "packing[packing.diameter > 1.0], the grains that a mask chooses",
        "head": "packing[:5]",
        "radius": "packing.diameter / 2",
        "select": "packing[packing.diameter > 1.0], the grains that a mask chooses",
        "sort_values": "packing[packing.diameter.argsort()]",
        "voxelize": "vg.to_image(packing, voxel_size)",
    }

    def __post_init__(self) -> None:
        """Make arrays read-only and check the fields.

        Raises
        ------
        InputError
            If a field breaks a rule of :meth:`Packing.of`.
        """
        for name, value in _checked(self).items():
            object.__setattr__(self, name, value)
        super().__post_init__()

    @property
    def diameter(self) -> Floats:
        """Equivalent diameters of the grains, (n,), in the unit of lengths."""
        return self.diameters

    @cached_property
    def solid_fraction(self) -> float:
        """True volume of the grains over the volume of the container (in 2D areas), less the volume of fixed grains."""
        return float(self.volumes[self.movable].sum() / free_volume(self))

    @property
    def porosity(self) -> float:
        """One minus the solid fraction."""
        return 1.0 - self.solid_fraction

    def __len__(self) -> int:
        return self.count

    def __bool__(self) -> bool:
        # a packing without grains is a packing too
        return True

    def __iter__(self) -> Iterator[Grain]:
        return (self._grain(index) for index in range(self.count))

    def _grain(self, index: int) -> Grain:
        """Return one grain."""
        return Grain(
            shape=self.shapes[self.shape_id[index]],
            position=self.position[index],
            orientation=self.orientation[index],
            scale=float(self.scale[index]),
            diameter=float(self.diameters[index]),
        )

    @overload
    def __getitem__(self, chosen: int) -> Grain: ...
    @overload
    def __getitem__(self, chosen: "slice | ArrayLike") -> Self: ...
    def __getitem__(self, chosen: "int | slice | ArrayLike") -> Grain | Self:
        """Return one grain by its index, or those that a slice, a mask or indices choose.

        Raises
        ------
        GrainIndexError
            If there is no such grain, or what is given is no index, slice, mask or list of indices.
        """
        kept = self._kept(chosen[0] if isinstance(chosen, tuple) and len(chosen) == 1 else chosen)
        if kept.ndim == 0:
            return self._grain(int(kept))
        return self._chosen(kept)

    def _kept(self, chosen: Any) -> Integers:
        """Return the indices (m,) of the chosen grains, or () for an index.

        Raises
        ------
        GrainIndexError
            As :meth:`__getitem__`.
        """
        every = np.arange(self.count)
        try:
            if isinstance(chosen, slice):
                return every[chosen]
            # NumPy takes an empty list for numbers that are not whole
            wanted = np.zeros(0, int) if isinstance(chosen, list) and not chosen else np.asarray(chosen)
            if wanted.ndim > 1 or (wanted.ndim == 0 and wanted.dtype.kind == "b"):
                raise IndexError(f"it is an array of {wanted.ndim} dimensions of {wanted.dtype}")
            if wanted.dtype.kind == "b" and len(wanted) != self.count:
                raise IndexError(f"it is a mask of {len(wanted)}")
            if wanted.dtype.kind in "iu":
                self._refuse_outside(wanted)
            return np.asarray(every[wanted])
        except GrainIndexError:
            raise
        except (IndexError, TypeError, ValueError) as error:
            raise GrainIndexError(
                f"{shown(chosen)} chooses no grains of the {self.count} here ({error}): give an index, a slice, a mask "
                f"of {self.count} or a list of indices"
            ) from None

    def _refuse_outside(self, wanted: Integers) -> None:
        """Refuse indices, () or (m,), of grains that do not exist.

        Raises
        ------
        GrainIndexError
            If there is one.
        """
        outside = wanted[(wanted < -self.count) | (wanted >= self.count)]
        if outside.size:
            rule = f"it must be from {-self.count} to {self.count - 1}" if self.count else "the packing has no grains"
            raise GrainIndexError(f"index {outside.flat[0]} is out of range: {rule}; give the index of a grain")

    def _chosen(self, kept: Integers) -> Self:
        """Return some of the grains."""
        names = ("shape_id", "scale", "position", "orientation", "fixed", "grain_id")
        values = {name: getattr(self, name, None) for name in names}
        return replace(self, **{name: value[kept] for name, value in values.items() if value is not None})

    @explained(hint="packing.tiled((4, 4, 1))")
    def tiled(self, repeats: "int | Sequence[int]") -> Self:
        """Return a periodic packing repeated beside itself, with its forces, in a container that holds all copies.

        The copies follow one another in the order of the grains. Since all copies are alike, the result tells no more
        of the scatter of grains, contacts and forces than the packing does. Grains are not displaced at random: grains
        that touch would overlap or lose contacts. To make the copies differ, let
        :func:`voxgran.settle` shake the bed, or pack further grains upon it with ``start=``.

        Parameters
        ----------
        repeats : int or sequence of int
            Number of copies along each axis, 1 along axes that are not periodic; one number is that along all periodic
            axes. A tilted cell is repeated along its edges.

        Returns
        -------
        Packing
            All copies; ``provenance["tiled"]`` has the repeats and the number of grains of one copy. Copies of a
            packing that consists of copies itself are told as one, unless grains have moved since or some are left out.
            Rows of a list (``grain_id``) are there once in each copy.

        Raises
        ------
        InputError
            If `repeats` are no whole numbers of at least 1, there are more or fewer of them than axes, one is above 1
            along an axis that is not periodic, there are more than a million copies, or the container is of a class of
            your own.
        TooLargeError
            If the copies need more memory than there is.

        Examples
        --------
        >>> import voxgran as vg
        >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 8), periodic="xy"), "gravity", count=60)
        >>> large = bed.tiled((3, 3, 1))
        >>> large, large.container.lengths, large.verify().ok
        (Packing(540 grains, container_solid_fraction=0.2454, settled, 100.0 % at rest), (12.0, 12.0, 8.0), True)
        """
        return replace(self, **copies_of(self, repeats))

    def __reduce__(self) -> tuple[Any, ...]:
        # made anew by its constructor, so that its arrays are read-only again and what was cached stays behind
        return partial(type(self), **{entry.name: getattr(self, entry.name) for entry in fields(self)}), ()

    def bonds(
        self,
        *,
        strength: float,
        shear_strength: float | None = None,
        tolerance: float = TOUCHING,
        least_area: float = LEAST_AREA,
    ) -> "Dataset":
        """Return the bonds between the spheres of each grain, for grains that may break; spheres alone have none.

        Parameters and rules are those of :meth:`Clump.bonds`.

        Parameters
        ----------
        strength : float
            Strength in tension, force per area, at least 0.
        shear_strength : float, optional
            Strength in shear, force per area, at least 0. Default: `strength`.
        tolerance : float
            Gap up to which spheres touch, as share of the radius of the smaller one.
        least_area : float
            Least area of a bond, as share of the great circle of the smaller sphere, from 0 to 1.

        Returns
        -------
        xarray.Dataset
            As of :meth:`Clump.bonds`, with `grain` and with points in the container, those of a grain together where it
            reaches across a periodic side. Spheres are numbered in the order in which :func:`voxgran.save` writes them
            as text.

        Raises
        ------
        InputError
            If a grain is neither a sphere nor a clump, a strength or the tolerance is negative, or the least area is
            not from 0 to 1.

        Warns
        -----
        PackingWarning
            If spheres are bonded that do not touch.

        Examples
        --------
        >>> import voxgran as vg
        >>> clump = vg.fit_clump(vg.shapes.box(lengths=(1, 1, 2)), max_spheres=4).to_shape()
        >>> bed = vg.pack(clump, vg.Box((4, 4, 4)), "rsa", count=3)
        >>> bed.bonds(strength=1e6).sizes["bond"] > 0
        True
        """
        bodies = []
        for index, shape in enumerate(self.shapes):
            geometry = shape.geometry
            if not isinstance(geometry, Spheres) and not shape.is_sphere and (self.shape_id == index).any():
                raise InputError(
                    f"shape {index}, {shape.name!r}, is not made of spheres: bonds join those of a clump; ask for them "
                    "of packing.with_clumps()"
                )
            alone = np.zeros((1, 3)), np.ones(1)
            bodies.append((geometry.centers, geometry.radii) if isinstance(geometry, Spheres) else alone)
        return bonds_of_bodies(
            bodies,
            self.shape_id,
            scale=self.scale,
            matrices=self.matrices,
            position=self.position,
            strengths=Strengths.of(strength, shear_strength, tolerance, least_area),
            unit=getattr(self, "unit", "1"),
        )

    @cached_property
    def _contacts(self) -> dict[float, Contacts]:
        """Contacts found so far, by gap."""
        return {}

    @cached_property
    def _found(self) -> dict[str, Any]:
        """What several measures need and is slow to compute, by name, for them to keep."""
        return {}

    def to_pyvista(self) -> Any:
        """Return the surfaces of all grains as one `pyvista.PolyData`, with the cell data ``grain`` and ``diameter``.

        Raises
        ------
        TooLargeError
            If there are more than 40 million triangles.
        MissingLibraryError
            If PyVista cannot be loaded.

        Examples
        --------
        >>> import voxgran as vg
        >>> bed = vg.pack(vg.shapes.box(lengths=(1, 1, 1)), vg.Box((4, 4, 4)), "rsa", count=3)
        >>> bed.to_pyvista().n_cells
        36
        """
        merged = merged_surfaces(self)
        mesh = load("pyvista").PolyData.from_regular_faces(merged.vertices, merged.faces)
        mesh.cell_data["grain"] = merged.grain
        mesh.cell_data["diameter"] = self.diameters[merged.grain]
        return mesh

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame` with one row per grain: shape, x, y, z, qw, qx, qy, qz, scale, diameter, volume,
        density where that differs between shapes, fixed where some are, and grain_id where grains are those of a list.

        Raises
        ------
        MissingLibraryError
            If pandas cannot be loaded.

        Examples
        --------
        >>> import voxgran as vg
        >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5)
        >>> bed.to_dataframe().diameter.tolist()
        [1.0, 1.0, 1.0, 1.0, 1.0]
        """
        columns: dict[str, Any] = {"shape": [self.shapes[index].name for index in self.shape_id]}
        columns.update(zip("xyz", self.position.T, strict=True))
        columns.update(zip(("qw", "qx", "qy", "qz"), self.orientation.T, strict=True))
        columns.update(scale=self.scale, diameter=self.diameters, volume=self.volumes)
        if isinstance(self.density, tuple):
            columns["density"] = self.densities
        if self.fixed is not None:
            columns["fixed"] = self.fixed
        if (rows := getattr(self, "grain_id", None)) is not None:
            columns["grain_id"] = rows
        made = load("pandas").DataFrame(columns)
        made.index.name = "grain"
        return made


def _checked(packing: Any) -> dict[str, Any]:
    """Return shapes, unit, gravity and contact gap of a packing as they are kept, and check its other fields.

    What ``dataclasses.replace`` makes can so be saved and loaded again.

    Raises
    ------
    InputError
        If arrays do not belong to each other or to the shapes, or a field breaks a rule of :meth:`Packing.of`.
    UnknownNameError
        If the unit is unknown.
    """
    check_type(packing.shapes, (tuple, list), "shapes", "a list of shapes")
    for shape in packing.shapes:
        check_type(shape, Shape, "shapes", "a list of shapes")
    for name in ("shape_id", "scale", "position", "orientation"):
        check_type(getattr(packing, name), (np.ndarray, list, tuple), name, "an array")
    checked_arrays(
        packing.shapes, packing.container, packing.position, packing.scale, packing.shape_id, packing.orientation
    )
    check_type(packing.provenance, Mapping, "provenance", "a mapping of JSON-able values")
    check_type(packing.asked_sizes, (SizeDistribution, type(None)), "asked_sizes", "a size distribution or None")
    check_type(packing.relaxation, (Relaxation, type(None)), "relaxation", "that of vg.relax or None")
    check_type(packing.lid, (Lid, type(None)), "lid", "that of another packing or None")
    check_forces(packing.forces, len(packing.position))
    as_choice(packing.stop_reason, "stop_reason", STOP_REASONS)
    unit, down = as_unit(packing.unit), packing.gravity
    foreign = next((shape for shape in packing.shapes if unit != NO_UNIT and shape.unit not in (None, unit)), None)
    if foreign is not None:
        raise InputError(
            f"unit is {unit} and shape {foreign.name!r} has its lengths in {foreign.unit}: a packing has one unit; "
            "convert it with to_unit"
        )
    if not (down is None or (isinstance(down, tuple) and len(down) == 3 and abs(linear.norm(down) - 1.0) < 1e-9)):
        down = as_down(down, packing.container)
    gap, rows = as_number(packing.contact_gap, "contact_gap", at_least=0.0), packing.grain_id
    if rows is not None:
        rows = read_only(as_indices(rows, "grain_id", length=len(packing.position), at_least=-1))
    return {"shapes": tuple(packing.shapes), "unit": unit, "gravity": down, "contact_gap": gap, "grain_id": rows}
