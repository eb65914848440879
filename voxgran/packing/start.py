"""Poses of the grains from which a run starts: those of another packing, present before any other grain enters.

Methods keep a distance between grains beyond what true shapes need: the width of a voxel, or the bulge of a surface
between control points. Grains of a start may therefore touch, and be nearer than the method would place them. Without a
lattice they keep their poses where their true shapes overlap neither each other nor a wall; each stays until a move
provides the distance that the method requires. On a lattice they are displaced until their voxels do not overlap
(:mod:`voxgran.packing.digital.initial_sites`).

All other grains may have orientations that are asked for, which they have from the beginning, too.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.errors import InputError, numbered, shown
from voxgran._base.scalars import number_of, whole_number_of
from voxgran._base.seeds import stream
from voxgran._base.units import NO_UNIT
from voxgran.contacts.assembly import NOT_STATED, Assembly, Density, as_density, by_shape, density_text, merged
from voxgran.contacts.forces import among_movable, tiled_forces, tiled_positions
from voxgran.containers.model import Container, periods_of, within_periods
from voxgran.containers.stretch import repeated
from voxgran.geometry.orientation_laws.directional import Random
from voxgran.geometry.orientation_laws.given import Given
from voxgran.geometry.orientation_laws.law import OrientationLaw
from voxgran.geometry.orientations import given
from voxgran.geometry.periods import nearest_turns
from voxgran.shapes.describing.extents import body_axes
from voxgran.shapes.model import Shape
from voxgran.shapes.size_laws.listed import refuse_too_many

#: under which name a packing without its fixed grains keeps these
STANDING = "standing"
#: distance in median diameters by which the grains of copies that are alike differ at most
SAME = 1e-6
#: measured bytes of a copy of a grain, and of a contact with its force, while they are made
COPY_BYTES, CONTACT_BYTES = 112, 264
#: how packings become alike in what they must share for a sum
_REMEDIES = {
    "unit": "convert one with to_unit",
    "container": "make one anew in the container of the other with Packing.of",
    "gravity": "give one the gravity of the other with dataclasses.replace",
    "lid": "give one the lid of the other with dataclasses.replace",
}


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
        order: Integers = np.argsort(-linear.matmul(self.position, gravity), kind="stable")
        return order

    def wrapped(self, container: Container) -> Floats:
        """Return the positions brought into the periodic lengths of a container."""
        return within_periods(self.position, container)

    def queue(self, count: int) -> Integers:
        """Return the indices of all `count` grains: first those not yet placed, then those of the start."""
        return np.concatenate([np.arange(self.count, count), np.arange(self.count)]).astype(np.int64)


def refuse_start(start: Start, grain: int, container: Container) -> None:
    """Raise the error that no place is found for a grain of the start, or that the start is larger than the container.

    Raises
    ------
    InputError
        Always.
    """
    refuse_outside(start, container)
    raise InputError(
        f"grain {grain} of start finds no place near or above its own: the method needs gaps between grains; give "
        "the container of the start, a taller one, finer voxels or points, or a looser start"
    )


def refuse_outside(start: Start, container: Container) -> None:
    """Refuse a start of which centroids are beyond the walls of the container.

    Raises
    ------
    InputError
        If it is so.
    """
    outside = np.flatnonzero(container.signed_distance(start.wrapped(container)) > 0.0)
    if len(outside):
        raise InputError(
            f"start reaches beyond the container, a {type(container).__name__}: the centroids of its "
            f"{numbered('grain', outside)} are outside; give a container that holds all grains of start, or leave "
            "those out, as in start[chosen]"
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


def asked_orientations(
    asked: Any, parameters: Mapping[str, Any], known: Iterable[str]
) -> tuple[OrientationLaw | None, Mapping[str, Any]]:
    """Return the distribution of orientations that is asked for, None without, and the parameters of the method.

    A whole number is the parameter of that name, where it is among those that are `known`.

    Raises
    ------
    InputError
        If it is neither a distribution nor an array of unit quaternions.
    """
    if asked is None or isinstance(asked, OrientationLaw):
        return asked, parameters
    if whole_number_of(asked) is not None and "orientations" in known:
        return None, {**parameters, "orientations": asked}
    if isinstance(asked, str | Mapping) or number_of(asked) is not None:
        raise InputError(
            f"orientations is {shown(asked)}: it must be a distribution such as vg.orientations.aligned('z'), or a "
            "unit quaternion for each grain"
        )
    return given(asked), parameters


def turns_asked(
    law: OrientationLaw | None, settings: Any, shapes: Sequence[Shape], shape_id: Integers, *,
    start: Assembly | None, seed: int,
) -> Floats | None:  # fmt: skip
    """Return the orientations of grains that a distribution asks for, (n, 4), after those of a start.

    None leaves them to the method, as where all orientations are equally likely, or all grains are spheres.

    Raises
    ------
    InputError
        If the distribution is not one of this dimension, a shape has no axis for it, a list has another length, or the
        parameters of the method do not go together with it.
    """
    if law is None or isinstance(law, Random) or all(shape.is_sphere for shape in shapes):
        return None
    against = getattr(settings, "against_orientations", "")
    if against:
        raise InputError(
            f"orientations is given and {against}, by which the method chooses orientations itself: leave out one of "
            "the two"
        )
    axes, n = body_axes(shapes, law), 0 if start is None else start.count
    for k in np.unique(shape_id[n:]).tolist():
        shape = shapes[k]
        if shape.is_sphere:
            axes[k] = [1.0, 0.0, 0.0]
        elif not axes[k].any() and not isinstance(law, Given):
            other = "short" if law.body_axis == "long" else "long"
            raise InputError(
                f"shape {shape.name!r} has no distinct {law.body_axis} axis: a distribution of orientations needs one; "
                f"give body_axis={other!r}, or a vector in the frame of the shape"
            )
    turns = law.turns(axes[shape_id[n:]], stream(seed, "asked turns"), dimension=shapes[0].dimension)
    return turns if start is None else np.concatenate([start.orientation, turns])


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
    if start.density == NOT_STATED and number_of(density) is not None:
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


def copies_of(packing: Any, repeats: Any) -> dict[str, Any]:
    """Return the fields that change in a packing that is repeated beside itself.

    Raises
    ------
    InputError
        As :meth:`voxgran.Packing.tiled`.
    """
    box, cells = repeated(packing.container, repeats)
    contacts = 0 if packing.forces is None else len(packing.forces.force)
    refuse_too_many(packing.count * len(cells), COPY_BYTES + CONTACT_BYTES * contacts / max(packing.count, 1))
    moved, k = tiled_positions(packing, box, cells), len(cells)
    tile: dict[str, Any] = {"shape_id": k, "scale": k, "orientation": (k, 1), "fixed": k, "grain_id": k}
    values = {name: getattr(packing, name) for name in tile}
    values = {name: None if value is None else np.tile(value, tile[name]) for name, value in values.items()}
    before = _alike(packing) or {"repeats": 1, "count": packing.count}
    many = (cells.max(axis=0) + 1)[: packing.dimension] * before["repeats"]
    record = {**deepcopy(dict(packing.provenance)), "tiled": {**before, "repeats": many.tolist()}}
    forces = None if packing.forces is None else tiled_forces(packing, packing.forces, moved, cells)
    return {**values, "position": moved, "container": box, "forces": forces, "provenance": record}


def _alike(packing: Any) -> dict[str, Any]:
    """Return what the provenance says of copies of which a packing consists, or nothing where they are alike no more,
    since grains have moved or some are left out.
    """
    record = packing.provenance.get("tiled", {})
    if not record or packing.count != math.prod(record["repeats"]) * record["count"]:
        return {}
    apart = packing.position.reshape(-1, record["count"], 3) - packing.position[: record["count"]]
    apart, periods = (apart - apart[:, :1]).reshape(-1, 3), periods_of(packing.container)
    apart -= linear.matmul(nearest_turns(apart, periods), periods)
    return dict(record) if np.abs(apart).max(initial=0.0) < SAME * packing.median_diameter else {}


def told_of(start: Any) -> dict[str, Any]:
    """Return what the provenance of a packing says of the packing that it begins with."""
    told = {"method": "", **start.provenance, "count": start.count}
    return {key: told[key] for key in ("count", "method", "tiled") if key in told}


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


def number_fixed(start: Any) -> int:
    """Return how many grains of a start, if there is one, are fixed."""
    return 0 if start is None or start.fixed is None else int(start.fixed.sum())


def free_volume(packing: Any) -> float:
    """Return the volume of the container, in two dimensions its area, less that of fixed grains."""
    standing = standing_in(packing)
    return float(packing.container.volume - (0.0 if standing is None else standing.volumes.sum()))


def frame_of(packing: Any) -> dict[str, Any]:
    """Return all that two packings must share so that their grains can be put together."""
    lid = None if packing.lid is None else (*packing.lid.normal.tolist(), packing.lid.level)
    return {"unit": packing.unit, "container": packing.container.to_mapping(), "gravity": packing.gravity, "lid": lid}


def refuse_unlike(mine: Mapping[str, Any], its: Mapping[str, Any]) -> None:
    """Refuse two packings that differ in what `frame_of` returns of them.

    Raises
    ------
    InputError
        If they differ; the message says in what, and what to do.
    """
    for name, value in mine.items():
        one, other, what, remedy = value, its[name], name, _REMEDIES[name]
        if one == other:
            continue
        if name == "unit" and NO_UNIT in (one, other):
            remedy = "state the unknown one with dataclasses.replace"
        if name == "container":
            keys = [key for key in {**one, **other} if one.get(key) != other.get(key)]
            one, other = ({key: box[key] for key in keys if key in box} for box in (one, other))
            what = f"container ({', '.join(keys)})"
        raise InputError(
            f"{what} of the packings is {shown(one)} and {shown(other)}: grains are put together in one container "
            f"and unit; {remedy}"
        )
