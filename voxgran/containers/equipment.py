"""What containers share that are known by their parameters, and what those of several walls do."""

from abc import ABC, abstractmethod
from dataclasses import fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Floats, Integers, as_length, as_place, as_points, as_positive
from voxgran._base.calls import explained_methods
from voxgran.containers.model import Boundary
from voxgran.containers.space import Space
from voxgran.shapes.mesh import Mesh

#: widths of an outlet, in diameters of spheres, below which arches form over it (Zuriguel et al. 2005,
#: doi:10.1103/PhysRevE.71.051303: 4.94)
ARCHING = 5.0


@explained_methods
class Parametric(ExplainedAttributes):
    """A container known by its parameters: a frozen dataclass whose fields are the keys of its mapping.

    A kind gives its fields, of which those that are None are left out, and their lengths.
    """

    kind: ClassVar[str]
    _lengths: ClassVar[tuple[str, ...]]  # fields that are lengths or places
    dimension: ClassVar[int] = 3
    periodic: ClassVar[tuple[bool, bool, bool]] = (False, False, False)

    def _check_lengths(self, **given: Any) -> None:
        """Check the lengths in the fields, or the lengths that are given instead, and store them as numbers."""
        spare = {field.name for field in fields(self) if field.default is None}  # type: ignore[arg-type]
        for name in self._lengths:
            value = given[name] if given else getattr(self, name)
            if name == "origin":
                self._set(name, tuple(as_place(value, "origin", length=self.dimension).tolist()))
            elif value is not None or name not in spare:
                self._set(name, as_length(value, f"{name} of the {self.kind}"))

    def _set(self, name: str, value: Any) -> None:
        """Set a field."""
        object.__setattr__(self, name, value)

    def scaled(self, factor: float) -> Self:
        """Return the container with all lengths multiplied.

        Raises
        ------
        InputError
            If the factor is not above 0, or a length is not between 1e-60 and 1e60 any longer.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Funnel(radius=2, outlet=1, height=2).scaled(2.0).radius
        4.0
        """
        times = as_positive(factor, "factor")
        return replace(self, **{name: multiplied(getattr(self, name), times) for name in self._lengths})  # type: ignore[type-var]

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Funnel(radius=2, outlet=1, height=2).to_mapping()
        {'kind': 'funnel', 'radius': 2.0, 'outlet': 1.0, 'height': 2.0, 'origin': [0.0, 0.0, 0.0]}
        """
        found = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        return {"kind": self.kind} | {name: _plain(value) for name, value in found.items() if value is not None}


@explained_methods
class Equipment(Parametric, ABC):
    """A container of several walls, which gives the space within them."""

    @property
    @abstractmethod
    def space(self) -> Space:
        """The space within the walls."""

    def doubt(self, diameter: float) -> str:
        """Return what speaks against packing grains of a median diameter, as a sentence; ``""`` if nothing does.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Hopper(radius=5, outlet=1.5).doubt(1.0)[:64]
        'outlet of the hopper is 3 wide, 3 median diameters of the grains'
        """
        if not (outlet := getattr(self, "outlet", None)) or 2 * outlet >= ARCHING * diameter:
            return ""
        effect = "is smaller than a grain and will arch" if 2 * outlet < diameter else "will arch"
        return (
            f"outlet of the {self.kind} is {2 * outlet:.6g} wide, {2 * outlet / diameter:.3g} median diameters of the "
            f"grains: it {effect} once it is opened, as outlets narrower than about {ARCHING:g} diameters do; give a "
            f"radius of {ARCHING * diameter / 2:.3g} or more, or leave it closed"
        )

    @property
    def volume(self) -> float:
        """Volume."""
        return self.space.volume

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3)."""
        return self.space.bounds.copy()

    @property
    def boundary(self) -> Boundary:
        """The walls in closed form."""
        return self.space.boundary

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the nearest wall, negative inside.

        Outside, near edges, it is a lower bound of the distance where a wall is round.

        Raises
        ------
        InputError
            If the points are not an (n, 3) array of finite numbers.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Funnel(radius=2, outlet=1, height=2).signed_distance([(0, 0, 0.5), (0, 0, 3)]).tolist()
        [-0.5, 1.0]
        """
        p, solid = as_points(points), self.boundary.solid
        if solid is None:
            return self.boundary.signed_distance(p)
        assert isinstance(solid.geometry, Mesh)
        return solid.geometry.tree.signed_distance(p - np.array(solid.offset))

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the boundary.

        Examples
        --------
        >>> import voxgran as vg
        >>> vertices, faces = vg.Funnel(radius=2, outlet=1, height=2).mesh()
        >>> float(vertices[:, 0].max())
        2.0
        """
        return self.space.vertices.copy(), self.space.faces.copy()


def multiplied(value: Any, factor: float) -> Any:
    """Return a length, a place or several of them multiplied; None as it is."""
    with np.errstate(over="ignore"):
        return None if value is None else (np.array(value) * factor).tolist()


def _plain(value: Any) -> Any:
    """Return a value with lists in place of tuples."""
    return [_plain(one) for one in value] if isinstance(value, tuple) else value
