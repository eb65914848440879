"""The errors that voxgran raises.

Each subclasses the standard error that people catch, and each message is one sentence that names the
value, the rule and the remedy. `exit_code` is what the command line returns: 2 for bad input, 1 for failure.

Warnings point at the line of the user. Former names are accepted for one release, with a warning. Where a name is
unknown, the message tells which one was meant, by its spelling or by the words of other programs.
"""

import difflib
import re
import sys
import warnings
from collections.abc import Collection, Iterable
from functools import cache
from itertools import islice
from typing import ClassVar

#: how many things of several a message names
NAMED = 5


def shown(value: object) -> str:
    """Return a value as a message shows it: on one line, no longer than 60 characters."""
    try:
        text = repr(value)
    except ValueError:
        # Python writes no whole number of more than 4300 digits
        text = f"<{type(value).__name__} of more than 4300 digits>"
    except RecursionError:
        text = f"<{type(value).__name__} that is nested too deeply to be shown>"
    return shortened(" ".join(text.split()), 60)


def shortened(text: str, most: int = 300) -> str:
    """Return a text that is cut where it has more characters than a message shows."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def with_article(noun: str) -> str:
    """Return a noun with its article: ``a box``, ``an ellipsoid``."""
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"


def numbered(noun: str, numbers: Collection[int]) -> str:
    """Return things by their numbers, at most five of them: ``grain 3``, ``rows 0, 2, 5, 6, 7 and 2 more``."""
    first = ", ".join(str(number) for number in islice(numbers, NAMED))
    more = f" and {len(numbers) - NAMED} more" if len(numbers) > NAMED else ""
    return f"{noun}{'' if len(numbers) == 1 else 's'} {first}{more}"


class VoxgranError(Exception):
    """Base of all errors that voxgran raises on purpose.

    Examples
    --------
    >>> import voxgran as vg
    >>> try:
    ...     vg.Box((4, 4, -1))
    ... except vg.VoxgranError as error:
    ...     print(error)
    length of the box is -1.0: it must be finite and above 0; change it
    """

    exit_code: ClassVar[int] = 1


class InputError(VoxgranError, ValueError):
    """A value that breaks a rule."""

    exit_code: ClassVar[int] = 2


class UnknownNameError(InputError):
    """A name (method, family, key, section) that voxgran does not know."""


class CallError(InputError, TypeError):
    """A call whose arguments do not fit the signature."""


class GrainIndexError(InputError, IndexError):
    """An index, mask or list that chooses no grains of a packing."""


class DirtyMeshError(InputError):
    """A surface that does not bound one solid."""


class GrainTooLargeError(InputError):
    """A grain that cannot fit in its container."""


class FileFormatError(InputError):
    """A file whose content cannot be read as what it claims to be."""


class CheckpointError(FileFormatError):
    """A checkpoint that is damaged or belongs to another run."""


class MissingFileError(VoxgranError, FileNotFoundError):
    """A file that is not there."""

    exit_code: ClassVar[int] = 2


class OutputExistsError(VoxgranError, FileExistsError):
    """An output that is already there and was not to be replaced."""

    exit_code: ClassVar[int] = 2


class InUseError(VoxgranError, BlockingIOError):
    """An output that another process is writing."""

    exit_code: ClassVar[int] = 2


class OutputError(VoxgranError, OSError):
    """An output that could not be written."""


class MissingLibraryError(VoxgranError, ImportError):
    """A library, or a system library under it, that cannot be loaded."""


class EngineError(VoxgranError, RuntimeError):
    """A program of an engine that is not installed, or fails."""


class ClusterError(VoxgranError, ConnectionError):
    """A cluster of computers that is not there, or goes away."""


class TooLargeError(VoxgranError, MemoryError):
    """A request that does not fit in memory."""

    exit_code: ClassVar[int] = 2


class Interrupted(KeyboardInterrupt):
    """A run stopped by SIGINT, SIGTERM or SIGHUP; no error, so that ``except Exception`` does not catch it.

    The exit code is 130 or 143.
    """

    def __init__(self, message: str, signal_number: int) -> None:
        super().__init__(message)
        self.signal_number = signal_number
        self.exit_code = 128 + signal_number


class DirtyMeshWarning(UserWarning):
    """Something about a surface that is allowed but worth knowing."""


class PackingWarning(UserWarning):
    """A packing that misses a requested property, or a measure of it that is not meaningful.

    Examples
    --------
    >>> import warnings
    >>> import voxgran as vg
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", vg.PackingWarning)
    ...     few = vg.pack(vg.shapes.sphere(), vg.Box((2, 2, 2)), "rsa", count=9)
    >>> few.count < 9
    True
    """


class LongRunWarning(PackingWarning):
    """A run that is expected to take long, told before it starts."""


def warn(text: str, category: type[Warning]) -> None:
    """Issue a warning of one sentence that points at the first caller outside of voxgran, and of properties kept."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in ("voxgran", "functools"):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, category, stacklevel=level)


#: words that people type for a name of ours, as other programs have it, each with what is suggested: the first that is
#: known
_WORDS = """
acceleration: shaking settle; array: values; aspect_ratio: aspect elongation; ball: sphere; bounds: container; box:
container; callback: on_step; center_mass: centroid; center_of_mass: centroid; centers: position; centres: centers
position; centroid: position; circle: disk; clump: fit_clump; colour: color_by; com: centroid; constant: fixed;
contact_number: coordination measure; contacts: coordination measure; coordination: measure; coordination_number:
coordination measure; cube: box; cuboid: box; d: diameter; d50: median; data: values; decimate: simplify; density:
solid_fraction measure; descriptors: describe; diameter: radius; draw: plot picture; dt: time_step; dtype: values; e:
young_modulus; export: write_deck save save_shape; figure: plot write_page picture; fill: pack; friction: settle;
from_file: from_toml load; gaussian: normal lognormal; generate: pack make_shape; generate_packing: pack; gradation:
sizes; grading: gradation; grain_size: gradation; html: report; image: load_image to_image picture; imread: load_image;
info: describe; is_watertight: is_open; kind: family; length: lengths height; load_ct: load_image; load_mesh:
load_shape; load_packing: load; load_stl: load_shape; load_tiff: load_image; make_packing: pack; marching_cubes:
iso_surface; mass: masses; mass_density: density; material: density; mean: median; mesh: load_shape to_pyvista shape
to_shape; monodisperse: fixed; mu: friction settle; n: count max_spheres; n_grains: count; n_spheres: count max_spheres;
neighbors: contacts; neighbours: contacts; normal: lognormal; nu: poisson_ratio; num: count; number: count; open: load;
open_image: load_image; pack: run; packing_fraction: solid_fraction density; pair_correlation: rdf measure; passed: ok;
picture: save_picture plot; plot: write_page picture; pore_size: voids measure; pore_size_distribution: voids measure;
pores: voids measure; porosimetry: voids measure; porosity: solid_fraction density measure; positions: position;
profile: measure; progress: on_step; psd: gradation sieve; quaternion: orientation; r: radius; radial_distribution: rdf
measure; radii: diameters; read: load from_file; read_mesh: load_shape; read_packing: load; read_stl: load_shape;
read_tiff: load_image; reduce: simplify; remesh: simplify; render: plot picture; repeats: seeds; replicates: seeds;
report: save_report; resize: resample; rho: density; save: save_shape save_cloud save_deformed write_page; save_packing:
save; scene: base; segment: labels; shake: settle; shaking: settle; shape: make_shape values; shape_factors: describe;
show: plot write_page picture; simulate: settle relax; size: lengths diameter; sizes: diameters; solid_fraction:
density; sphere_packing: pack; spheres: clump max_spheres centers; square: rectangle box; std: sigma; summary: numbers
describe; tetrahedron: platonic; threshold: segment; to_csv: to_dataframe table; to_dataframe: table; to_file: save
save_shape; to_mesh: to_pyvista to_shape; to_stl: save save_shape; to_vtk: save; type: kind family; version:
__version__; view: plot picture; void_ratio: solid_fraction density; volume_fraction: solid_fraction density; voronoi:
local_density measure; watershed: segment; weight: share; write: save; write_lammps: write_deck; write_vtk: save
"""
#: words that say nothing of what a name is of
LITTLE_WORDS = frozenset({"from", "get", "is", "load", "make", "of", "save", "set", "to", "with", "write"})


def check_known(kind: str, name: object, known: Collection[str]) -> None:
    """Refuse a name that is not among the known ones.

    Raises
    ------
    UnknownNameError
        If it is not, or no text; the message gives the nearest name.
    """
    if not isinstance(name, str) or name not in known:
        raise UnknownNameError(unknown(kind, name, known))


def unknown(
    kind: str, name: object, known: Iterable[str], *, beside: Iterable[str] = (), meant: str | None = None
) -> str:
    """Return the message for an unknown name, with all known names and the one that was most likely meant.

    `kind` is such as ``"packing method"``; names of `beside`, such as the arguments of the function itself beside the
    parameters of its method, are listed after the others. `meant` is suggested where the caller knows better than the
    spelling says.
    """
    names = sorted(set(known))
    more = sorted(set(beside) - set(names))
    names, more = (names, more) if names else (more, [])
    meant = meant or nearest(name, (*names, *more))
    hint = f"did you mean {meant!r}? " if meant else ""
    # names of a user's own may be of any length
    told = ", ".join(shortened(one, 60) for one in names)
    listed = f"known are {told}" if names else "there are no others" if meant else "there are none"
    also = f", and beside them {', '.join(more)}" if more else ""
    return f"{kind} {shown(name)} is unknown: {hint}{listed}{also}"


def nearest_word(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that was most likely meant, as :func:`nearest` but a synonym before the same word in
    another case, or else one that has a word of it, as ``load_image`` has one of ``image_file``.
    """
    names = list(known)
    synonym = next((entry for entry in _synonyms().get(name, ()) if entry in names), None)
    words = set(name.casefold().split("_")) - LITTLE_WORDS
    shared = (entry for entry in sorted(names, key=len) if words & set(entry.casefold().split("_")))
    return synonym or nearest(name, names) or next(shared, None)


def nearest(name: object, known: Iterable[str]) -> str | None:
    """Return the known name that was most likely meant, in any case: itself, a synonym, one spelt alike, or one of
    which it is a part or that is a part of it. None where that is not plain: a wrong name is worse than none.
    """
    given = name.casefold() if isinstance(name, str) else ""
    by_case = {entry.casefold(): entry for entry in known}
    alike = max(by_case, key=lambda entry: _likeness(given, entry), default="")
    words = (given, *_synonyms().get(given, ()), *([alike] if _likeness(given, alike) else []))
    candidates = (*words, *synonyms_of(given), *_parts(given, by_case))
    return next((by_case[entry] for entry in candidates if entry in by_case), None)


def synonyms_of(name: str) -> tuple[str, ...]:
    """Return what may be meant by a word, which may be written together or in the plural."""
    word, words = name.casefold(), _synonyms()
    if word in words:
        return words[word]
    joined, by_letters = word.replace("_", ""), {entry.replace("_", ""): meant for entry, meant in words.items()}
    return by_letters.get(joined) or by_letters.get(joined.removesuffix("s"), ())


@cache
def _synonyms() -> dict[str, tuple[str, ...]]:
    """Return what is suggested for each word of other programs."""
    entries = (entry.partition(":") for entry in _WORDS.split(";"))
    return {word.strip(): tuple(meant.split()) for word, _, meant in entries}


def _likeness(one: str, other: str) -> float:
    """Return how alike two names are spelt, from 0 to 1; 0 where one is no slip for the other.

    They are compared word by word: ``max_size`` and ``min_size`` share most of their letters.
    """
    words, others = one.split("_"), other.split("_")
    if len(words) != len(others):
        return _likeness_of_words("".join(words), "".join(others), least=0.9)
    return min(_likeness_of_words(*pair) for pair in zip(words, others, strict=True))


def _likeness_of_words(one: str, other: str, *, least: float = 0.8) -> float:
    """Return how alike two words are, from 0 to 1: 0 for less than the least, such as one slip in five letters, and
    where they begin differently, as slips seldom do. Forms of one word, such as settle and settling, are alike.
    """
    matcher = difflib.SequenceMatcher(None, one, other)
    # letters that are swapped count twice in the ratio
    swapped = one[:1] == other[:1] and sorted(one) == sorted(other)
    if swapped or (len(_stem(one)) > 3 and _stem(one) == _stem(other)):
        return matcher.ratio()
    least = least if one[:1] == other[:1] else 0.9
    # bounds of the ratio, which take less time
    likely = matcher.real_quick_ratio() >= least and matcher.quick_ratio() >= least
    return ratio if likely and (ratio := matcher.ratio()) >= least else 0.0


def _stem(word: str) -> str:
    """Return a word without the ending of its form."""
    return re.sub("(ation|ing|ed|s|e)$", "", word)


def _parts(given: str, known: Iterable[str]) -> list[str]:
    """Return the names that are the beginning or the end of what is given, as ``friction`` of ``friction_angle``, the
    longest first, then those that begin with it, the shortest first.
    """
    names = sorted(known, key=len)
    long = [name for name in reversed(names) if len(name) > 3]
    begin = [name for name in long if given.startswith(f"{name}_") and name not in LITTLE_WORDS]
    end = [name for name in long if given.endswith(f"_{name}")]
    return [*begin, *end, *(name for name in names if len(given) > 2 and name.startswith(given))]
