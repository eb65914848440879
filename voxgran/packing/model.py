"""Packing: grains where a method left them, the type that the packing room hands on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from numpy.typing import ArrayLike

from voxgran._base.arrays import as_choice, as_number, as_positive
from voxgran._base.units import as_unit, unit_factor
from voxgran.contacts.assembly import Assembly, checked_arrays
from voxgran.contacts.find import find_contacts
from voxgran.contacts.model import Contacts
from voxgran.containers.model import Container
from voxgran.packing.down import Down, as_down
from voxgran.packing.one_unit import converted, in_one_unit
from voxgran.shapes.model import Shape
from voxgran.shapes.size_laws import SizeDistribution

STOP_REASONS: tuple[str, ...] = (
    "settled",
    "count",
    "solid_fraction",
    "saturated",
    "full",
    "steps",
    "interrupted",
)


@dataclass(frozen=True, eq=False)
class Packing(Assembly):
    """Grains in a container, with how they came there.

    Attributes
    ----------
    density : float
        Density of the material, mass per volume in the user's units.
    provenance : dict
        JSON-able record of what was asked, what was done and what was missed.
    stop_reason : str
        One of :data:`STOP_REASONS`.
    unit : str
        Unit of all lengths, ``"1"`` where none is known.
    gravity : tuple of float or None
        Unit vector in which gravity acts; None where there is none.
    contact_gap : float
        Distance of their surfaces up to which the method leaves grains open that touch, in the unit of lengths; 0
        where that is not known.
    asked_sizes : SizeDistribution or None
        Distribution of sizes that was asked for; None where there was none.
    """

    density: float = 1.0
    provenance: Mapping[str, Any] = field(default_factory=dict)
    stop_reason: str = "count"
    unit: str = "1"
    gravity: Down | None = None
    contact_gap: float = 0.0
    asked_sizes: SizeDistribution | None = None

    @classmethod
    def of(
        cls,
        shapes: Sequence[Shape],
        container: Container,
        *,
        position: ArrayLike,
        scale: ArrayLike | None = None,
        shape_id: ArrayLike | None = None,
        orientation: ArrayLike | None = None,
        density: float = 1.0,
        provenance: Mapping[str, Any] | None = None,
        stop_reason: str = "count",
        unit: str | None = None,
        gravity: ArrayLike | None = "down",
        contact_gap: float = 0.0,
        asked_sizes: SizeDistribution | None = None,
    ) -> "Packing":
        """Make a packing from array-likes.

        Parameters
        ----------
        shapes : sequence of Shape
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
        density : float
            Density of the material.
        provenance : mapping, optional
            JSON-able record.
        stop_reason : str
            One of :data:`STOP_REASONS`.
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

        Returns
        -------
        Packing

        Raises
        ------
        InputError
            If an array has the wrong length, a scale or the density is not above 0, a shape index is out of range,
            the dimension of a shape is not that of the container, a grain lies off the plane in 2D, the stop reason
            is unknown, gravity is no direction or has a part along a periodic axis or out of the plane, the contact gap
            is negative, or shapes have several units and none is given.
        UnknownNameError
            If the unit is unknown; the message gives the nearest one.
        """
        shapes, container, unit = in_one_unit(shapes, container, unit)
        return cls(
            *checked_arrays(shapes, container, position, scale, shape_id, orientation),
            container,
            as_positive(density, "density"),
            dict(provenance or {}),
            as_choice(stop_reason, "stop_reason", STOP_REASONS),
            unit,
            as_down(gravity, container),
            as_number(contact_gap, "contact_gap", at_least=0.0),
            asked_sizes,
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
            provenance={**self.provenance, "converted": {"from": self.unit, "to": target}},
            unit=target,
            contact_gap=self.contact_gap * factor,
            asked_sizes=None if self.asked_sizes is None else self.asked_sizes.scaled(factor),
        )

    @cached_property
    def solid_fraction(self) -> float:
        """True volume of the grains over the volume of the container (in 2D areas)."""
        return float(self.volumes.sum() / self.container.volume)

    @property
    def porosity(self) -> float:
        """One minus the solid fraction."""
        return 1.0 - self.solid_fraction

    @cached_property
    def _contacts(self) -> dict[float, Contacts]:
        """Contacts found so far, by gap."""
        return {}

    def contacts(self, gap: float = 0.0) -> Contacts:
        """Return all pairs of grains whose surfaces are nearer than a gap; found once and kept.

        Parameters
        ----------
        gap : float
            Largest distance of the surfaces, in the unit of lengths, at least 0.

        Returns
        -------
        Contacts

        Raises
        ------
        InputError
            If the gap is negative or not finite.
        """
        reach = as_number(gap, "gap", at_least=0.0)
        if reach not in self._contacts:
            self._contacts[reach] = find_contacts(self, reach)
        return self._contacts[reach]

    def _repr_html_(self) -> str:
        """Small picture and numbers, for notebooks."""
        from voxgran.packing.notebook import packing_card

        return packing_card(self)

    def __repr__(self) -> str:
        """Count, solid fraction and how it ended."""
        return f"Packing({self.count} grains, solid_fraction={self.solid_fraction:.4f}, {self.stop_reason})"
