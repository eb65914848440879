"""Packing: the grains and poses that a packing method returns, with their provenance."""

import os
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import public
from voxgran._base.arrays import Integers, as_number, check_type
from voxgran._base.calls import explained_methods
from voxgran._base.lazy import DataTree
from voxgran._base.units import as_unit, unit_factor
from voxgran.clumps.fit import as_clumps
from voxgran.clumps.model import Clump
from voxgran.contacts.assembly import as_density, checked_arrays, common_shapes
from voxgran.contacts.find import find_contacts
from voxgran.contacts.forces import ContactForces
from voxgran.contacts.model import Contacts
from voxgran.contacts.verify import TOLERANCE, Verification, verify
from voxgran.containers.gravity import Down, as_down
from voxgran.containers.model import Container
from voxgran.containers.one_unit import converted, in_one_unit
from voxgran.packing.grains import ColorBy, GrainSequence
from voxgran.packing.start import around_fixed, frame_of, joined_fixed, joined_ids, refuse_unlike
from voxgran.settling.relaxation import Relaxation
from voxgran.shapes.model import Shape, check_shapes
from voxgran.shapes.size_laws.distribution import SizeDistribution

#: reasons that hold for all grains of a packing together
_OF_THE_WHOLE = ("saturated", "full")


@explained_methods
@dataclass(frozen=True, eq=False)
class Packing(GrainSequence):
    """Grains in a container, with how they came there.

    ``len(packing)`` is the number of grains, iteration yields each as a :class:`Grain`, ``packing[3]`` is one of them,
    ``packing[packing.diameter > 1]`` the packing of some, and ``packing + other`` that of both. Two packings are equal
    where their grains, container, unit, density and gravity are; how they were made is not compared.

    Attributes
    ----------
    density : float or tuple of float
        Density of the material, mass per volume in the user's units: one number, or one for each shape where they
        differ. ``densities`` and ``masses`` have it by grain.
    provenance : dict
        JSON-able record of what was asked, what was done and what was missed.
    stop_reason : str
        One of :data:`voxgran.packing.grains.STOP_REASONS`.
    unit : str
        Unit of all lengths, ``"1"`` where none is known.
    gravity : tuple of float or None
        Unit vector in which gravity acts; None where there is none.
    contact_gap : float
        Distance of their surfaces up to which the method leaves grains open that touch, in the unit of lengths; 0
        where that is not known.
    asked_sizes : SizeDistribution or None
        Distribution of sizes that was asked for; None where there was none.
    forces : ContactForces or None
        Forces at the contacts, with the residual of each grain; None where they are not known. They hold for the grains
        as they are: a packing of some of the grains, a sum of packings, and grains that grow have none. Where you give
        other poses or another gravity with ``dataclasses.replace``, give ``forces=None, stop_reason="count"`` too.
    relaxation : Relaxation or None
        What an engine changed that brought these grains to rest, as of :func:`voxgran.relax`; None for others.
    fixed : (n,) ndarray of bool or None
        Which grains are fixed: obstacles, which never move and belong to the container. Their volume is taken off that
        of the container, and measures leave them out. None where all grains are free.
    grain_id : (n,) ndarray of int or None
        Row of each grain in the list that was packed, from 0 on, -1 for a grain of no list; None without a list.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=20, sizes=vg.sizes.uniform(0.8, 1.2))
    >>> len(bed), bed.position.shape, bed[bed.diameter > 1.0].count
    (20, (20, 3), 10)
    >>> bed[0].shape
    Shape('sphere', primitive, diameter=1)
    """

    provenance: Mapping[str, Any] = field(default_factory=dict)
    stop_reason: str = "count"
    unit: str = "1"
    gravity: Down | None = None
    contact_gap: float = 0.0
    asked_sizes: SizeDistribution | None = None
    forces: ContactForces | None = None
    relaxation: Relaxation | None = None
    grain_id: Integers | None = None

    @classmethod
    def of(
        cls,
        shapes: Shape | Sequence[Shape],
        container: Container,
        *,
        position: "ArrayLike",
        scale: "ArrayLike | None" = None,
        shape_id: "ArrayLike | None" = None,
        orientation: "ArrayLike | None" = None,
        density: float | Sequence[float] = 1.0,
        provenance: Mapping[str, Any] | None = None,
        stop_reason: str = "count",
        unit: str | None = None,
        gravity: "ArrayLike | None" = "down",
        contact_gap: float = 0.0,
        asked_sizes: SizeDistribution | None = None,
        forces: ContactForces | None = None,
        grain_id: "ArrayLike | None" = None,
        fixed: "ArrayLike | None" = None,
    ) -> "Packing":
        """Make a packing from array-likes.

        Parameters
        ----------
        shapes : Shape or sequence of Shape
            The different shapes.
        container : Container
            What holds the grains.
        position : (n, 3) array_like of float
            Centroids, in the unit of lengths; z = 0 in 2D.
        scale : (n,) array_like of float, optional
            Factor on the lengths of the shape; 1 where left out.
        shape_id : (n,) array_like of int, optional
            Which shape each grain has; 0 where left out.
        orientation : (n, 4) array_like of float, optional
            Unit quaternions (w, x, y, z); no rotation where left out.
        density : float or (len(shapes),) sequence of float
            Density of the material: one number, or one for each shape.
        provenance : mapping, optional
            JSON-able record.
        stop_reason : str
            One of :data:`voxgran.packing.grains.STOP_REASONS`.
        unit : str, optional
            Unit of all lengths; left out or ``"1"``: the one of the shapes, where one is known. Shapes of other units
            are converted to it, those without a unit are taken to be in it.
        gravity : str or (3,) array_like of float, optional
            Where gravity acts, an axis such as ``"-z"`` or any vector; None or ``"none"``: nowhere. ``"down"`` is
            ``"-z"``, in two dimensions ``"-y"``, and nowhere if that axis is periodic.
        contact_gap : float
            Distance of their surfaces up to which grains are said to touch; 0 where that is not known.
        asked_sizes : SizeDistribution, optional
            Distribution of sizes that was asked for.
        forces : ContactForces, optional
            Forces at the contacts of these grains.
        grain_id : (n,) array_like of int, optional
            Row of each grain in a list.
        fixed : (n,) array_like of bool, optional
            Which grains are fixed; none where left out.

        Raises
        ------
        InputError
            If `shapes` are no shapes, an array has the wrong length, a scale or density is not above 0, a shape index
            is out of range, dimensions differ, a grain lies off the plane in 2D, contains a sphere wider than a period
            or is far larger than the container, the stop reason is unknown, gravity is no direction or has a part along
            a periodic axis or off the plane, the contact gap is negative, units differ, forces are of other grains, or
            `fixed` is no mask of the grains.
        UnknownNameError
            If the unit is unknown; the message gives the nearest one.

        Examples
        --------
        >>> import voxgran as vg
        >>> pair = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 2, 2)), position=[(1, 1, 1), (3, 1, 1)])
        >>> round(pair.solid_fraction, 4)
        0.0654
        """
        shapes, container, unit = in_one_unit(check_shapes(shapes), container, unit)
        return cls(
            *checked_arrays(shapes, container, position, scale, shape_id, orientation, copied=True),
            container,
            as_density(density, len(shapes)),
            dict(provenance or {}),
            stop_reason,
            unit,
            as_down(gravity, container),
            contact_gap,
            asked_sizes,
            forces,
            grain_id=grain_id,  # type: ignore[arg-type]  # made an array as the fields are checked
            fixed=fixed,  # type: ignore[arg-type]
        )

    def to_unit(self, unit: str) -> "Packing":
        """Return the same packing with all lengths in another unit; the density stays the number that it is.

        Parameters
        ----------
        unit : str
            Unit of length, such as ``"mm"``.

        Raises
        ------
        UnknownNameError
            If the unit is unknown; the message gives the nearest one.
        InputError
            If it is no text, or only one of the two units is known.

        Examples
        --------
        >>> import voxgran as vg
        >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5, unit="mm")
        >>> bed.to_unit("m").container.lengths
        (0.004, 0.004, 0.004)
        """
        target = as_unit(unit)
        if target == self.unit:
            return self
        factor = unit_factor(self.unit, target)
        shapes, container = converted(self.shapes, self.container, self.unit, target)
        return replace(
            self,
            shapes=shapes,
            position=self.position * factor,
            container=container,
            provenance={**deepcopy(self.provenance), "converted": {"from": self.unit, "to": target}},
            unit=target,
            contact_gap=self.contact_gap * factor,
            asked_sizes=None if self.asked_sizes is None else self.asked_sizes.scaled(factor),
            lid=None if self.lid is None else replace(self.lid, level=self.lid.level * factor),
            forces=None if self.forces is None else self.forces.scaled(factor),
        )

    def _chosen(self, kept: Integers) -> "Packing":
        """Return the packing of some of the grains; forces are those of all grains in their order, or not known."""
        record = {**deepcopy(self.provenance), "chosen": {"count": len(kept), "of": self.count}}
        every = np.arange(self.count)
        reason = self.stop_reason if np.array_equal(np.sort(kept), every) else "count"
        forces = self.forces if np.array_equal(kept, every) else None
        some = GrainSequence._chosen(replace(self, forces=None), kept)
        return replace(some, provenance=record, stop_reason=reason, asked_sizes=None, forces=forces, relaxation=None)

    def with_clumps(self, clumps: Clump | Sequence[Clump | None] | None = None, **fitting: Any) -> "Packing":
        """Return the same grains at the same poses as clumps with the mass properties of their true shapes.

        Spheres, disks and clumps stay. Forces and the contact gap are those of the true shapes and are left out, and
        the stop reason becomes ``"count"`` where it was about them; ``provenance["clumps"]`` has the errors.

        Parameters
        ----------
        clumps : Clump or sequence of Clump or None, optional
            One for each shape; a single one where one shape is replaced. Default: fitted, once for each shape.
        **fitting
            Keywords of :func:`voxgran.fit_clump`, such as ``max_spheres=100``.

        Raises
        ------
        InputError
            If a clump is that of another shape, a shape cannot be fitted, or a keyword is given beside clumps.

        Examples
        --------
        >>> import voxgran as vg
        >>> bed = vg.pack(vg.shapes.box(lengths=(1, 1, 2)), vg.Box((4, 4, 4)), "rsa", count=3)
        >>> bed.with_clumps(max_spheres=4).shapes[0].geometry.radii.shape
        (4,)
        """
        shapes, errors = as_clumps(self.shapes, clumps, fitting)
        if not any(errors):
            return self
        reason = "count" if self.stop_reason in (*_OF_THE_WHOLE, "settled") else self.stop_reason
        record = {**deepcopy(self.provenance), "clumps": errors}
        bare = replace(self, contact_gap=0.0, forces=None, relaxation=None)
        return replace(bare, shapes=shapes, provenance=record, stop_reason=reason)

    def __add__(self, other: "Packing") -> "Packing":
        """Return the packing of the grains of both; nothing is moved, so that they may overlap.

        Raises
        ------
        InputError
            If they differ in container, unit, gravity or lid.
        """
        if not isinstance(other, Packing):
            return NotImplemented
        refuse_unlike(frame_of(self), frame_of(other))
        shapes, density, *ids = common_shapes(self, other)
        kept = self.stop_reason == other.stop_reason and self.stop_reason not in _OF_THE_WHOLE
        return replace(
            self,
            shapes=shapes,
            density=density,
            shape_id=np.concatenate(ids),
            scale=np.concatenate([self.scale, other.scale]),
            position=np.concatenate([self.position, other.position]),
            orientation=np.concatenate([self.orientation, other.orientation]),
            provenance={"method": "sum", "parts": [deepcopy(dict(one.provenance)) for one in (self, other)]},
            stop_reason=self.stop_reason if kept else "count",
            contact_gap=max(self.contact_gap, other.contact_gap),
            asked_sizes=None,
            forces=None,
            relaxation=None,
            grain_id=joined_ids((self.grain_id, self.count), (other.grain_id, other.count)),
            fixed=joined_fixed(self, other),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Packing):
            return NotImplemented
        arrays = ("scale", "position", "orientation", "movable")
        return (
            all(np.array_equal(getattr(self, name), getattr(other, name)) for name in arrays)
            and self.contact_gap == other.contact_gap
            and frame_of(self) == frame_of(other)
            and np.array_equal(*common_shapes(self, other)[2:])
        )

    def __hash__(self) -> int:
        return hash((self.unit, (self.position + 0.0).tobytes()))  # -0.0 equals 0.0

    def contacts(self, gap: float | None = None) -> Contacts:
        """Return all pairs of grains whose surfaces are nearer than a gap; found once and kept.

        Parameters
        ----------
        gap : float, optional
            Largest distance of the surfaces, in the unit of lengths, at least 0; default: `contact_gap`. It is exceeded
            by 1e-9 mean diameters, the tolerance of :meth:`verify`: grains that touch are so far apart by rounding.

        Returns
        -------
        Contacts

        Raises
        ------
        InputError
            If the gap is negative or not finite.

        Examples
        --------
        >>> import voxgran as vg
        >>> pair = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 2, 2)), position=[(1, 1, 1), (2.02, 1, 1)])
        >>> pair.contacts().count, pair.contacts(gap=0.05).count
        (0, 1)
        """
        reach = self.contact_gap if gap is None else as_number(gap, "gap", at_least=0.0)
        if reach not in self._contacts:
            near = reach + (TOLERANCE * float(self.diameters.mean()) if self.count else 0.0)
            # those of a larger gap hold them
            wider = [self._contacts[known] for known in sorted(self._contacts) if known > reach]
            self._contacts[reach] = wider[0].where(wider[0].gap <= near) if wider else find_contacts(self, near)
        return self._contacts[reach]

    def verify(self, *, tolerance: float = TOLERANCE) -> Verification:
        """Return whether grains overlap or leave the container, as :func:`voxgran.verify`.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5).verify().ok
        True
        """
        return verify(self, tolerance=tolerance)

    def measure(self, which: str | Sequence[str] | None = None) -> "DataTree":
        """Return measures with units, as :func:`voxgran.measure`.

        Parameters
        ----------
        which : str or sequence of str, optional
            Names of measures; all that the packing allows where left out.

        Examples
        --------
        >>> import voxgran as vg
        >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5)
        >>> sorted(bed.measure("coordination")["/grains"].data_vars)
        ['coordination_number', 'rattler']
        """
        found: DataTree = public("measure")(self, which=which)
        return found

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write the packing to a file, as :func:`voxgran.save`.

        Parameters
        ----------
        path : path-like
            File to write; its extension chooses the format.
        overwrite : bool
            Whether an existing file may be replaced.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5).save("bed.vtp")
        """
        public("save")(self, path, overwrite=overwrite)

    def plot(self, *, color_by: ColorBy = "diameter", legend: bool = True) -> Any:
        """Show the packing in a window, or return a picture of it, as :func:`voxgran.plot`.

        Parameters
        ----------
        color_by : {"diameter", "height", "shape", "density", "coordination", "distance", "force", "residual"}
            What the colours show; "force", the largest force on each grain, and "residual", what its forces fail to
            balance, where forces are known.
        legend : bool
            Whether a legend or a colour bar says what they mean.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5).plot()  # doctest: +SKIP
        """
        return public("plot")(self, color_by=color_by, legend=legend)

    def view(self, *, color_by: ColorBy = "diameter", most: float = 5.0, widget: bool = True) -> Any:
        """Show the packing in a notebook, in a view that turns, as :func:`voxgran.view`.

        Parameters
        ----------
        color_by, most, widget : str, float, bool
            What the colours show first, most megabytes, and whether it may be the widget of PyVista.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5).view().save("view.html")
        """
        return public("view")(self, color_by=color_by, most=most, widget=widget)

    def _repr_html_(self) -> str:
        """Card and interactive view, for notebooks."""
        return str(public("view")(self, widget=False)._repr_html_())

    def __repr__(self) -> str:
        """Count, solid fraction and how it ended."""
        forces = around_fixed(self).forces if self.movable.any() else None
        rest = "" if forces is None else f", {100 * forces.share_at_rest:.1f} % at rest"
        # of a bed the container has room above the surface
        of = "" if self.gravity is None else "container_"
        return f"Packing({self.count} grains, {of}solid_fraction={self.solid_fraction:.4f}, {self.stop_reason}{rest})"


def check_packing(packing: Any, name: str) -> None:
    """Check that the argument `name` is a packing.

    Raises
    ------
    InputError
        If it is something else.
    """
    check_type(packing, Packing, name, "a Packing; load or pack one")
