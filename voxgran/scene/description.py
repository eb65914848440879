"""Description of a granular scene, read from a TOML file and checked; nothing is planned or packed here."""

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import as_count, as_positive, as_share, check_type
from voxgran._base.config import from_mapping, to_mapping
from voxgran._base.errors import FileFormatError, InputError, UnknownNameError, shown
from voxgran._base.files import existing_file
from voxgran._base.guarded import reason_of
from voxgran._base.names import unknown
from voxgran._base.units import as_unit
from voxgran.contacts.assembly import NOT_STATED
from voxgran.containers.make import make_container
from voxgran.containers.model import Container
from voxgran.decks.engine import engine_registry
from voxgran.decks.material import Material
from voxgran.decks.write import refuse_unheld
from voxgran.io.files import load
from voxgran.packing.method import method_registry
from voxgran.packing.model import Packing
from voxgran.scene.afterwards import compress_section, settle_section
from voxgran.scene.keys import Listed, Measured, Packed, names_of
from voxgran.scene.mistakes import Mistakes, refuse_unknown
from voxgran.scene.obstacles import ObstacleEntry, obstacle_entries, standing_of
from voxgran.scene.sections import General, Output
from voxgran.scene.shape_entries import ShapeEntry, given_values, shape_entries, with_densities
from voxgran.settling.compression_parameters import Compression
from voxgran.settling.parameters import Settling
from voxgran.shapes.sizes import SizeDistribution, make_sizes

T = TypeVar("T")

SECTIONS = (
    "scene",
    "shape",
    "sizes",
    "grains",
    "container",
    "obstacle",
    "packing",
    "settle",
    "compress",
    "material",
    "measure",
    "output",
)
#: where a scene says whether and how its grains settle
SETTLE_KEYS = "a section [settle] says how grains settle; with enabled = false in it they do not"


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneDescription(ExplainedAttributes):
    """A granular scene as its file describes it.

    Attributes
    ----------
    general : General
        Seed, unit and density.
    shapes : tuple of ShapeEntry
        Where the shapes come from, with their shares.
    sizes : SizeDistribution or None
        Equivalent diameters; None keeps each shape at its own size.
    grains : str or None
        File of a list of grains, each placed once.
    share_by : {"number", "volume"}
        What the shares are of.
    container : Container
        What holds the grains.
    obstacles : tuple of ObstacleEntry
        What stands in it.
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
    compress : Compression or None
        How the grains are compressed then; None if they are not.
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
    grains: str | None = None
    share_by: str
    container: Container
    obstacles: tuple[ObstacleEntry, ...] = ()
    method: str
    count: int | None
    solid_fraction: float | None
    start: str | None
    parameters: Mapping[str, Any]
    settle: Settling | Literal[False] | None = None
    compress: Compression | None = None
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

        Examples
        --------
        >>> import voxgran as vg
        >>> with open("scene.toml", "w") as file:
        ...     print('shape = [{family = "sphere"}]', file=file)
        ...     print('container = {kind = "box", lengths = [4, 4, 4]}', file=file)
        ...     print('packing = {method = "rsa", count = 10}', file=file)
        >>> vg.Scene.from_toml("scene.toml").count
        10
        """
        found = existing_file(path)
        return cls.from_mapping(read_toml(found), folder=found.parent)

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

        Examples
        --------
        >>> import voxgran as vg
        >>> shape, box = [{"family": "sphere"}], {"kind": "box", "lengths": [4, 4, 4]}
        >>> packing = {"method": "rsa", "count": 10}
        >>> scene = vg.Scene.from_mapping({"shape": shape, "container": box, "packing": packing})
        >>> scene.container.volume
        64.0
        """
        _check_sections(mapping)
        place, mistakes = Path(folder), Mistakes()
        with mistakes.part():
            general = _general(mapping.get("scene", {}))
        with mistakes.part():
            shapes = shape_entries(mapping["shape"], place) if "shape" in mapping else ()
        with mistakes.part("[sizes]"):
            sizes = dict(mapping.get("sizes", {}))
            share_by = _share_by(sizes.pop("share_by", "number"))
            if "file" in sizes and (unit := dict(mapping.get("scene", {})).get("unit")) is not None:
                sizes.setdefault("unit", unit)
            law = make_sizes(_with_file(sizes, place)) if sizes else None
        with mistakes.part():
            grains = _grains(mapping.get("grains"), place)
        with mistakes.part("[container]"):
            container = make_container(_with_file(mapping["container"], place))
            obstacles = obstacle_entries(mapping.get("obstacle", ()), place, container.dimension)
        with mistakes.part():
            packing = dict(mapping["packing"])
            method, parameters, given = _method(packing)
            packed = _packed(packing, place)
        with mistakes.part():
            material: Material = _section(Material, mapping.get("material", {}), "[material]")
        with mistakes.part():
            which = _which(mapping.get("measure", {}))
        with mistakes.part():
            output: Output = _section(Output, mapping.get("output", {}), "[output]")
        mistakes.refuse()
        for engine in output.dem:
            refuse_unheld(engine_registry().get(engine), material, container)
        return cls(
            general=general,
            shapes=with_densities(shapes, general.density),
            sizes=law,
            grains=grains,
            share_by=share_by,
            container=container,
            obstacles=obstacles,
            method=method,
            parameters=given,
            settle=settle_section(mapping.get("settle"), method, parameters, container),
            compress=compress_section(mapping.get("compress"), container),
            which=which,
            material=material,
            output=output,
            **packed,
        )

    def to_mapping(self) -> dict[str, Any]:
        """Return the scene as nested JSON-able values, from which :meth:`from_mapping` makes it again.

        Examples
        --------
        >>> import voxgran as vg
        >>> shape, box = [{"family": "sphere"}], {"kind": "box", "lengths": [4, 4, 4]}
        >>> packing = {"method": "rsa", "count": 10}
        >>> scene = vg.Scene.from_mapping({"shape": shape, "container": box, "packing": packing})
        >>> scene.to_mapping()["packing"]["method"]
        'rsa'
        """
        packing = {name: getattr(self, name) for name in ("method", "count", "solid_fraction", "start")}
        made: dict[str, Any] = {
            "scene": to_mapping(self.general),
            "container": self.container.to_mapping(),
            "packing": {key: value for key, value in packing.items() if value is not None} | dict(self.parameters),
            "output": to_mapping(self.output),
        }
        if self.obstacles:
            made["obstacle"] = [entry.to_mapping() for entry in self.obstacles]
        if self.shapes:
            made["shape"] = [entry.to_mapping() for entry in self.shapes]
        if self.sizes is not None:
            kept = {key: value for key, value in self.sizes.to_mapping().items() if value is not None}
            made["sizes"] = kept | {"share_by": self.share_by}
        elif self.share_by != "number":
            made["sizes"] = {"share_by": self.share_by}
        if self.grains is not None:
            made["grains"] = {"file": self.grains}
        if self.settle is not None:
            given = to_mapping(self.settle) if self.settle else {"enabled": False}
            made["settle"] = {key: value for key, value in given.items() if value is not None}
        if self.compress is not None:
            made["compress"] = {key: value for key, value in to_mapping(self.compress).items() if value is not None}
        if self.material != Material():
            made["material"] = {key: value for key, value in to_mapping(self.material).items() if value is not None}
        if self.which is not None:
            made["measure"] = {"which": list(self.which)}
        return made

    def asked(self) -> dict[str, Any]:
        """Return the keyword arguments of :func:`voxgran.pack`, without the parameters of the method.

        Examples
        --------
        >>> import voxgran as vg
        >>> shape, box = [{"family": "sphere"}], {"kind": "box", "lengths": [4, 4, 4]}
        >>> packing = {"method": "rsa", "count": 10}
        >>> scene = vg.Scene.from_mapping({"shape": shape, "container": box, "packing": packing})
        >>> scene.asked()["count"]
        10
        """
        return {
            "method": self.method,
            "count": self.count,
            "solid_fraction": self.solid_fraction,
            "sizes": self.sizes,
            "grains": self.grains,
            "weights": [share for entry in self.shapes for share in entry.shares()] or None,
            "weights_by": self.share_by,
            "seed": self.general.seed,
            "start": self.begin(),
            "obstacles": standing_of(self.obstacles, self.container, self.general.unit),
            "unit": self.general.unit,
            "density": self.density(),
            "settle": self.settle,
        }

    def density(self) -> float | list[float] | None:
        """Return the density of the grains as :func:`voxgran.pack` takes it: that of [scene], or one for each shape.

        It is None where neither [scene] nor a [[shape]] states one, so that grains of a start keep theirs.

        Examples
        --------
        >>> import voxgran as vg
        >>> shapes = [{"family": "sphere", "density": 7800}, {"family": "sphere", "density": 2500}]
        >>> box, packing = {"kind": "box", "lengths": [4, 4, 4]}, {"method": "rsa", "count": 10}
        >>> vg.Scene.from_mapping({"shape": shapes, "container": box, "packing": packing}).density()
        [7800.0, 2500.0]
        """
        usual = None if self.general.density == NOT_STATED else self.general.density
        own = [usual if entry.density is None else entry.density for entry in self.shapes for _ in entry.shares()]
        known = [one for one in own if one is not None]
        return known if any(entry.density is not None for entry in self.shapes) else usual

    def begin(self) -> Packing | None:
        """Return the packing whose grains are there from the beginning, read from its file; None where there is none.

        Raises
        ------
        FileFormatError
            If the file is no packing.

        Examples
        --------
        >>> import voxgran as vg
        >>> shape, box = [{"family": "sphere"}], {"kind": "box", "lengths": [4, 4, 4]}
        >>> packing = {"method": "rsa", "count": 10}
        >>> scene = vg.Scene.from_mapping({"shape": shape, "container": box, "packing": packing})
        >>> scene.begin() is None
        True
        """
        return None if self.start is None else load(self.start)


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what a TOML file holds, as nested mappings.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is not TOML.
    """
    found = existing_file(path)
    if found.suffix.lower() == ".vtp":
        raise FileFormatError(f"{found} is a packing and no scene: give the .toml file, or 'voxgran measure' it")
    try:
        return tomllib.loads(found.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        # a number of too many digits is a bare ValueError, values in too many brackets are a RecursionError
        mend = "mend that line; text is written in quotes, flags are true and false"
        raise FileFormatError(f"{found} is not TOML ({reason_of(error)}): {mend}") from error


def _check_sections(mapping: Mapping[str, Any]) -> None:
    """Refuse sections that are unknown, missing or no sections."""
    check_type(mapping, Mapping, "scene", "a mapping of sections; for a file use Scene.from_toml")
    mistakes = Mistakes()
    for name in mapping:
        with mistakes.part():
            if name not in SECTIONS:
                raise UnknownNameError(unknown("section", name, SECTIONS))
            if name not in ("shape", "obstacle"):
                check_type(mapping[name], Mapping, f"[{name}]", f"a section; write [{name}] above its keys")
    mistakes.refuse()  # a section that is missing may be there under a wrong name
    # grains of a list are spheres, or disks, where there is no shape
    for name in (*(() if "grains" in mapping else ("shape",)), "container", "packing"):
        with mistakes.part():
            if name not in mapping:
                told = "[[shape]]" if name == "shape" else f"[{name}]"
                raise InputError(f"{told} is missing: a scene needs this section; add it")
    mistakes.refuse()


def _method(packing: Mapping[str, Any]) -> tuple[str, type, dict[str, Any]]:
    """Return the method that [packing] names, the class of its parameters and those that are given."""
    if packing.get("method") is None:
        known = ", ".join(method_registry().names())
        raise InputError(f"[packing] has no method: a scene is packed by one; add method, one of {known}")
    if "settle" in packing:
        raise UnknownNameError(f"[packing] settle is no key: {SETTLE_KEYS}")
    parameters, beside = method_registry().get(packing["method"]).parameters, names_of(Packed)
    own = {key: value for key, value in packing.items() if key not in beside}
    refuse_unknown(own, "[packing]", parameters, beside=beside)
    return str(packing["method"]), parameters, given_values(parameters, own, "[packing]")


def _packed(packing: Mapping[str, Any], place: Path) -> dict[str, Any]:
    """Return how many grains [packing] asks for, and the file that it starts from."""
    count, solid, start = (packing.get(key) for key in ("count", "solid_fraction", "start"))
    return {
        "count": None if count is None else as_count(count, "[packing] count", at_most=None),
        "solid_fraction": None if solid is None else as_share(solid, "[packing] solid_fraction"),
        "start": None if start is None else str(existing_file(place / str(start))),
    }


def _grains(mapping: Mapping[str, Any] | None, place: Path) -> str | None:
    """Return the file of the section [grains]; None without the section."""
    return None if mapping is None else str(existing_file(place / _section(Listed, mapping, "[grains]").file))


def _section(cls: type[T], mapping: Mapping[str, Any], place: str) -> T:
    """Return a section that holds the parameters of a class and nothing else."""
    refuse_unknown(mapping, place, cls)
    return from_mapping(cls, mapping, place)


def _general(mapping: Mapping[str, Any]) -> General:
    """Return the checked section [scene]."""
    made = _section(General, mapping, "[scene]")
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
    """Return the names of the measures that are asked for; "all" may be among them."""
    from voxgran.measures.model import ALL, measure_registry

    refuse_unknown(mapping, "[measure]", Measured)
    if "which" not in mapping:
        return None
    check_type(mapping["which"], (list, tuple), "[measure] which", "a list of names, such as ['density']")
    names = tuple(str(name) for name in mapping["which"])
    known = (ALL, *measure_registry().names())
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
