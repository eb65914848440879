"""`write_deck`: the input of an engine for a packing."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any, Literal

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Floats, as_choice, as_count, as_number, check_type, float_array
from voxgran._base.calls import explained
from voxgran._base.config import from_mapping
from voxgran._base.errors import InputError, shown
from voxgran._base.files import as_path, refuse_links, refuse_to_replace, write_files
from voxgran.clumps.fit import fit_clump
from voxgran.clumps.model import Clump
from voxgran.contacts.manifolds.convex_bodies import is_convex
from voxgran.containers.model import Container, boundary_of, refuse_tilt
from voxgran.decks.bodies import Kind, Template, is_round, names_of, polyhedron_of
from voxgran.decks.contact_law import GRAVITY
from voxgran.decks.engine import Engine, engine_registry
from voxgran.decks.simulation import LONGEST, Simulation, simulation_of
from voxgran.packing.model import Packing, check_packing
from voxgran.settling.material import Material
from voxgran.settling.materials import Materials
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import Spheres

#: spheres of a clump where no number is given
USUAL_SPHERES = 20
#: clumps of shapes that are kept, since further decks of a packing have the same
KEPT_CLUMPS = 64
#: stress beyond that of any solid, Pa
LARGEST = 1e15
#: what a grain that is no sphere may be asked to be
KINDS = ("clump", "polyhedron", "mesh", "level_set", "convex_parts")


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Deck(ExplainedAttributes):
    """Input of an engine in a folder.

    Attributes
    ----------
    engine : str
        Name of the engine.
    folder : Path
        Where the files are.
    files : tuple of Path
        All files that were written.
    simulation : Simulation
        What they describe: bodies, walls, contact law, gravity and time step, in SI units.
    packing : Packing
        The grains as the engine has them, with clumps in place of shapes that it cannot hold.
    command : str
        Command line that runs them, in the folder; ``""`` where the engine has none.
    """

    engine: str
    folder: Path
    files: tuple[Path, ...]
    simulation: Simulation
    packing: Packing
    command: str

    def __repr__(self) -> str:
        """Engine, number of grains and files."""
        return f"Deck({self.packing.count} grains for {self.engine}, {len(self.files)} files in {str(self.folder)!r})"


@explained(hint='write_deck(packing, "run", "lammps", material=Material(density=2650))')
def write_deck(
    packing: Packing,
    folder: str | os.PathLike[str],
    engine: str = "lammps",
    *,
    material: Material | Materials | Mapping[str, Any] | None = None,
    clump: int | Clump | None = None,
    grains: Literal["clump", "polyhedron", "mesh", "level_set", "convex_parts"] | None = None,
    acceleration: float = GRAVITY,
    time_step: float | None = None,
    stress: float | Sequence[float] | None = None,
    overwrite: bool = False,
) -> Deck:
    """Write the input of a DEM or DDA engine for a packing.

    All numbers in the files are in SI units; lengths without a unit are taken as metres. The files state the contact
    law, the true mass, centroid and inertia of each grain, the walls, gravity, a stable time step, and what is
    approximated with its error.

    Parameters
    ----------
    packing : Packing
        Grains in their container.
    folder : path-like
        Where the files go; it is made if needed. Their names begin with that of the engine, so that decks of several
        engines may share a folder.
    engine : str
        Name of the engine; :func:`voxgran.engines` lists them.
    material : Material, Materials or mapping, optional
        Contact law and its parameters, or a table of materials with those of each pair. Default: ``Material()``.
    clump : int or Clump, optional
        Number of spheres, or a fitted clump, in place of each shape that is no sphere, also where the engine has
        another kind of grain for it. Default: 20 where it has none.
    grains : {"clump", "polyhedron", "mesh", "level_set", "convex_parts"}, optional
        What grains that are no spheres become. Default: clumps where `clump` is given, or where the shape is an
        ellipsoid or a spherocylinder and the engine has clumps, else the first of these that the engine has for the
        shape. As polyhedra, these two have at most 162 corners and the same volume.
    acceleration : float
        Acceleration of gravity, m/s^2, along ``packing.gravity``.
    time_step : float, optional
        Time step in s, at most the stable one. Default: half of that.
    stress : float or sequence of float, optional
        Mean stress in Pa that the sides of a periodic container, or its plane walls, keep, along all axes or along each
        one, compression above 0; NaN along axes of which the length stays. Of two walls the upper one moves, with the
        force of the stress on its area at the start. Default: the container stays as it is.
    overwrite : bool
        Whether files that are there may be replaced.

    Returns
    -------
    Deck
        Files, command line, and the simulation that they describe.

    Raises
    ------
    UnknownNameError
        If the engine or a material parameter is unknown; the message gives the nearest name.
    InputError
        If the packing has no grains, the engine cannot hold its grains, fixed ones, container, law, bonds or stress, a
        material parameter is missing or out of range, the stiffness is too low, or the time step is above the stable
        one.
    OutputExistsError
        If one of the files is there and `overwrite` is false.
    OutputError
        If a file cannot be written.

    Warns
    -----
    PackingWarning
        If the weight of the bed presses grains into each other by more than a hundredth of the median diameter.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((3, 3, 3)), "rsa", count=5, unit="mm")
    >>> deck = vg.write_deck(bed, "run", "lammps", material=vg.Material(density=2500))
    >>> deck.engine, len(deck.files)
    ('lammps', 2)
    """
    found = engine_registry().get(engine)
    simulation, held = described(
        packing, found, material, clump=clump, grains=grains, acceleration=acceleration, time_step=time_step,
        stress=stress,
    )  # fmt: skip
    place = as_path(folder)
    if place.exists() and not place.is_dir():
        raise InputError(
            f"folder is {str(place)!r}, which is a file: the input of an engine needs a folder; name another"
        )
    texts = found.write(simulation)
    paths = tuple(place / name for name in texts)
    if not overwrite:
        refuse_to_replace(*paths)
    refuse_links(place, *paths)
    write_files(dict(zip(paths, texts.values(), strict=True)))
    return Deck(engine=engine, folder=place, files=paths, simulation=simulation, packing=held, command=found.command)


def described(
    packing: Packing,
    engine: Engine,
    material: Material | Materials | Mapping[str, Any] | None,
    *,
    clump: int | Clump | None = None,
    grains: str | None = None,
    acceleration: float = GRAVITY,
    time_step: float | None = None,
    rest: float | None = None,
    longest: float = LONGEST,
    stress: float | Sequence[float] | None = None,
) -> tuple[Simulation, Packing]:
    """Return the simulation of a packing by an engine, and the packing of the grains as that has them.

    Parameters are those of :func:`write_deck`, which writes the files.

    Raises
    ------
    InputError
        As :func:`write_deck`.
    """
    check_packing(packing, "packing")
    law = as_material(material)
    if not packing.count:
        raise InputError(f"packing has no grains: input for {engine.title} needs at least one; add grains")
    refuse_unheld(engine, law, packing.container)
    bonded = isinstance(law, Material) and law.bond_strength is not None
    if packing.fixed is not None and not (engine.fixed and packing.movable.any() and not bonded):
        raise InputError(
            f"{int(packing.fixed.sum())} grains are fixed: such input for {engine.title} moves all grains; give engine "
            f"{_able('fixed')}, without bonds, and grains that move, or leave them out with packing[packing.movable]"
        )
    for number in np.unique(packing.shape_id).tolist():
        packing.shapes[number].refuse_open("bodies of an engine")
    held, templates = _held(packing, engine, clump, grains)
    if bonded and not any(template.kind == "clump" for template in templates):
        raise InputError("material bond_strength is given, but no grain is a clump: leave it out, or give clump=20")
    made = simulation_of(
        held,
        templates,
        law,
        acceleration=as_number(acceleration, "acceleration", above=0.0, at_most=1e9),
        time_step=time_step,
        rest=rest,
        longest=longest,
        stress=None if stress is None else _as_stress(stress, packing, engine),
    )
    return made, held


def _as_stress(given: Any, packing: Packing, engine: Engine) -> Floats:
    """Return the stresses (3,) that the sides of a container keep, NaN along axes of which the length stays.

    Raises
    ------
    InputError
        If they are no stresses, a wall is no plane, both walls and periodic sides are to keep one, there is gravity, or
        the engine keeps none.
    """
    stress = float_array(given)
    stress = None if stress is None or stress.shape not in ((), (3,)) else np.array(np.broadcast_to(stress, 3))
    if stress is None or np.isnan(stress).all() or not (np.isnan(stress) | ((stress > 0.0) & (stress < LARGEST))).all():
        raise InputError(
            f"stress is {shown(given)}: it must be one number of pascals above 0, or three, NaN along axes whose "
            "length stays; correct it"
        )
    refuse_tilt(packing.container, f"a cell of {engine.title} that keeps a stress", "leave the stress out")
    periodic = np.array(packing.container.periodic)
    kept, flat = ~np.isnan(stress), np.array(boundary_of(packing.container).flat)
    for what, mine, able in (("walls", kept & ~periodic, "platens"), ("periodic sides", kept & periodic, "servo")):
        if mine.any() and not getattr(engine, able):
            raise InputError(
                f"stress is {shown(given)}: input for {engine.title} has no {what} that keep one; choose engine "
                f"{_able(able)}, or leave it out"
            )
    curved = ", ".join(axis for k, axis in enumerate("xyz") if kept[k] and not (periodic[k] or flat[k]))
    if curved or ((kept & periodic).any() and (kept & ~periodic).any()):
        why = f"there are no two plane walls along {curved}" if curved else "walls and periodic sides are to keep one"
        raise InputError(f"stress is {shown(given)}: {why}; give NaN along such axes, whose length stays then")
    if packing.gravity is not None:
        raise InputError(
            f"stress is {shown(given)}, and packing.gravity is {shown(packing.gravity)}: grains under both are not "
            "held; take one away with dataclasses.replace"
        )
    return stress


def _able(what: str) -> str:
    """Return the names of the engines that can do something, in words."""
    registry = engine_registry()
    return " or ".join(repr(name) for name in registry.names() if getattr(registry.get(name), what))


def as_material(value: Any) -> Material | Materials:
    """Return a material, made of a mapping of its parameters or the default one; a table of several stays as it is.

    Raises
    ------
    UnknownNameError
        If a parameter is unknown.
    InputError
        If it is neither, or a parameter is out of its range.
    """
    if value is None:
        return Material()
    if isinstance(value, Mapping):
        return from_mapping(Material, value, "material")
    check_type(value, (Material, Materials), "material", "a Material, a mapping of its parameters, or Materials")
    return value


def refuse_unheld(engine: Engine, material: Material | Materials, container: Container) -> None:
    """Refuse a material or a container that an engine does not have.

    Parameters
    ----------
    engine : Engine
        The engine.
    material : Material or Materials
        Contact law.
    container : Container
        What holds the grains.

    Raises
    ------
    InputError
        If the container is flat, periodic or tilted, or the material has a law, surface energy, rolling friction or
        bonds that the engine has not, or there are several materials and it has one.
    """
    title = engine.title
    if container.dimension == 2 and not engine.planar:
        raise InputError(f"container is flat: {title} takes grains in three dimensions; choose engine 'blocks'")
    if any(container.periodic) and not engine.periodic:
        raise InputError(f"container is periodic: input for {title} has walls only; use one without periodic axes")
    if not engine.tilted:
        registry = engine_registry()
        able = " or ".join(repr(name) for name in registry.names() if registry.get(name).tilted)
        why = f", {engine.upright}," if engine.upright else ""
        refuse_tilt(container, f"input for {title}{why}", f"choose engine {able}, or leave the tilt out")
    if isinstance(material, Materials):
        _refuse_several(engine, material)
        for first, second in combinations_with_replacement(material.names, 2):
            _refuse_law(engine, material.between(first, second))
        return
    _refuse_law(engine, material)


def _refuse_several(engine: Engine, materials: Materials) -> None:
    """Refuse several materials for an engine that has one, and bonds of several."""
    many = len(materials.names)
    if many > 1 and not engine.materials:
        raise InputError(f"material has {many} materials: input for {engine.title} has one; give one Material")
    if materials.materials[materials.names[0]].bond_strength is not None:
        raise InputError("material bond_strength is given for named materials: bonds are of one; give one Material")


def _refuse_law(engine: Engine, material: Material) -> None:
    """Refuse properties of a material that an engine does not have."""
    title = engine.title
    if material.law not in engine.laws:
        laws = " and ".join(map(repr, engine.laws))
        raise InputError(f"material law is {material.law!r}: input for {title} has {laws}; change it")
    if material.cohesion and not engine.cohesion:
        raise InputError(f"material cohesion is {material.cohesion:g}: input for {title} has none; leave it out")
    if material.rolling_friction and material.law not in engine.rolling:
        raise InputError(
            f"material rolling_friction is {material.rolling_friction:g}: input for {title} has none under the law "
            f"{material.law!r}; leave it out"
        )
    if material.bond_strength is not None and not engine.bonds:
        raise InputError(f"material bond_strength is given: input for {title} has no bonds; leave it out")


def _held(packing: Packing, engine: Engine, clump: Any, grains: Any) -> tuple[Packing, tuple[Template, ...]]:
    """Return the packing as an engine has it, and a template for each shape."""
    if grains is not None:
        as_choice(grains, "grains", KINDS)
        if grains not in engine.kinds:
            has = ", ".join(repr(kind) for kind in engine.kinds if kind != "sphere")
            raise InputError(f"grains is {grains!r}: {engine.title} has {has}; choose one of these")
        if clump is not None and grains != "clump":
            raise InputError(f"clump and grains={grains!r}: give clump for clumps only; leave one out")
    if clump is not None and not isinstance(clump, Clump):
        clump = as_count(clump, "clump", at_least=1)
    asked = "clump" if clump is not None else grains
    used = set(packing.shape_id.tolist())
    kinds = [_kind(shape, engine, asked) if k in used else "sphere" for k, shape in enumerate(packing.shapes)]
    if "clump" not in engine.kinds and "clump" in kinds:
        has = ", ".join(repr(kind) for kind in engine.kinds)
        raise InputError(f"clump is given, but input for {engine.title} has no clumps, only {has}: leave clump out")
    fitted = [k for k, kind in enumerate(kinds) if kind == "clump" and not _is_clump(packing.shapes[k])]
    if not fitted:
        return packing, _templates(packing.shapes, kinds)
    if isinstance(clump, Clump):
        if len(fitted) > 1:
            raise InputError(f"clump is a single Clump for {len(fitted)} shapes: use packing.with_clumps([...]) first")
        given = {"clumps": [clump if k in fitted else None for k in range(len(packing.shapes))]}
        made = packing.with_clumps(**given)
    else:
        made = _with_some_clumps(packing, fitted, clump or USUAL_SPHERES)
    return made, _templates(made.shapes, kinds, made.provenance.get("clumps"))


def _with_some_clumps(packing: Packing, fitted: list[int], count: int) -> Packing:
    """Return the packing with clumps in place of some of its shapes."""
    clumps = [_clump_of(shape, count) if k in fitted else None for k, shape in enumerate(packing.shapes)]
    return packing.with_clumps(clumps)


@lru_cache(maxsize=KEPT_CLUMPS)
def _clump_of(shape: Shape, count: int) -> Clump:
    """Return the clump of a shape, which several decks of a packing have."""
    return fit_clump(shape, max_spheres=count)


def _is_clump(shape: Shape) -> bool:
    """Return whether a shape is made of spheres already."""
    return isinstance(shape.geometry, Spheres)


def _kind(shape: Shape, engine: Engine, asked: str | None) -> Kind:
    """Return what a shape becomes in an engine."""
    if shape.is_sphere and "sphere" in engine.kinds:
        return "sphere"
    if _is_clump(shape) and "clump" in engine.kinds:
        return "clump"
    convex = shape.dimension == 3 and is_convex(shape.geometry)
    if asked is None and is_round(shape) and "clump" in engine.kinds:
        return "clump"
    for kind in engine.kinds if asked is None else (asked,):
        if kind in ("clump", "mesh", "level_set", "convex_parts") or (kind == "polyhedron" and convex):
            return kind  # type: ignore[return-value]
    if asked is not None:
        raise InputError(f"shape {shape.name!r} is not convex: a polyhedron of {engine.title} is; give grains='clump'")
    return "clump"


def _templates(shapes: tuple[Shape, ...], kinds: list[Kind], errors: Any = None) -> tuple[Template, ...]:
    """Return a template for each shape."""
    records = errors if isinstance(errors, list) and len(errors) == len(shapes) else [None] * len(shapes)
    names = names_of(shapes)
    return tuple(
        Template(name, kind, shape, _approximation(name, kind, shape, record))
        for name, kind, shape, record in zip(names, kinds, shapes, records, strict=True)
    )


def _approximation(name: str, kind: Kind, shape: Shape, record: Any) -> str:
    """Return what the geometry of an engine leaves out of a shape, as a sentence; empty where it is exact."""
    if kind == "clump" and record:
        assert isinstance(shape.geometry, Spheres)
        errors, count = record["errors"], len(shape.geometry.radii)
        return (
            f"{name} is a clump of {count} spheres in place of {record['shape']}: intersection over union "
            f"{errors['iou']:.4f}, largest distance of the surfaces {errors['surface_max']:.3g} equivalent diameters; "
            "mass, centroid and inertia are the true ones"
        )
    off = polyhedron_of(shape)[1] if kind == "polyhedron" else shape.tessellation_error
    if kind in ("polyhedron", "mesh", "level_set", "convex_parts") and off > 0:
        true = "volume, mass" if kind == "polyhedron" and is_round(shape) else "mass"
        return (
            f"{name} is a polyhedron in place of {shape.name}: its surface is off by at most "
            f"{off / shape.diameter:.3g} equivalent diameters; {true} and inertia are the true ones"
        )
    return ""
