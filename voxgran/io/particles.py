"""Spheres of a file of another program, and the packing of these, with a record of all assumptions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import LONGEST, SHORTEST, Booleans, Floats, Integers
from voxgran._base.axes import Periodic
from voxgran._base.errors import FileFormatError, InputError, PackingWarning, shown, warn, with_article
from voxgran._base.units import known_unit, stated_unit
from voxgran.contacts.assembly import NOT_STATED, shapes_by_density
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container, check_container
from voxgran.geometry.rotation import quaternions_of
from voxgran.geometry.sphere_pairs import near_pairs
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

#: rule for valid spheres
SPHERE_RULE = f"all must be finite and at most {LONGEST:g} in magnitude, and r above 0 (at least {SHORTEST:g})"
#: largest number of a clump
LARGEST_CLUMP = 2.0**53
#: largest number of spheres that may be a clump, and overlap in radii of the smaller one above which they may be one
MOST_OF_A_CLUMP, DEEP = 2000, 0.05
#: relative difference, from digits that a file leaves out, up to which a diameter is twice a radius
ROUNDED = 1e-3
#: clumps whose spheres agree within this part of their size share a shape
SAME = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Particles:
    """Spheres of a file of another program."""

    #: (n, 3), in the unit of the file
    centers: Floats
    radii: Floats
    #: (n,) rigid clump of each sphere, below 0 for none; None for a file without clumps
    clump: Integers | None = None
    #: container that the file states
    container: Container | None = None
    #: unit of lengths that the file names
    unit: str | None = None
    #: that of each sphere (n,), or of all; 1 where the file gives none
    density: float | Floats = NOT_STATED
    #: gravity and contact gap of a packing of ours
    fields: Mapping[str, Any] = field(default_factory=dict)
    #: what was taken for granted, by subject
    assumed: Mapping[str, str] = field(default_factory=dict)
    #: whether they are disks in the plane z = 0
    flat: bool = False


def good_spheres(centers: Floats, radii: Floats) -> Booleans:
    """Return for each sphere whether center (n, 3) and radius (n,) are lengths that can be computed with, (n,):
    coordinates finite and at most 1e60 in magnitude, radii between 1e-60 and 1e60.
    """
    good: Booleans = (np.abs(centers) <= LONGEST).all(axis=1) & (radii >= SHORTEST) & (radii <= LONGEST)
    return good


def refuse_bad_spheres(centers: Floats, radii: Floats, path: Path, *, row: str = "sphere") -> None:
    """Refuse spheres that are not good ones, counted from 0 and called `row` in the message.

    Raises
    ------
    FileFormatError
        If there is one; the message gives the first.
    """
    good = good_spheres(centers, radii)
    if not good.all():
        k = int(good.argmin())
        x, y, z = centers[k].tolist()
        raise FileFormatError(
            f"{path}, {row} {k}: x y z r is {x:g} {y:g} {z:g} {float(radii[k]):g}; {SPHERE_RULE}; mend or remove it"
        )


def radii_of(table: Floats, columns: Mapping[str, int], path: Path) -> Floats:
    """Return the radii of the rows of a table with a column ``r``, ``d`` or both, by their places.

    Raises
    ------
    FileFormatError
        If a diameter is not twice the radius beside it.
    """
    if "r" not in columns:
        return np.asarray(table[:, columns["d"]] / 2)
    radii = table[:, columns["r"]]
    if "d" in columns and len(table):
        apart = np.abs(2 * radii - table[:, columns["d"]])
        k = int(apart.argmax())
        if not apart[k] <= ROUNDED * 2 * radii[k]:
            raise FileFormatError(
                f"{path}, row {k}: the radius is {radii[k]:g} and the diameter {table[k, columns['d']]:g}, which must "
                "be twice the radius; leave one of the columns out"
            )
    return radii


def text_lines(path: Path, wanted: str) -> list[str]:
    """Return the lines of a text file without blank ones at its end; `wanted` is what the message asks for.

    Raises
    ------
    FileFormatError
        If it is no text.
    """
    try:
        return path.read_text(encoding="utf-8").rstrip().splitlines()
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path} is no text ({error.reason}): give {wanted}") from error


def frame_of(count: int, frame: int, path: Path) -> int:
    """Return the number of a frame, from 0, of a file with so many; negative ones count from the end.

    Raises
    ------
    FileFormatError
        If there is no such frame.
    """
    if not -count <= frame < count:
        raise FileFormatError(f"{path} has {count} frames: there is no frame {frame}; choose another")
    return frame % count


def numbers_of(
    rows: list[list[str]], numbers: list[int], path: Path, *, width: int, text: Sequence[int] = ()
) -> Floats:
    """Return rows of words, with the numbers of their lines, as numbers; 0 for words in the columns `text`.

    Raises
    ------
    FileFormatError
        If a row does not hold `width` numbers; the message gives the first.
    """
    if text:
        rows = [["0" if k in text else word for k, word in enumerate(row)] for row in rows]
    try:
        table: Floats = np.array(rows, dtype=np.float64).reshape(len(rows), width)
        return table
    except ValueError:
        for row, number in zip(rows, numbers, strict=True):
            try:
                good = len([float(word) for word in row]) == width
            except ValueError:
                good = False
            if not good:
                raise FileFormatError(
                    f"{path}, line {number}: {' '.join(row)[:60]!r} is not {width} numbers; mend or remove the line"
                ) from None
        raise


def order_by_id(ids: Sequence[str] | Floats, numbers: Sequence[int], path: Path, *, row: str = "line") -> Integers:
    """Return the order of spheres by their ids, which are numbers or texts.

    `numbers` are the numbers of the rows in the file, and `row` is what such a row is called; both are for the message.

    Raises
    ------
    FileFormatError
        If two spheres have one id.
    """
    try:
        known = np.asarray(ids, dtype=np.float64)
    except ValueError:
        known = np.asarray(ids)
    order: Integers = np.argsort(known, kind="stable")
    twice = np.flatnonzero(known[order[1:]] == known[order[:-1]])
    if len(twice):
        one, other = order[twice[0] : twice[0] + 2].tolist()
        name = f"{known[other]:g}" if known.dtype == np.float64 else shown(str(known[other]))
        raise FileFormatError(
            f"{path}, {row} {numbers[other]}: the sphere has the id {name}, as that of {row} {numbers[one]}: each has "
            "its own; mend the ids, or leave them out"
        )
    return order


def box_of(bounds: Floats, periodic: Periodic, path: Path, tilt: "ArrayLike" = (0.0, 0.0, 0.0)) -> Box:
    """Return the box that a file gives by its bounds (3, 2), as if it stood upright, and its tilts xy, xz and yz.

    Raises
    ------
    FileFormatError
        If it has no size, a bound is not finite, or it is tilted along an axis that is not periodic.
    """
    lengths = bounds[:, 1] - bounds[:, 0]
    if not ((np.abs(bounds) <= LONGEST).all() and (lengths >= SHORTEST).all()):
        raise FileFormatError(
            f"{path} has a box of {lengths.tolist()}: all lengths must be above 0, and bounds at most {LONGEST:g} in "
            "magnitude; write it again"
        )
    x, y, z = lengths.tolist()
    try:
        return Box((x, y, z), periodic, origin=tuple(bounds[:, 0].tolist()), tilt=tilt)
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from error


def tilt_of_edges(edges: Floats, path: Path, line: int) -> Floats:
    """Return the tilts xy, xz and yz of a box whose edges are the rows of an array (3, 3).

    Raises
    ------
    FileFormatError
        If its first edge is not along x, or its second one not in the plane of x and y.
    """
    if np.triu(edges, 1).any():
        raise FileFormatError(
            f"{path}, line {line}: the edges of the box are {shown(edges.tolist())}: the first must be along x and the "
            "second in the plane of x and y; turn the spheres and the box"
        )
    return np.asarray(edges[np.tril_indices(3, -1)])


def packing_of(
    particles: Particles,
    path: Path,
    *,
    container: Container | None = None,
    unit: str | None = None,
    periodic: Periodic | None = None,
) -> Packing:
    """Return the packing of spheres and clumps that another program wrote, in the order in which their first spheres
    stand in the file; what was assumed stands in the provenance.

    Container, unit and periodic axes that are left out are those of the file, or else the box around the spheres,
    ``"1"`` and none.

    Raises
    ------
    InputError
        If there is neither a container nor a sphere to put a box around, `periodic` does not fit, or the file has its
        lengths in another unit.

    Warns
    -----
    PackingWarning
        If most spheres overlap others, as those of a clump do, or centers lie outside of the container.
    """
    _warn_of_a_clump(particles, path)
    assumed = dict(particles.assumed)
    if container is not None:
        check_container(container)
    held = particles.container if container is None else container
    if held is None:
        held = _box_around(particles, path)
        assumed["container"] = "the box around the spheres"
        assumed["periodic"] = "nowhere"
    elif container is not None:
        for subject in ("periodic", "dimension"):
            assumed.pop(subject, None)
    if periodic is not None:
        if not hasattr(held, "with_periodic"):
            raise InputError(
                f"periodic is {shown(periodic)}: {with_article(held.kind)} is given as it is; only a box takes axes"
            )
        held = held.with_periodic(periodic)
        assumed.pop("periodic", None)
    _warn_of_strays(particles, held, path)
    asked, named = stated_unit(unit), known_unit(particles.unit)
    if None not in (asked, named) and asked != named:
        raise InputError(
            f"unit is {shown(unit)} and {path} has its lengths in {named}: leave unit out, and convert the packing by "
            f"to_unit({asked!r})"
        )
    if unit is None and named is None:
        told = "none" if particles.unit is None else f"{shown(particles.unit)} is no unit that is known"
        assumed["unit"] = f"{told}: lengths are taken as they stand"
    grains: dict[str, Any] = (
        {"shapes": (_unit_body(flat=particles.flat),), "position": particles.centers, "scale": 2 * particles.radii}
        if particles.clump is None
        else _clumps(particles)
    )
    if isinstance(particles.density, np.ndarray):
        ids = np.zeros(len(particles.density), dtype=np.int64)
        by_density = shapes_by_density(grains["shapes"], ids, particles.density)
        grains["shapes"], grains["shape_id"], grains["density"] = by_density
    else:
        grains["density"] = particles.density
    return Packing.of(
        container=held,
        provenance={"method": "file", "parameters": {"path": str(path)}} | ({"assumed": assumed} if assumed else {}),
        unit=asked or named,
        # gravity is a direction in the container of the file
        **(particles.fields if held is particles.container else {}),
        **grains,
    )


def _warn_of_a_clump(particles: Particles, path: Path) -> None:
    """Warn where the file is that of a clump: few spheres without container, most of which overlap others deeply."""
    centers, radii = particles.centers, particles.radii
    if particles.container is not None or particles.clump is not None or particles.flat:
        return
    if not 2 <= len(radii) <= MOST_OF_A_CLUMP:
        return
    i, j, _ = near_pairs(centers, radii, 0.0)
    depth = radii[i] + radii[j] - linear.norm(centers[j] - centers[i], axis=1)
    deep = depth > DEEP * np.minimum(radii[i], radii[j])
    count = len(np.union1d(i[deep], j[deep]))
    if count > len(radii) / 2:
        warn(
            f"{path} holds {len(radii)} spheres as a packing, of which {count} overlap others by more than {DEEP:.0%} "
            "of their radius: if they are one clump, read it with vg.load_shape",
            PackingWarning,
        )


def _warn_of_strays(particles: Particles, container: Container, path: Path) -> None:
    """Warn where spheres have their centers outside of a container; across a periodic face they are images of those
    inside.
    """
    depth = container.signed_distance(particles.centers)
    size = float(np.max(container.bounds[1] - container.bounds[0]))
    strays = np.flatnonzero(depth > SAME * size)
    if len(strays):
        warn(
            f"{path} has {len(strays)} of {len(depth)} spheres with their centers outside of the container, the first "
            f"at {particles.centers[strays[0]].tolist()}: they stay there; give periodic for axes along which it "
            "repeats, or another container",
            PackingWarning,
        )


def _box_around(particles: Particles, path: Path) -> Box | Rectangle:
    """Return the box around spheres, or the rectangle around disks."""
    centers, radii = particles.centers, particles.radii[:, None]
    if not len(centers):
        raise InputError(f"{path} holds no sphere and names no container: give the container")
    lower = (centers - radii).min(axis=0)
    x, y, z = ((centers + radii).max(axis=0) - lower).tolist()
    if particles.flat:
        return Rectangle((x, y), origin=tuple(lower.tolist()[:2]))
    return Box((x, y, z), origin=tuple(lower.tolist()))


def _unit_body(*, flat: bool = False) -> Shape:
    """Return the sphere or disk of diameter 1."""
    if flat:
        return Shape.of(Outline("disk", radius=0.5), name="disk")
    return Shape.of(Primitive("sphere", (0.5,)), name="sphere")


def _clumps(particles: Particles) -> dict[str, Any]:
    """Return shapes and poses of spheres and clumps."""
    clump = np.asarray(particles.clump)
    single = clump < 0
    # each single sphere is a group of its own
    key = np.where(single, clump.max(initial=-1) + 1 + np.arange(len(clump)), clump)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    group = rank[index.reshape(-1)]
    order = np.argsort(group, kind="stable")
    bounds = np.searchsorted(group[order], np.arange(len(first) + 1))
    shapes: list[Shape] = [_unit_body()]
    templates: list[tuple[Floats, Floats]] = [(np.zeros((1, 3)), np.array([0.5]))]
    rows = []
    for begin, end in pairwise(bounds.tolist()):
        members = order[begin:end]
        centers, radii = particles.centers[members], particles.radii[members]
        if len(members) == 1:
            rows.append((0, 2 * float(radii[0]), centers[0], np.array([1.0, 0.0, 0.0, 0.0])))
            continue
        rows.append(_as_clump(centers, radii, shapes, templates))
    used, place = np.unique([row[0] for row in rows], return_inverse=True)
    return {
        "shapes": tuple(shapes[int(k)] for k in used) if len(used) else (shapes[0],),
        "shape_id": place,
        "scale": np.array([row[1] for row in rows]),
        "position": np.array([row[2] for row in rows]).reshape(-1, 3),
        "orientation": np.array([row[3] for row in rows]).reshape(-1, 4),
    }


def _as_clump(
    centers: Floats, radii: Floats, shapes: list[Shape], templates: list[tuple[Floats, Floats]]
) -> tuple[int, float, Floats, Floats]:
    """Return shape, scale, position and orientation of a clump; a shape is added where none agrees."""
    middle = centers.mean(axis=0)
    local, size = centers - middle, float(np.ptp(centers, axis=0).max() + radii.max())
    for k in range(1, len(shapes)):
        body, same = templates[k]
        if len(body) != len(local) or np.abs(same - radii).max() > SAME * size:
            continue
        turn = linear.nearest_rotations(linear.matmul(local.T, body))
        if np.abs(linear.matmul(body, turn.T) - local).max() <= SAME * size:
            offset = np.array(shapes[k].offset)
            return k, 1.0, linear.matmul(turn, offset) + middle, quaternions_of(turn[None])[0]
    shape = Shape.of(Spheres(local, radii), name=f"clump {len(shapes)}")
    shapes.append(shape)
    templates.append((local, radii))
    return len(shapes) - 1, 1.0, np.array(shape.offset) + middle, np.array([1.0, 0.0, 0.0, 0.0])
