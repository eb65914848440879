"""Poses of the grains from which a run starts: those of another packing, present before any other grain enters.

Methods keep a distance between grains beyond what true shapes need: the width of a voxel, or the bulge of a surface
between control points. Grains of a start may therefore touch, and be nearer than the method would place them. Without a
lattice they keep their poses where their true shapes overlap neither each other nor a wall; each stays until a move
provides the distance that the method requires. On a lattice they are displaced until their voxels do not overlap
(:mod:`voxgran.packing.digital.initial_sites`).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.errors import InputError
from voxgran.contacts.assembly import NOT_STATED, Assembly, Density, as_density, by_shape, density_text, merged
from voxgran.contacts.forces import among_movable
from voxgran.containers.model import Container

#: under which name a packing without its fixed grains keeps these
STANDING = "standing"


@dataclass(frozen=True, eq=False)
class Start:
    """Poses of the first grains of a problem: centroids (m, 3) in median diameters, and unit quaternions (m, 4)."""

    position: Floats
    orientation: Floats

    @property
    def count(self) -> int:
        """Number of grains of the start."""
        return len(self.position)

    def rising(self, gravity: Integers) -> Integers:
        """Return the indices of the grains from the lowest to the highest."""
        order: Integers = np.argsort(-(self.position @ gravity), kind="stable")
        return order

    def wrapped(self, container: Container) -> Floats:
        """Return the positions brought into the periodic lengths of a container."""
        wraps, (lower, upper), position = list(container.periodic), container.bounds, self.position.copy()
        lengths = (upper - lower)[wraps]
        position[:, wraps] -= np.floor((position - lower)[:, wraps] / lengths) * lengths
        return np.asarray(position)

    def queue(self, count: int) -> Integers:
        """Return the indices of all `count` grains: first those not yet placed, then those of the start."""
        return np.concatenate([np.arange(self.count, count), np.arange(self.count)]).astype(np.int64)


def refuse_start(grain: int) -> None:
    """Raise the error that no place is found for a grain of the start.

    Raises
    ------
    InputError
        Always.
    """
    raise InputError(
        f"grain {grain} of start finds no place near or above its own: the method needs gaps between grains; give a "
        "taller container, finer voxels or points, or a looser start"
    )


def check_start(start: Assembly, dimension: int, name: str = "start") -> None:
    """Refuse a start, or what else it is named, of another dimension.

    Raises
    ------
    InputError
        If its container has another dimension.
    """
    if start.dimension != dimension:
        raise InputError(
            f"{name} has dimension {start.dimension}: the container has {dimension}; use packings of one dimension"
        )


def density_around(start: Assembly | None, density: Any, shapes: int) -> Density:
    """Return the density of the shapes of a start followed by so many new ones.

    Grains of the start keep theirs, unless that is not stated and a single one is given. Without new shapes the given
    one is that of the start.

    Raises
    ------
    InputError
        If it is neither a number above 0 nor one for each new shape, or left out where the start has several.
    """
    if start is None:
        return as_density(NOT_STATED if density is None else density, shapes)
    if not shapes:
        return start.density if density is None else as_density(density, len(start.shapes))
    if density is None:
        if isinstance(start.density, tuple):
            raise InputError(
                f"density is left out and grains of start have {density_text(start.density)}: which of them the new "
                "grains have is not known; give theirs"
            )
        return start.density
    given = as_density(density, shapes)
    if start.density == NOT_STATED and isinstance(given, float):
        return given
    return merged([*by_shape(start.density, len(start.shapes)), *by_shape(given, shapes)])


def joined_ids(*parts: tuple[Integers | None, int]) -> Integers | None:
    """Return the rows of grains that are put together, -1 for those of no list; None where no list is known."""
    if all(rows is None for rows, _ in parts):
        return None
    return np.concatenate([np.full(count, -1) if rows is None else rows for rows, count in parts])


def joined_fixed(*parts: Any) -> Booleans | None:
    """Return which grains are fixed of packings that are put together; None where none is."""
    if all(part.fixed is None for part in parts):
        return None
    return np.concatenate([~part.movable for part in parts])


def standing_in(packing: Any) -> Any:
    """Return the packing of the fixed grains alone, also of a packing that :func:`around_fixed` returns; or None."""
    if packing.fixed is None:
        return packing._found.get(STANDING)
    return replace(packing[packing.fixed], fixed=None)


def around_fixed(packing: Any) -> Any:
    """Return the packing of the grains that are not fixed; forces at fixed ones are there forces at walls."""
    if packing.fixed is None:
        return packing
    if "around" not in packing._found:
        forces = None if packing.forces is None else among_movable(packing, packing.forces, ~packing.movable)
        kept = {name: getattr(packing, name) for name in ("provenance", "stop_reason", "asked_sizes", "relaxation")}
        found = replace(packing[packing.movable], forces=forces, **kept)
        found._found[STANDING] = standing_in(packing)
        packing._found["around"] = found
    return packing._found["around"]


def free_volume(packing: Any) -> float:
    """Return the volume of the container, in two dimensions its area, less that of fixed grains."""
    standing = standing_in(packing)
    return float(packing.container.volume - (0.0 if standing is None else standing.volumes.sum()))
