"""Type and registry of engines.

Engines write numbers and lines of their files, and parts of their programs, by the functions of this file.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.calls import explained
from voxgran._base.errors import FileFormatError
from voxgran._base.registry import Registry
from voxgran.decks.bodies import Kind
from voxgran.decks.simulation import Simulation


class Frame(NamedTuple):
    """State of all grains at one time of a run of an engine, in SI units."""

    time: float
    position: Floats  # (n, 3) centroids; not wrapped into a periodic container
    matrices: Floats  # (n, 3, 3) rotations since the start
    kinetic_energy: float  # of translation and rotation
    final: bool = False  # whether the bed rests by the energy
    bounds: Floats | None = None  # (2, 3) corners of a container that keeps a stress


class Held(NamedTuple):
    """What the files of an engine hold, read back: one row a body, in SI units."""

    mass: Floats  # (n,)
    position: Floats  # (n, 3) centroids
    inertia: Floats  # (n, 3, 3) about the centroids, in the frame of the container
    centers: Floats  # (s, 3) of spheres
    radii: Floats  # (s,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Engine:
    """One registered engine.

    Attributes
    ----------
    name : str
        Name in calls and scenes: the name of the file or entry point.
    title : str
        Name as its authors write it.
    summary : str
        What is written, in one line.
    source : str
        Documentation of the layout.
    kinds : tuple of str
        What grains may be, the preferred kind of a solid that is no sphere first.
    laws : tuple of str
        Contact laws that it has.
    periodic, tilted, planar, cohesion, bonds, fixed, servo, platens, materials : bool
        Whether it has periodic containers, tilted ones among them, grains in two dimensions, surface energy, bonds that
        break, grains that are fixed, periodic cells that keep a stress, plane walls that keep one, and several
        materials with properties of pairs.
    upright : str
        Why it has no tilted containers, in words that a message ends with; ``""`` where it has them.
    rolling : tuple of str
        Contact laws under which it has rolling friction.
    install : str
        Command line that installs it; ``""`` where it cannot be had in that way.
    verified : str
        What the files were tried with.
    command : str
        Command line that runs the files of a folder; ``""`` without one.
    write : callable
        ``write(simulation)`` returns the text of each file by its name.
    read : callable, optional
        ``read(folder)`` returns what the files hold.
    run : callable, optional
        ``run(folder, simulation)`` runs the files and yields states.

    Examples
    --------
    >>> from voxgran.decks.engine import engine_registry
    >>> engine_registry().get("lammps").title
    'LAMMPS'
    """

    name: str = ""
    title: str
    summary: str
    source: str
    kinds: tuple[Kind, ...]
    laws: tuple[str, ...] = ("linear", "hertz")
    periodic: bool = True
    tilted: bool = False
    upright: str = ""
    planar: bool = False
    cohesion: bool = False
    bonds: bool = False
    fixed: bool = False
    servo: bool = False
    platens: bool = False
    materials: bool = False
    rolling: tuple[str, ...] = ()
    install: str = ""
    verified: str = "not run"
    command: str = ""
    write: Callable[[Simulation], Mapping[str, str]]
    read: Callable[[Path], Held] | None = None
    run: Callable[[Path, Simulation], Iterator[Frame]] | None = None


def engine_registry() -> Registry[Engine]:
    """Return the registry of engines."""
    return Registry("engine", "voxgran.decks.engines", Engine, group="voxgran.engines")


@explained(hint="engines()")
def engines() -> tuple[str, ...]:
    """Return the names of all engines that input can be written for.

    Examples
    --------
    >>> import voxgran as vg
    >>> "lammps" in vg.engines()
    True
    """
    return engine_registry().names()


def row_of(values: Iterable[float], between: str = " ") -> str:
    """Return numbers as a line that reads back to the same numbers."""
    return between.join(repr(float(value)) for value in values)


def text_of(lines: Iterable[str]) -> str:
    """Return lines as the text of a file."""
    return "\n".join(lines) + "\n"


def program_part(name: str) -> str:
    """Return a part of a program, in the language of an engine, from the folder ``programs``."""
    return (Path(__file__).parent / "programs" / name).read_text(encoding="utf-8")


def grain_rows(path: Path, columns: int) -> tuple[list[str], Floats]:
    """Return the names of templates and the numbers of a table of grains with a name and so many columns.

    Raises
    ------
    FileFormatError
        If a row has another number of columns.
    """
    rows = [line.split(",") for line in path.read_text().splitlines() if not line.startswith("#")]
    wrong = next((row for row in rows if len(row) != 1 + columns), None)
    if wrong is not None:
        raise FileFormatError(f"{path} has a row of {len(wrong)} columns: write the deck again")
    return [row[0] for row in rows], np.array([[float(word) for word in row[1:]] for row in rows])
