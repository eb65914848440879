"""Description of a granular scene, read from a TOML file and checked; nothing is planned or packed here."""

import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Self

from voxgran._base.arrays import as_choice, as_count, as_number, as_positive, check_type
from voxgran._base.config import from_mapping, parameters_of, to_mapping
from voxgran._base.errors import FileFormatError, InputError, UnknownNameError, shown
from voxgran._base.files import existing_file
from voxgran._base.guarded import reason_of
from voxgran._base.registry import nearest, unknown
from voxgran._base.units import as_unit
from voxgran.clumps.fit import TARGETS, fit_clump
from voxgran.clumps.method import clump_registry
from voxgran.clumps.stand_in import record_of
from voxgran.containers.make import make_container
from voxgran.containers.model import Container
from voxgran.decks.engine import engine_registry
from voxgran.decks.material import Material
from voxgran.decks.write import refuse_unheld
from voxgran.io.files import load
from voxgran.packing.gravity import proposed_axis
from voxgran.packing.method import method_registry
from voxgran.packing.model import Packing
from voxgran.scene.sections import General, Output
from voxgran.settling.parameters import Settling
from voxgran.shapes.family import families, make_shape
from voxgran.shapes.files import shape_of_file
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import Remedies
from voxgran.shapes.sizes import SizeDistribution, make_sizes

#: keys of a [[shape]] from a file, and of any
FILE_KEYS = ("file", "share", "repair", "surface", "unit", "clump")
SHAPE_KEYS = (*FILE_KEYS, "family", "seed")
#: remedies for a mesh that is not one closed solid
REMEDIES = Remedies(
    mend="set repair = true in its [[shape]]",
    keep_open="set surface = true",
    choose="choose with 'voxgran repair --bodies largest'",
    hole="close it with 'voxgran repair' and a larger --max-hole",
)
#: keys of a clump beside the parameters of its method
CLUMP_KEYS = ("max_spheres", "method", "target", "value", "seed")
SECTIONS = ("scene", "shape", "sizes", "container", "packing", "settle", "material", "measure", "output")
#: where a scene says whether and how its grains settle
SETTLE_KEYS = "a section [settle] says how grains settle; with enabled = false in it they do not"


@dataclass(frozen=True, slots=True)
class ShapeEntry:
    """One [[shape]]: a file or a family with parameters, its share, and how a clump is fitted that is packed in its
    place; None for the shape itself.
    """

    source: Literal["file", "family"]
    name: str
    share: float = 1.0
    parameters: Mapping[str, Any] = field(default_factory=dict)
    clump: Mapping[str, Any] | None = None

    def make(self) -> Shape:
        """Return the shape, before a clump takes its place."""
        if self.source == "file":
            return shape_of_file(self.name, remedies=REMEDIES, **self.parameters)
        return make_shape(self.name, **self.parameters)

    def grain(self) -> tuple[Shape, dict[str, Any] | None]:
        """Return what is packed, and what provenance says of the clump; None where there is none."""
        if self.clump is None:
            return self.make(), None
        clump = fit_clump(self.make(), **self.clump)
        return clump.to_shape(), record_of(clump)


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneDescription:
    """A granular scene as its file describes it.

    Attributes
    ----------
    general : General
        Seed, unit and density.
    shapes : tuple of ShapeEntry
        Where the shapes come from, with their shares.
    sizes : SizeDistribution or None
        Equivalent diameters; None keeps each shape at its own size.
    share_by : {"number", "volume"}
        What the shares are of.
    container : Container
        What holds the grains.
    method : str
        Packing method.
    count, solid_fraction : int or float or None
        How many grains.
    start : str or None
        File of the packing whose grains are there from the beginning.
    parameters : mapping
        Parameters of the method.
    settle : Settling or bool or None
        How the grains settle afterwards; False if they do not, None as the method does by default.
    material : Material
        Contact law of the grains in the input of engines.
    which : tuple of str or None
        Measures; None for all.
    output : Output
        What is written.
    """

    general: General
    shapes: tuple[ShapeEntry, ...]
    sizes: SizeDistribution | None
    share_by: str
    container: Container
    method: str
    count: int | None
    solid_fraction: float | None
    start: str | None
    parameters: Mapping[str, Any]
    settle: Settling | Literal[False] | None = None
    material: Material = Material()  # noqa: RUF009
    which: tuple[str, ...] | None
    output: Output

    @classmethod
    def from_toml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a scene file; files that it names are relative to it.

        Parameters
        ----------
        path : path-like
            TOML file.

        Returns
        -------
        Scene

        Raises
        ------
        MissingFileError
            If there is no such file.
        FileFormatError
            If it is not TOML.
        UnknownNameError
            If a section, key, method or family is unknown; the message gives the nearest name.
        InputError
            If a value is missing or breaks a rule.
        """
        found = existing_file(path)
        if found.suffix.lower() == ".vtp":
            raise FileFormatError(f"{found} is a packing and no scene: give the .toml file, or 'voxgran measure' it")
        try:
            mapping = tomllib.loads(found.read_text(encoding="utf-8"))
        except (ValueError, RecursionError) as error:
            # a number of too many digits is a bare ValueError, values in too many brackets are a RecursionError
            raise FileFormatError(f"{found} is not TOML ({reason_of(error)}): mend that line") from error
        return cls.from_mapping(mapping, folder=found.parent)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], *, folder: str | os.PathLike[str] = ".") -> Self:
        """Make a scene from nested mappings, as TOML gives them.

        Parameters
        ----------
        mapping : mapping
            Sections by name.
        folder : path-like
            Where the files that it names are looked for.

        Returns
        -------
        Scene

        Raises
        ------
        UnknownNameError
            If a section, key, method or family is unknown; the message gives the nearest name.
        InputError
            If a value is missing or breaks a rule.
        """
        check_type(mapping, Mapping, "scene", "a mapping of sections; for a file use Scene.from_toml")
        for name in mapping:
            if name not in SECTIONS:
                raise UnknownNameError(unknown("section", name, SECTIONS))
            if name != "shape":
                check_type(mapping[name], Mapping, f"[{name}]", f"a section; write [{name}] above its keys")
        for name in ("shape", "container", "packing"):
            if name not in mapping:
                raise InputError(f"[{name}] is missing: a scene needs this section; add it")
        place = Path(folder)
        sizes = dict(mapping.get("sizes", {}))
        share_by = sizes.pop("share_by", "number")
        packing = dict(mapping["packing"])
        method = packing.pop("method", None)
        if method is None:
            known = ", ".join(method_registry().names())
            raise InputError(f"[packing] has no method: a scene is packed by one; add method, one of {known}")
        count, solid = packing.pop("count", None), packing.pop("solid_fraction", None)
        start = packing.pop("start", None)
        beside = ("method", "count", "solid_fraction", "start")
        if "settle" in packing:
            raise UnknownNameError(f"[packing] settle is no key: {SETTLE_KEYS}")
        output: Output = from_mapping(Output, mapping.get("output", {}), "[output]")
        material: Material = from_mapping(Material, mapping.get("material", {}), "[material]")
        parameters = method_registry().get(method).parameters
        packing = _present(parameters, packing, "[packing]", beside=beside)
        container = make_container(_with_file(mapping["container"], place))
        for engine in output.dem:
            refuse_unheld(engine_registry().get(engine), material, container)
        return cls(
            general=_general(mapping.get("scene", {})),
            shapes=_shape_entries(mapping["shape"], place),
            sizes=make_sizes(sizes) if sizes else None,
            share_by=_share_by(share_by),
            container=container,
            method=str(method),
            count=None if count is None else as_count(count, "[packing] count", at_most=None),
            solid_fraction=None if solid is None else as_number(solid, "[packing] solid_fraction", above=0, at_most=1),
            start=None if start is None else str(existing_file(place / str(start))),
            parameters=packing,
            settle=_settle(mapping.get("settle"), str(method), parameters, container),
            which=_which(mapping.get("measure", {})),
            material=material,
            output=output,
        )

    def to_mapping(self) -> dict[str, Any]:
        """Return the scene as nested JSON-able values, from which :meth:`from_mapping` makes it again."""
        shapes = [
            {entry.source: entry.name, "share": entry.share, **entry.parameters}
            | ({} if entry.clump is None else {"clump": dict(entry.clump)})
            for entry in self.shapes
        ]
        packing = {name: getattr(self, name) for name in ("method", "count", "solid_fraction", "start")}
        made = {
            "scene": to_mapping(self.general),
            "shape": shapes,
            "container": self.container.to_mapping(),
            "packing": {key: value for key, value in packing.items() if value is not None} | dict(self.parameters),
            "output": to_mapping(self.output),
        }
        if self.sizes is not None:
            kept = {key: value for key, value in self.sizes.to_mapping().items() if value is not None}
            made["sizes"] = kept | {"share_by": self.share_by}
        if self.settle is not None:
            given = to_mapping(self.settle) if self.settle else {"enabled": False}
            made["settle"] = {key: value for key, value in given.items() if value is not None}
        if self.material != Material():
            made["material"] = {key: value for key, value in to_mapping(self.material).items() if value is not None}
        if self.which is not None:
            made["measure"] = {"which": list(self.which)}
        return made

    def asked(self) -> dict[str, Any]:
        """Return the keyword arguments of :func:`voxgran.pack`, without the parameters of the method."""
        return {
            "method": self.method,
            "count": self.count,
            "solid_fraction": self.solid_fraction,
            "sizes": self.sizes,
            "weights": [entry.share for entry in self.shapes],
            "weights_by": self.share_by,
            "seed": self.general.seed,
            "start": self.begin(),
            "unit": self.general.unit,
            "density": self.general.density,
            "settle": self.settle,
        }

    def begin(self) -> Packing | None:
        """Return the packing whose grains are there from the beginning, read from its file; None where there is none.

        Raises
        ------
        FileFormatError
            If the file is no packing.
        """
        return None if self.start is None else load(self.start)


def _present(cls: type[Any], mapping: Mapping[str, Any], where: str, *, beside: Iterable[str] = ()) -> dict[str, Any]:
    """Return checked parameters as given, with present names and words in place of former ones, so that they are not
    warned of again.
    """
    made: Any = from_mapping(cls, mapping, where, beside=beside)
    present = {item.former: item.name for item in parameters_of(cls) if item.former}
    found = {present.get(key, key): value for key, value in mapping.items()}
    return {key: getattr(made, key) if isinstance(value, str) else value for key, value in found.items()}


def _settle(
    mapping: Mapping[str, Any] | None, method: str, parameters: type, container: Container
) -> Settling | Literal[False] | None:
    """Return what the section [settle] says: parameters, False where it is disabled, None where it is left out."""
    if mapping is None:
        return None
    given = dict(mapping)
    enabled = given.pop("enabled", True)
    if not isinstance(enabled, bool):
        raise InputError(f"[settle] enabled is {shown(enabled)}: it must be true or false; change it")
    if issubclass(parameters, Settling):
        raise InputError(
            f"[settle] and method {method!r}: its grains settle as they are packed; write these keys in [packing]"
        )
    if enabled and not any(item.name == "gravity" for item in parameters_of(parameters)):
        raise InputError(
            f"[settle] and method {method!r}: it packs without gravity; leave this section out, and settle the packing "
            f"with 'voxgran settle out/packing.vtp --gravity {proposed_axis(container)} -o settled.vtp'"
        )
    settling = from_mapping(Settling, given, "[settle]", beside=("enabled",))
    return settling if enabled else False


def _general(mapping: Mapping[str, Any]) -> General:
    """Return the checked section [scene]."""
    made = from_mapping(General, mapping, "[scene]")
    as_count(made.seed, "[scene] seed", at_most=None)
    as_count(made.seeds, "[scene] seeds", at_least=1)
    as_positive(made.density, "[scene] density")
    return replace(made, unit=as_unit(made.unit, "[scene] unit"))


def _share_by(value: Any) -> str:
    """Return the checked share_by."""
    if value not in ("number", "volume"):
        raise InputError(f"[sizes] share_by is {shown(value)}: it must be 'number' or 'volume'; change it")
    return str(value)


def _which(mapping: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Return the names of the measures that are asked for."""
    from voxgran.measures.model import measure_registry

    for key in mapping:
        if key != "which":
            raise UnknownNameError(unknown("[measure] key", key, ("which",)))
    if "which" not in mapping:
        return None
    check_type(mapping["which"], (list, tuple), "[measure] which", "a list of names, such as ['density']")
    names = tuple(str(name) for name in mapping["which"])
    known = measure_registry().names()
    for name in names:
        if name not in known:
            raise UnknownNameError(unknown("[measure] which", name, known))
    return names


def _with_file(mapping: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a section with its file relative to the scene file."""
    made = dict(mapping)
    if "file" in made:
        made["file"] = str(folder / str(made["file"]))
    return made


def _shape_entries(entries: Any, folder: Path) -> tuple[ShapeEntry, ...]:
    """Return the checked [[shape]] entries."""
    if not isinstance(entries, list) or not entries:
        kind = "one table" if isinstance(entries, Mapping) else shown(entries)
        raise InputError(f"[shape] is {kind}: write [[shape]], once per shape")
    made = []
    for entry in entries:
        check_type(entry, Mapping, "[[shape]]", "a section; write [[shape]] above its keys")
        rest = dict(entry)
        share = as_number(rest.pop("share", 1.0), "[[shape]] share", at_least=0.0)
        clump = _clump(rest.pop("clump")) if "clump" in rest else None
        if ("file" in rest) == ("family" in rest):
            meant = next((key for key in entry if key not in SHAPE_KEYS and nearest(key, ("file", "family"))), None)
            if meant is not None:
                raise UnknownNameError(unknown("[[shape]] key", meant, SHAPE_KEYS))
            raise InputError(f"[[shape]] has the keys {', '.join(entry)}: give either file or family")
        if "file" in rest:
            path = folder / str(rest.pop("file"))
            for key, value in rest.items():
                if key not in FILE_KEYS:
                    raise UnknownNameError(unknown("[[shape]] key", key, FILE_KEYS))
                if key == "unit":
                    as_unit(value, "[[shape]] unit")
                elif not isinstance(value, bool):
                    raise InputError(f"[[shape]] {key} is {shown(value)}: it must be true or false")
            if clump is not None and rest.get("surface"):
                raise InputError("[[shape]] has surface = true and clump: an open surface has no clump; leave one out")
            made.append(ShapeEntry("file", str(existing_file(path)), share, rest, clump))
            continue
        family = rest.pop("family")
        seed = {key: rest.pop(key) for key in ("seed",) if key in rest}
        settings = _present(families().get(family).parameters, rest, f"[[shape]] {family}", beside=("clump",))
        made.append(ShapeEntry("family", family, share, settings | seed, clump))
    return tuple(made)


def _clump(given: Any) -> dict[str, Any]:
    """Return the checked keywords of `fit_clump` that the key clump of a [[shape]] holds: a number of spheres, or a
    table.
    """
    where = "[[shape]] clump"
    if not isinstance(given, Mapping):
        return {"max_spheres": as_count(given, where, at_least=1)}
    rest = dict(given)
    beside = {key: rest.pop(key) for key in CLUMP_KEYS if key in rest}
    parameters = clump_registry().get(beside.get("method", "optimal")).parameters
    for key, least in (("max_spheres", 1), ("seed", 0)):
        if key in beside:
            as_count(beside[key], f"{where} {key}", at_least=least)
    if ("target" in beside) != ("value" in beside):
        missing = "value" if "target" in beside else "target"
        raise InputError(f"{where} has no {missing}: target and value belong together; give both, or max_spheres alone")
    if "target" in beside:
        as_choice(beside["target"], f"{where} target", TARGETS)
        as_number(beside["value"], f"{where} value", above=0.0, at_most=1.0)
    return beside | _present(parameters, rest, where, beside=CLUMP_KEYS)
