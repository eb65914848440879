"""Forces at the contacts of a packing, with how well they balance the weight and the torque of each grain."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers, as_floats, as_number, as_points, read_only
from voxgran._base.errors import InputError
from voxgran.contacts.assembly import Assembly
from voxgran.containers.model import Container, periods_of, tilt_of, within_periods
from voxgran.geometry.periods import nearest_turns

#: partners of grains that are no grains
WALL, LID = -1, -2
#: largest residual, in the weight of the grain, of a grain that is at rest
AT_REST = 0.01
#: contacts whose normal force is below this share of the mean carry nothing: solvers leave such forces
CARRIED = 1e-4
#: accuracy of the length of a unit vector
UNIT_LENGTH = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactForces:
    """Forces at contacts, and the residual of each grain; arrays are copied and read-only.

    Forces under gravity are in weights of a grain of the median diameter and, where densities differ, of their mean by
    volume; those of a packing that is compressed, which have a `stress`, are in its unit times the square of the median
    diameter (in 2D times the diameter). Any array_like is accepted for an array.

    Attributes
    ----------
    i : (m,) ndarray of int
        First grain of each contact.
    j : (m,) ndarray of int
        Its partner: a grain, -1 for a wall of the container, -2 for the lid.
    point : (m, 3) ndarray of float
        Where the two touch, near grain `i` (not wrapped at periodic sides), in the unit of lengths.
    normal : (m, 3) ndarray of float
        Unit vector from grain `i` to its partner.
    force : (m, 3) ndarray of float
        Force on the partner `j` by grain `i`; the force on `i` is its negative. Its part along `normal` is not
        negative, since grains do not attract each other.
    gap : (m,) ndarray of float
        Distance of the surfaces, in the unit of lengths; negative where they overlap.
    residual : (n,) ndarray of float
        Magnitude of the unbalanced force and torque of each grain of the packing, in its own weight; where there is a
        stress, in mean normal forces.
    rattler : (n,) ndarray of bool
        Whether the grain is a rattler, which bears no load and could move.
    friction : float, (m,) ndarray of float or None
        Coefficient of friction within whose cones the forces are, of all contacts or of each; None where it is not
        known.
    stress : (3, 3) ndarray of float or None
        Mean stress tensor of the forces, compression above 0; None under gravity.

    Raises
    ------
    InputError
        If an array has the wrong length, a value is not finite, an index is no whole number or names no grain, a
        normal is no unit vector, a residual or the friction is negative, or `rattler` holds other values than True
        and False.
    """

    i: Integers
    j: Integers
    point: Floats
    normal: Floats
    force: Floats
    gap: Floats
    residual: Floats
    rattler: Booleans
    friction: float | Floats | None = None
    stress: Floats | None = None

    def __post_init__(self) -> None:
        # errors are those of the class
        residual = as_floats(self.residual, "residual", shape=(None,))
        m, n = len(_flat(self.i)), len(residual)
        made: dict[str, NDArray[Any]] = {
            "i": _partners(self.i, "i", length=m, lowest=0, below=n),
            "j": _partners(self.j, "j", length=m, lowest=LID, below=n),
            "gap": as_floats(self.gap, "gap", shape=(m,)),
            "residual": residual,
            "rattler": _flags(self.rattler, n),
        }
        for name in ("point", "normal", "force"):
            # an empty list has no columns
            given = np.zeros((0, 3)) if not np.size(getattr(self, name)) else getattr(self, name)
            made[name] = as_floats(given, name, shape=(m, 3))
        as_points(made["point"], "point")
        if self.friction is not None and np.ndim(self.friction):
            made["friction"] = as_floats(self.friction, "friction", shape=(m,))
            as_number(made["friction"].min(initial=0.0), "friction", at_least=0.0)
        elif self.friction is not None:
            object.__setattr__(self, "friction", as_number(self.friction, "friction", at_least=0.0))
        if self.stress is not None:
            made["stress"] = as_floats(self.stress, "stress", shape=(3, 3))
        if residual.min(initial=0.0) < 0:
            worst = int(residual.argmin())
            raise InputError(
                f"residual is {residual[worst]:g} for grain {worst}: it must be at least 0; give a magnitude"
            )
        length = linear.norm(made["normal"], axis=1)
        if np.abs(length - 1.0).max(initial=0.0) > UNIT_LENGTH:
            worst = int(np.abs(length - 1.0).argmax())
            raise InputError(f"normal has length {length[worst]:g} at row {worst}: it must be 1; divide by the length")
        for name, array in made.items():
            object.__setattr__(self, name, read_only(np.array(array, order="C")))

    def __reduce__(self) -> tuple[Any, ...]:
        # made anew by its constructor, so that its arrays are read-only again and what was cached stays behind
        return partial(type(self), **{entry.name: getattr(self, entry.name) for entry in fields(self)}), ()

    @property
    def count(self) -> int:
        """Number of contacts."""
        return len(self.i)

    @cached_property
    def normal_force(self) -> Floats:
        """Parts of the forces along the normals, (m,)."""
        return read_only(linear.einsum("ck,ck->c", self.force, self.normal))

    @cached_property
    def tangential_force(self) -> Floats:
        """Magnitudes of the parts of the forces across the normals, (m,)."""
        return read_only(linear.norm(self.force - self.normal_force[:, None] * self.normal, axis=1))

    @property
    def unit(self) -> str:
        """Unit of the forces."""
        return "weights of a median grain" if self.stress is None else "units of stress and median diameter"

    @property
    def unit_of_residual(self) -> str:
        """Unit of the residuals."""
        return "weights of the grain" if self.stress is None else "mean normal forces"

    @cached_property
    def magnitude(self) -> Floats:
        """Magnitudes of the forces, (m,)."""
        return read_only(linear.norm(self.force, axis=1))

    @cached_property
    def carries(self) -> Booleans:
        """Whether each contact carries a force, (m,): a normal force above 1e-4 of the mean."""
        mean = float(self.normal_force.mean()) if self.count else 0.0
        return read_only(self.normal_force > CARRIED * max(mean, 0.0))

    @property
    def share_at_rest(self) -> float:
        """Share of all grains that have a residual below 0.01; NaN without grains."""
        return float((self.residual < AT_REST).mean()) if len(self.residual) else math.nan

    @property
    def share_of_rattlers(self) -> float:
        """Share of all grains that are rattlers; NaN without grains."""
        return float(self.rattler.mean()) if len(self.rattler) else math.nan

    def largest_force(self) -> Floats:
        """Return the magnitude of the largest force on each grain, (n,); 0 for a grain without contacts."""
        largest = np.zeros(len(self.residual))
        np.maximum.at(largest, self.i, self.magnitude)
        grains = self.j >= 0
        np.maximum.at(largest, self.j[grains], self.magnitude[grains])
        return largest

    def scaled(self, factor: float) -> "ContactForces":
        """Return the same forces with all lengths multiplied by a factor above 0.

        Raises
        ------
        InputError
            If a coordinate is beyond 1e60 then.
        """
        return replace(self, point=self.point * factor, gap=self.gap * factor)


def partner_images(assembly: Assembly, forces: ContactForces) -> Integers:
    """Return by how many periods of the container the partner of each contact is shifted, (m, 3).

    It is the periodic image of the partner that lies nearest to where the centroid of `i` mirrored at the contact point
    is; 0 at walls and the lid.
    """
    mirrored = 2.0 * forces.point - assembly.position[forces.i]
    turns = nearest_turns(mirrored - assembly.position[forces.j], periods_of(assembly.container))
    return np.where(forces.j[:, None] >= 0, turns, 0)


def chain_ends(assembly: Assembly, forces: ContactForces) -> tuple[Floats, Floats]:
    """Return where the lines of the force chains start and end, (m, 3) each: the centroid of `i`, and that of the
    periodic image of `j` that it touches, or the contact point at a wall or the lid.
    """
    shift = linear.matmul(partner_images(assembly, forces), periods_of(assembly.container))
    ends = np.where(forces.j[:, None] >= 0, assembly.position[forces.j] + shift, forces.point)
    return assembly.position[forces.i], ends


def among_movable(assembly: Assembly, forces: ContactForces, fixed: Booleans) -> ContactForces:
    """Return the forces of the grains that are not fixed, (n,), by their numbers without the fixed ones.

    The partner of a contact with a fixed grain is a wall there.
    """
    turned = fixed[forces.i] & (forces.j >= 0) & ~fixed[np.maximum(forces.j, 0)]
    kept, sign = ~fixed[forces.i] | turned, np.where(turned, -1.0, 1.0)[:, None]
    across = forces.gap[:, None] * forces.normal - linear.matmul(
        partner_images(assembly, forces), periods_of(assembly.container)
    )
    number = np.where(fixed, WALL, np.cumsum(~fixed) - 1)
    i, j = np.where(turned, forces.j, forces.i), np.where(turned, forces.i, forces.j)
    return replace(
        forces,
        i=number[i[kept]],
        j=np.where(j < 0, j, number[np.maximum(j, 0)])[kept],
        point=np.where(turned[:, None], forces.point + across, forces.point)[kept],
        normal=(sign * forces.normal)[kept],
        force=(sign * forces.force)[kept],
        gap=forces.gap[kept],
        residual=forces.residual[~fixed],
        rattler=forces.rattler[~fixed],
    )


def tiled_positions(assembly: Assembly, container: Container, cells: Integers) -> Floats:
    """Return the positions of copies of all grains in cells (k, 3) of a periodic container, within a larger one."""
    moved = (assembly.position + linear.matmul(cells, periods_of(assembly.container))[:, None]).reshape(-1, 3)
    # where copies lie one upon the other in a tilted cell, the edges of the larger cell may lean the other way
    return within_periods(moved, container) if any(tilt_of(assembly.container)) else moved


def tiled_forces(assembly: Assembly, forces: ContactForces, position: Floats, cells: Integers) -> ContactForces:
    """Return the forces of copies of all grains, which have positions (k n, 3), in cells (k, 3)."""
    many, n, grains = cells.max(axis=0) + 1, assembly.count, forces.j >= 0
    # the partner is in the cell to which its image belongs
    cell = (cells[:, None] + partner_images(assembly, forces)) % many
    copy, across = linear.matmul(cell, [many[1] * many[2], many[2], 1]), n * np.arange(len(cells))[:, None]
    moved = (position.reshape(-1, n, 3) - assembly.position)[:, forces.i]
    names: dict[str, Any] = {
        "normal": (len(cells), 1),
        "force": (len(cells), 1),
        "gap": len(cells),
        "residual": len(cells),
    }
    rub = forces.friction
    return replace(
        forces, i=(forces.i + across).ravel(), j=np.where(grains, forces.j + n * copy, forces.j).ravel(),
        point=(forces.point + moved).reshape(-1, 3), rattler=np.tile(forces.rattler, len(cells)),
        friction=np.tile(rub, len(cells)) if isinstance(rub, np.ndarray) else rub,
        **{name: np.tile(getattr(forces, name), times) for name, times in names.items()},
    )  # fmt: skip


def check_forces(forces: ContactForces | None, count: int) -> None:
    """Check that forces are those of a packing of so many grains; None is nothing to check.

    Raises
    ------
    InputError
        If they are something else, or have the residuals of another number of grains.
    """
    if forces is None:
        return
    if not isinstance(forces, ContactForces):
        raise InputError(f"forces are of type {type(forces).__name__}: they must be ContactForces or None; make some")
    if len(forces.residual) != count:
        raise InputError(
            f"forces are those of {len(forces.residual)} grains: the packing has {count}; set forces to None where the "
            "grains are others"
        )


def _flat(value: "ArrayLike") -> Sequence[Any] | NDArray[Any]:
    """Return a value that has a length."""
    array = np.asarray(value)
    return array if array.ndim else array.reshape(1)


def _partners(value: "ArrayLike", name: str, *, length: int, lowest: int, below: int) -> Integers:
    """Return indices of grains, or marks from `lowest`, as int64."""
    array = as_floats(value, name, shape=(length,))
    wrong = np.flatnonzero((array < lowest) | (array >= below) | (array != np.floor(array)))
    if len(wrong):
        marks = ", -1 for a wall or -2 for the lid" if lowest < 0 else ""
        raise InputError(
            f"{name} is {array[wrong[0]]:g} at index {wrong[0]}: it must be the index of a grain, a whole number below "
            f"{below}{marks}; correct it"
        )
    return array.astype(np.int64)


def _flags(value: "ArrayLike", count: int) -> Booleans:
    """Return flags of the grains."""
    array = np.asarray(value)
    if array.shape != (count,) or (count and array.dtype != np.bool_):
        raise InputError(
            f"rattler has shape {array.shape} and type {array.dtype}: it must have one of True and False for each of "
            f"the {count} grains of residual"
        )
    return array.astype(np.bool_)
