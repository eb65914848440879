"""Registries that find what they hold: one file, one entry.

A registry looks in one package and in the packages inside it: the file ``digital.py`` that holds a module-level
`registration` is the entry ``"digital"``. Files are imported when they are asked for, never before. Third parties add
entries through an entry-point group, whose values point at such a registration.

The messages for names that are unknown are made here too: of entries, keys, modules and attributes.
"""

import difflib
import importlib
import importlib.metadata
import pkgutil
import sys
from collections.abc import Iterable
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from voxgran._base.errors import InputError, UnknownNameError, shown

T = TypeVar("T")


class Registry(Generic[T]):
    """Entries of one kind: of the files of a package and of an entry-point group; each is an instance of `entry`.

    In messages an entry is called `kind`, such as ``"packing method"``.
    """

    def __init__(self, kind: str, package: str, entry: type[T], *, group: str) -> None:
        self.kind = kind
        self.package = package
        self.entry = entry
        self.group = group

    def names(self) -> tuple[str, ...]:
        """Return the names of all entries, in alphabetical order; nothing is imported but the package."""
        return tuple(sorted({*self._files(), *self._foreign()}))

    def get(self, name: str) -> T:
        """Return the entry of that name.

        Raises
        ------
        UnknownNameError
            If there is none; the message gives the nearest name.
        InputError
            If the file or entry point does not hold a registration of the right class.
        """
        if not isinstance(name, str):
            raise UnknownNameError(unknown(self.kind, name, self.names()))
        files = self._files()
        if name in files:
            module = importlib.import_module(files[name])
            found = getattr(module, "registration", None)
        elif name in self._foreign():
            found = self._foreign()[name].load()
        else:
            raise UnknownNameError(unknown(self.kind, name, self.names()))
        if not isinstance(found, self.entry):
            raise InputError(
                f"{self.kind} {name!r} is {found!r}: its file must hold 'registration = "
                f"{self.entry.__name__}(...)'; add that line"
            )
        return found

    def _files(self) -> dict[str, str]:
        """Return the public modules of the package and of those inside it: names of files, and of modules."""
        found: dict[str, str] = {}
        for package in (self.package, *_modules_of(self.package, packages=True)):
            names = _modules_of(package, packages=False)
            found |= {name: module for module in names if not (name := module.rpartition(".")[2]).startswith("_")}
        return found

    def _foreign(self) -> dict[str, importlib.metadata.EntryPoint]:
        """Return the entry points of third parties."""
        return {point.name: point for point in _entry_points(self.group, tuple(sys.path))}


@lru_cache(maxsize=16)
def _entry_points(group: str, places: tuple[str, ...]) -> tuple[importlib.metadata.EntryPoint, ...]:
    """Return the entry points of a group, which are looked for once in the places where libraries are found."""
    del places
    return tuple(importlib.metadata.entry_points(group=group))


@cache
def _modules_of(package: str, *, packages: bool) -> tuple[str, ...]:
    """Return the full names of the modules or of the packages in a package, whose folder is read once a process."""
    found = pkgutil.iter_modules(importlib.import_module(package).__path__)
    return tuple(f"{package}.{one.name}" for one in found if one.ispkg == packages)


#: words that people type for a name of ours, as other programs have it; the first that is known is suggested
SYNONYMS: dict[str, tuple[str, ...]] = {
    "array": ("values",),
    "ball": ("sphere",),
    "center_of_mass": ("centroid",),
    "centers": ("position",),
    "centres": ("centers", "position"),
    "circle": ("disk",),
    "clump": ("fit_clump",),
    "com": ("centroid",),
    "contact_number": ("coordination", "measure"),
    "contacts": ("coordination", "measure"),
    "coordination": ("measure",),
    "cube": ("box",),
    "cuboid": ("box",),
    "data": ("values",),
    "decimate": ("simplify",),
    "density": ("solid_fraction", "measure"),
    "diameter": ("radius",),
    "dtype": ("values",),
    "export": ("write_deck",),
    "fill": ("pack",),
    "generate": ("pack", "make_shape"),
    "gradation": ("sizes",),
    "grading": ("gradation",),
    "grain_size": ("gradation",),
    "html": ("report",),
    "image": ("load_image", "to_image"),
    "imread": ("load_image",),
    "info": ("describe",),
    "kind": ("family",),
    "length": ("lengths", "height"),
    "load_ct": ("load_image",),
    "load_mesh": ("load_shape",),
    "load_tiff": ("load_image",),
    "mass": ("masses",),
    "mass_density": ("density",),
    "mean": ("median",),
    "mesh": ("load_shape",),
    "n": ("count", "max_spheres"),
    "n_grains": ("count",),
    "n_spheres": ("count", "max_spheres"),
    "num": ("count",),
    "number": ("count",),
    "open": ("load",),
    "open_image": ("load_image",),
    "pack": ("run",),
    "packing_fraction": ("solid_fraction", "density"),
    "pair_correlation": ("rdf", "measure"),
    "passed": ("ok",),
    "pore_size": ("voids", "measure"),
    "pore_size_distribution": ("voids", "measure"),
    "pore_sizes": ("voids", "measure"),
    "pores": ("voids", "measure"),
    "porosity": ("solid_fraction", "density", "measure"),
    "positions": ("position",),
    "profile": ("measure",),
    "psd": ("gradation",),
    "radial_distribution": ("rdf", "measure"),
    "radii": ("diameters",),
    "read": ("load",),
    "read_mesh": ("load_shape",),
    "read_stl": ("load_shape",),
    "read_tiff": ("load_image",),
    "reduce": ("simplify",),
    "remesh": ("simplify",),
    "segment": ("labels",),
    "shake": ("settle",),
    "shape": ("make_shape", "values"),
    "show": ("plot",),
    "simulate": ("settle", "relax"),
    "size": ("lengths", "diameter"),
    "sizes": ("diameters",),
    "solid_fraction": ("density",),
    "spheres": ("clump", "max_spheres", "centers"),
    "square": ("rectangle", "box"),
    "std": ("sigma",),
    "summary": ("numbers", "describe"),
    "tetrahedron": ("platonic",),
    "threshold": ("segment",),
    "to_csv": ("to_dataframe",),
    "to_vtk": ("save",),
    "type": ("kind", "family"),
    "view": ("plot",),
    "void_ratio": ("solid_fraction", "density"),
    "volume_fraction": ("solid_fraction", "density"),
    "watershed": ("segment",),
    "weight": ("share",),
    "write": ("save",),
    "write_lammps": ("write_deck",),
    "write_vtk": ("save",),
}


def unknown(
    kind: str, name: object, known: Iterable[str], *, beside: Iterable[str] = (), meant: str | None = None
) -> str:
    """Return the message for an unknown name, with all known names and the one that was most likely meant.

    `kind` is such as ``"packing method"``; names of `beside` may be suggested but are not listed. `meant` is suggested
    where the caller knows better than the spelling says.
    """
    names = sorted(set(known))
    meant = meant or nearest(name, (*names, *beside))
    hint = f"did you mean {meant!r}? " if meant else ""
    listed = f"known are {', '.join(names)}" if names else "there are no others" if meant else "there are none"
    return f"{kind} {shown(name)} is unknown: {hint}{listed}"


def nearest_word(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that was most likely meant, as :func:`nearest`, or else one that has a word of it, as
    ``load_image`` has one of ``image_file``.
    """
    names = list(known)
    synonym = next((entry for entry in SYNONYMS.get(name, ()) if entry in names), None)
    found = synonym or nearest(name, names, cutoff=0.65)
    if found:
        return found
    words = set(name.casefold().split("_"))
    return next((entry for entry in names if words & set(entry.casefold().split("_"))), None)


def nearest(name: object, known: Iterable[str], *, cutoff: float = 0.5) -> str | None:
    """Return the known name that was most likely meant, in any case: itself, a synonym, or one spelt alike."""
    given = name.casefold() if isinstance(name, str) else ""
    by_case = {entry.casefold(): entry for entry in known}
    alike = difflib.get_close_matches(given, by_case, n=1, cutoff=cutoff)
    candidates = (given, *SYNONYMS.get(given, ()), *alike)
    return next((by_case[entry] for entry in candidates if entry in by_case), None)


def missing_name(module: str, name: str, known: list[str]) -> str:
    """Return the message for a name that a module does not have, with the one that was most likely meant."""
    written = _written_elsewhere(name, known) if module == "voxgran" and not name.startswith("_") else None
    meant = None if name.startswith("__") else nearest_word(name, known)
    hint = written or (f"did you mean {meant!r}?" if meant else f"dir({module}) lists its names")
    return f"module {module!r} has no attribute {name!r}: {hint}"


def _written_elsewhere(name: str, known: Iterable[str]) -> str | None:
    """Return how a shape, size law, method, engine or measure is written, of which a module was asked for the name."""
    voxgran = sys.modules["voxgran"]
    word = name.casefold()
    container = next((entry for entry in known if entry.casefold() == word), None)
    places = (
        (dir(voxgran.shapes), "vg.shapes.{}()"),
        (voxgran.sizes.__all__, "vg.sizes.{}(...)"),
        (voxgran.packing_methods(), "vg.pack(shapes, container, {!r}, ...)"),
        (voxgran.clump_methods(), "vg.fit_clump(shape, method={!r})"),
        (voxgran.engines(), "vg.write_deck(packing, folder, {!r})"),
        (sys.modules[voxgran.measure.__module__].measures(), "vg.measure(packing, {!r})"),
    )
    words = (word, *SYNONYMS.get(word, ()))
    call = next((call.format(one) for one in words for names, call in places if one in names), None)
    if call and container:
        return f"write {call} for the shape, vg.{container}(...) for the container"
    return f"write {call}" if call else None


class ExplainedAttributes:
    """Objects that answer an unknown attribute with the one that was most likely meant.

    A public function of voxgran of that name, such as `equilibrium`, is named too, since it may be called with them.
    """

    __slots__ = ()

    # hidden from type checkers, which would otherwise accept any name
    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Explain an attribute that is missing.

            Raises
            ------
            AttributeError
                Always.
            """
            kind = type(self)
            if name.startswith("_") or hasattr(kind, name):
                # a method that Python or a notebook asks for, or an error within a property, which is raised again
                return object.__getattribute__(self, name)
            # with its name and no object, Python adds no suggestion of its own
            raise AttributeError(f"{kind.__name__} has no attribute {name!r}: {_remedy(kind, name)}", name=name)


def _remedy(kind: type, name: str) -> str:
    """Return what may be written in place of an unknown attribute."""
    voxgran = sys.modules["voxgran"]
    names = [entry for entry in voxgran.__all__ if entry.islower()]
    call = f"({kind.__name__.lower()}, ...)"
    own = [entry for entry in dir(kind) if not entry.startswith("_")]
    fields = [*own, *getattr(kind, "__dataclass_fields__", ())]
    synonyms = SYNONYMS.get(name.casefold(), ())
    meant = next((entry for entry in synonyms if entry in fields), None)
    if meant:
        return f"did you mean {meant!r}?"
    for function in (name, f"save_{name}", f"write_{name}", *synonyms):
        # modules such as voxgran.sizes are no functions
        if function in names and callable(getattr(voxgran, function)):
            return f"write vg.{function}{call}"
    meant = nearest(name, fields)
    if meant:
        return f"did you mean {meant!r}?"
    meant = nearest(name, names, cutoff=0.65)
    return f"did you mean vg.{meant}{call}?" if meant else f"dir({kind.__name__}) lists its attributes"
