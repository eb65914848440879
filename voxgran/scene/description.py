"""Description of a granular scene, read from a TOML file and checked; nothing is planned or packed here."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import as_count, check_type
from voxgran._base.config import to_mapping
from voxgran._base.errors import InputError, UnknownNameError, check_known, nearest
from voxgran._base.files import existing_file
from voxgran.contacts.assembly import NOT_STATED
from voxgran.containers.model import Container
from voxgran.geometry.orientation_laws.law import OrientationLaw
from voxgran.geometry.orientations import make_orientations
from voxgran.io.files import load
from voxgran.packing.method import method_registry
from voxgran.packing.model import Packing
from voxgran.scene.checked_sections import (
    container_section,
    general_section,
    measure_section,
    read_toml,
    refuse_engines,
    section_of,
    sections_of_packed,
    sizes_section,
)
from voxgran.scene.entries import (
    ALONE_IN_PACKING,
    LayerEntry,
    ShapeEntry,
    given_parameters,
    given_values,
    layer_entries,
    material_entries,
    material_section,
    shape_entries,
    together,
    with_densities,
    with_material_densities,
)
from voxgran.scene.keys import Listed, Mistakes, Packed, names_of, refuse_unknown
from voxgran.scene.obstacles import ObstacleEntry, obstacle_entries, standing_of
from voxgran.scene.sections import General, Output
from voxgran.scene.twins.section import TwinEntry, twin_scene
from voxgran.settling.material import Material
from voxgran.settling.materials import Materials
from voxgran.settling.parameters import Compression, Settling, as_solid_fraction
from voxgran.shapes.sizes import SizeDistribution

SECTIONS = (
    *("scene", "shape", "sizes", "orientations", "grains", "layer", "container", "obstacle"),
    *("packing", "settle", "compress", "twin", "material", "measure", "output"),
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
    orientations : OrientationLaw or None
        Orientations of the grains; None for random ones.
    grains : str or None
        File of a list of grains, each placed once.
    layers : tuple of LayerEntry
        Layers that are packed one after the other, of which `shapes` has all shapes; none for one packing.
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
    twin : TwinEntry or None
        What the grains are a twin of, which says the method, count and solid fraction.
    material : Material or Materials
        Contact law of the grains in the input of engines; several also give the friction of grains that settle.
    which : tuple of str or None
        Measures; None for all.
    output : Output
        What is written.
    """

    general: General
    shapes: tuple[ShapeEntry, ...]
    sizes: SizeDistribution | None
    orientations: OrientationLaw | None = None
    grains: str | None = None
    layers: tuple[LayerEntry, ...] = ()
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
    twin: TwinEntry | None = None
    material: Material | Materials = Material()  # noqa: RUF009
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
        if "twin" in mapping:
            return cls(**twin_scene(mapping, Path(folder)))
        place, mistakes, shapes, walls = Path(folder), Mistakes(), tuple[ShapeEntry, ...](), None
        parameters: type | None = None
        container: Container | None = None
        method, friction = "", dict[str, Any]()
        with mistakes.part():
            general = general_section(mapping.get("scene", {}))
        with mistakes.part():
            shapes = shape_entries(mapping["shape"], place) if "shape" in mapping else shapes
        with mistakes.part("[sizes]"):
            law, share_by = sizes_section(mapping, place)
        with mistakes.part():
            oriented = _orientations(mapping)
            grains = _grains(mapping.get("grains"), place)
        with mistakes.part("[container]"):
            container, walls = container_section(mapping["container"], place)
            obstacles = obstacle_entries(mapping.get("obstacle", ()), place, container.dimension)
        with mistakes.part():
            packing = dict(mapping["packing"])
            method, parameters, given = _method(packing)
            packed = _packed(packing, place)
            layers = layer_entries(mapping, place, parameters)
            if layers:
                shapes, packed["count"], given = together(layers, given)
        with mistakes.part():
            # names of materials are told where all else can be read
            if not isinstance(section := mapping.get("material", {}), list) or not mistakes.found:
                material = material_section(section, shapes, walls)
                friction = {} if isinstance(material, Material) else {"friction": material}
        with mistakes.part():
            which = measure_section(mapping.get("measure", {}))
        with mistakes.part():
            output: Output = section_of(Output, mapping.get("output", {}), "[output]")
        settle, compress = sections_of_packed(mapping, mistakes, (method, parameters, container, friction))
        mistakes.refuse()
        assert parameters is not None
        assert container is not None
        refuse_engines(output, material, container)
        return cls(
            general=general,
            shapes=with_densities(with_material_densities(shapes, material), general.density),
            sizes=law,
            orientations=oriented,
            grains=grains,
            layers=layers,
            share_by=share_by,
            container=container,
            obstacles=obstacles,
            method=method,
            parameters=(friction if issubclass(parameters, Settling | Compression) else {}) | given,
            settle=settle,
            compress=compress,
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
        names = ("method", "count", "solid_fraction", "start")
        packing = {name: value for name in names if (value := getattr(self, name)) is not None}
        made: dict[str, Any] = {
            "scene": to_mapping(self.general),
            "container": self.container.to_mapping(),
            "packing": packing | given_parameters(self.parameters),
            "output": to_mapping(self.output),
        }
        if self.twin is not None:
            made["twin"] = dict(self.twin.given)
            for name in ("packing", *(() if self.twin.held else ("container",))):
                del made[name]
        if self.obstacles:
            made["obstacle"] = [entry.to_mapping() for entry in self.obstacles]
        if self.layers:
            made["layer"] = [layer.to_mapping() for layer in self.layers]
            made["packing"] = {key: value for key, value in made["packing"].items() if key not in ALONE_IN_PACKING}
        elif self.shapes:
            made["shape"] = [entry.to_mapping() for entry in self.shapes]
        if self.sizes is not None:
            kept = {key: value for key, value in self.sizes.to_mapping().items() if value is not None}
            made["sizes"] = kept | {"share_by": self.share_by}
        elif self.share_by != "number":
            made["sizes"] = {"share_by": self.share_by}
        if self.orientations is not None:
            made["orientations"] = self.orientations.to_mapping()
        if self.grains is not None:
            made["grains"] = {"file": self.grains}
        if self.settle is not None:
            given = to_mapping(self.settle) if self.settle else {"enabled": False}
            made["settle"] = {key: value for key, value in given.items() if value is not None}
        if self.compress is not None:
            made["compress"] = {key: value for key, value in to_mapping(self.compress).items() if value is not None}
        if self.material != Material():
            made["material"], walls = material_entries(self.material)
            made["container"] |= {} if walls is None else {"material": walls}
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
            # methods have a parameter of this name
            **({} if self.orientations is None else {"orientations": self.orientations}),
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


def _check_sections(mapping: Mapping[str, Any]) -> None:
    """Refuse sections that are unknown, missing or no sections."""
    check_type(mapping, Mapping, "scene", "a mapping of sections; for a file use Scene.from_toml")
    mistakes = Mistakes()
    for name in mapping:
        with mistakes.part():
            check_known("section", name, SECTIONS)
            if name not in ("shape", "layer", "obstacle") and not (
                name == "material" and isinstance(mapping[name], list) and mapping[name]
            ):
                check_type(mapping[name], Mapping, f"[{name}]", f"a section; write [{name}] above its keys")
    mistakes.refuse()  # a section that is missing may be there under a wrong name
    # grains of a list are spheres, or disks, where there is no shape
    needed = (*(() if "grains" in mapping or "layer" in mapping else ("shape",)), "container", "packing")
    for name in needed if "twin" not in mapping else ():
        with mistakes.part():
            if name not in mapping:
                told = "[[shape]]" if name == "shape" else f"[{name}]"
                raise InputError(f"{told} is missing: a scene needs this section; add it")
    mistakes.refuse()


def _method(packing: Mapping[str, Any]) -> tuple[str, type, dict[str, Any]]:
    """Return the method that [packing] names, the class of its parameters and those that are given."""
    if packing.get("method") is None:
        known, near = ", ".join(method_registry().names()), nearest("method", packing)
        other = f" but {near!r}" if near else ""
        raise InputError(f"[packing] has no method{other}: a scene is packed by one; add method, one of {known}")
    if "settle" in packing:
        raise UnknownNameError(f"[packing] settle is no key: {SETTLE_KEYS}")
    parameters, beside = method_registry().get(packing["method"]).parameters, names_of(Packed)
    own = {key: value for key, value in packing.items() if key not in beside}
    refuse_unknown(own, "[packing]", parameters, beside=beside)
    return str(packing["method"]), parameters, given_values(parameters, own, "[packing]")


def _packed(packing: Mapping[str, Any], place: Path) -> dict[str, Any]:
    """Return how many grains [packing] asks for, and the file that it starts from."""
    count, start = packing.get("count"), packing.get("start")
    return {
        "count": None if count is None else as_count(count, "[packing] count", at_most=None),
        "solid_fraction": as_solid_fraction(
            packing.get("solid_fraction"), packing.get("porosity"), packing.get("void_ratio"), where="[packing] "
        ),
        "start": None if start is None else str(existing_file(place / str(start))),
    }


def _orientations(mapping: Mapping[str, Any]) -> OrientationLaw | None:
    """Return the distribution of the section [orientations]; None without the section."""
    if "orientations" not in mapping:
        return None
    if "orientations" in mapping["packing"]:
        raise InputError(
            "[orientations] and [packing] orientations: grains keep those that are drawn for them; leave out one of "
            "the two"
        )
    return make_orientations(mapping["orientations"])


def _grains(mapping: Mapping[str, Any] | None, place: Path) -> str | None:
    """Return the file of the section [grains]; None without the section."""
    return None if mapping is None else str(existing_file(place / section_of(Listed, mapping, "[grains]").file))
