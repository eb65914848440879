"""`relax`: a packing brought to rest by an engine, with the history of the run."""

import logging
import math
import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_positive
from voxgran._base.calls import explained
from voxgran._base.errors import EngineError, FileFormatError, InputError, OutputError, VoxgranError
from voxgran._base.files import as_path, output_suffix, refuse_links, refuse_to_replace, write_files
from voxgran._base.lazy import Dataset, load
from voxgran._base.progress import OnStep, Step
from voxgran._base.units import NO_UNIT, unit_factor
from voxgran.clumps.model import Clump
from voxgran.containers.model import within_periods
from voxgran.containers.stretch import stretched
from voxgran.decks.contact_law import GRAVITY
from voxgran.decks.engine import Engine, Frame, engine_registry
from voxgran.decks.simulation import LONGEST, Simulation
from voxgran.decks.write import described
from voxgran.geometry.rotation import quaternions_of
from voxgran.geometry.sphere_pairs import near_pairs
from voxgran.io.files import save
from voxgran.io.netcdf import save_statistics
from voxgran.io.vtk_files import load_packing
from voxgran.measures.region import HELD, Regions
from voxgran.measures.registered.density import INSET
from voxgran.packing.model import Packing
from voxgran.settling.material import Material
from voxgran.settling.materials import Materials
from voxgran.settling.relaxation import Relaxation

log = logging.getLogger(__name__)

#: gap up to which grains touch where the packing does not say, in median diameters: twice the overlap under the weight
#: of the bed for which the usual stiffness is chosen
TOUCHING = 2e-3
#: contacts that a grain needs so that it is no rattler, with friction and without
FEWEST_CONTACTS, FEWEST_FRICTIONLESS = 2, 4


@explained(hint='relax(packing, "lammps")')
def relax(
    packing: Packing,
    engine: str = "lammps",
    *,
    material: Material | Materials | Mapping[str, Any] | None = None,
    clump: int | Clump | None = None,
    acceleration: float = GRAVITY,
    time_step: float | None = None,
    stress: float | Sequence[float] | None = None,
    until: float | None = None,
    longest: float = LONGEST,
    folder: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    checkpoint: str | os.PathLike[str] | None = None,
    on_step: OnStep | None = None,
) -> tuple[Packing, "Dataset"]:
    """Bring a packing to rest in an engine, and tell how far from rest it was.

    The grains start at rest, without velocity, and move under gravity, or under the stress of a container, until
    their kinetic energy is dissipated.

    Parameters
    ----------
    packing : Packing
        Grains in their container, with gravity or, where there is a stress, without.
    engine : str
        Engine that voxgran can run, such as ``"lammps"``.
    material : Material, Materials or mapping, optional
        Contact law and its parameters. Default: ``Material()``.
    clump : int or Clump, optional
        Number of spheres, or a fitted clump, in place of each shape that is no sphere. Default: 20.
    acceleration : float
        Acceleration of gravity, m/s^2.
    time_step : float, optional
        Time step in s. Default: the stable one, of which :func:`voxgran.write_deck` takes half.
    stress : float or sequence of float, optional
        Mean stress in Pa that the sides of a periodic container, or its plane walls, keep, as of
        :func:`voxgran.write_deck`.
    until : float, optional
        Mean kinetic energy of a grain below which the bed rests, in m g d of the grain of median mass m and diameter d,
        or under a stress s in s d^3. Default: 1e-6, and 1e-8 under a stress.
    longest : float
        Longest time of the run, in sqrt(d / g), or under a stress s in sqrt(m / (s d)).
    folder : path-like, optional
        Where the files of the engine stay. Default: a temporary folder, which stays where the engine fails.
    overwrite : bool
        Whether files in that folder may be replaced.
    checkpoint : path-like, optional
        File with suffix ``.vtp`` for the last state, written where the run is interrupted; relax it to go on.
    on_step : callable, optional
        Called with each :class:`Step` of the run.

    Returns
    -------
    Packing
        The grains as the engine has them, with clumps in place of shapes that it cannot hold. Its stop reason is
        ``"count"`` where the bed rests, of which :func:`voxgran.equilibrium` may find a proof, else ``"steps"``. Grains
        of an engine overlap by their elastic deformation.
    xarray.Dataset
        Along ``time``, in s: ``kinetic_energy`` (mean of a grain, in the unit of `until`), ``mean_sinking``,
        ``mean_displacement`` and ``largest_displacement`` (median diameters; relative to the mean strain of the
        container), ``coordination_number``, ``share_of_rattlers`` (grains that touch fewer than 2 grains and plane or
        round walls, without friction fewer than 4), and ``solid_fraction`` (of the
        space from 1.5 diameters above the floor to the height that holds 85 % of the volume of the grains; NaN in low
        beds, in spheres and meshes, and where gravity is oblique). Attributes: ``sinking`` of the bulk,
        ``change_of_coordination``, ``rests`` (1 or 0), ``touching_gap`` (median diameters), ``time_step``.

    Raises
    ------
    UnknownNameError
        If the engine or a material parameter is unknown; the message gives the nearest name.
    InputError
        If there is neither gravity nor a stress, the engine cannot be run by voxgran, or as
        :func:`voxgran.write_deck`.
    EngineError
        If the engine is not installed, with the line that installs it, or fails, with its last lines.
    OutputExistsError
        If one of the files is in the folder and `overwrite` is false, or the checkpoint is there and no state of a run.
    FileFormatError
        If the checkpoint has another suffix.
    Interrupted
        On SIGTERM at the prompt; on SIGINT a KeyboardInterrupt; the last state is in the checkpoint.

    See Also
    --------
    voxgran.equilibrium : proves rest of the true shapes without an engine.
    voxgran.settle : brings true shapes to rest without overlap.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.make_shape("sphere"), vg.Box((5, 5, 9)), "gravity", count=20)
    >>> rested, history = vg.relax(bed)  # doctest: +SKIP
    """
    found = engine_registry().get(engine)
    if found.run is None:
        able = [name for name in engine_registry().names() if engine_registry().get(name).run is not None]
        raise InputError(f"engine is {engine!r}: voxgran runs {', '.join(map(repr, able))} only; choose one of these")
    simulation, held = described(
        packing, found, material, clump=clump, acceleration=acceleration, time_step=time_step,
        rest=None if until is None else as_positive(until, "until"), longest=as_positive(longest, "longest"),
        stress=stress,
    )  # fmt: skip
    if packing.gravity is None and stress is None:
        raise InputError("packing.gravity is None, and there is no stress: grains relax under one; give stress=1e5")
    if time_step is None:
        simulation = replace(simulation, time_step=simulation.law.stable_step)
    if checkpoint is not None and as_path(checkpoint).suffix.lower() != ".vtp":
        raise FileFormatError(f"checkpoint is {str(checkpoint)!r}: the last state is kept as .vtp; change the suffix")
    if checkpoint is not None and not _is_state(checkpoint):
        refuse_to_replace(checkpoint)
    texts = found.write(simulation)
    place = _written(texts, folder, engine=engine, overwrite=overwrite)
    history = _History(simulation, held, packing.contact_gap)
    try:
        _follow(found, place, simulation, history, on_step)
    except KeyboardInterrupt:
        if checkpoint is not None and history.frames:
            _save_last(history.packing(engine), checkpoint)
        _remove(place, folder)
        raise
    except EngineError:
        if {path.name for path in place.iterdir()} == set(texts):
            # the engine was never started
            _remove(place, folder)
        raise
    if not history.frames:
        raise EngineError(f"{found.title} has written no state: its output is in {place}")
    _remove(place, folder)
    return history.packing(engine), history.dataset(engine)


def _written(texts: Mapping[str, str], folder: str | os.PathLike[str] | None, *, engine: str, overwrite: bool) -> Path:
    """Write the files of an engine into a folder, a temporary one where none is named, and return it."""
    if folder is not None and not overwrite:
        # what a run writes is named after its engine, too
        refuse_to_replace(*(as_path(folder) / name for name in texts), *as_path(folder).glob(f"{engine}*"))
    place = Path(tempfile.mkdtemp(prefix="voxgran_")) if folder is None else as_path(folder)
    refuse_links(place, place, *place.glob(f"{engine}*"))
    try:
        write_files({place / name: text for name, text in texts.items()})
    except OutputError:
        _remove(place, folder)
        raise
    return place


def _save_last(packing: Packing, checkpoint: str | os.PathLike[str]) -> None:
    """Save the last state of a run that is interrupted."""
    try:
        save(packing, checkpoint, overwrite=True)
    except VoxgranError as error:
        # the interrupt is what the caller waits for
        log.warning("the last state is lost: %s", error)


def _is_state(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is the state of a run."""
    try:
        return "relaxed" in load_packing(path).provenance
    except VoxgranError:
        return False


def remove_state(path: str | os.PathLike[str]) -> None:
    """Remove the last state of a run that was interrupted, if it is there; any other file stays."""
    if _is_state(path):
        as_path(path).unlink()


def _remove(place: Path, folder: object) -> None:
    """Remove the files of a run, unless the user has named a folder for them."""
    if folder is None:
        shutil.rmtree(place, ignore_errors=True)


def save_history(history: "Dataset", path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write the course of a run as netCDF.

    Parameters
    ----------
    history : xarray.Dataset
        As :func:`relax` returns it.
    path : path-like
        File with the suffix ``.nc``.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    FileFormatError
        If the suffix is another one.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written.
    """
    output_suffix(path, [".nc"], "the course of a run is kept")
    save_statistics(load("xarray").DataTree(history), path, overwrite=overwrite)


def _follow(engine: Engine, folder: Path, simulation: Simulation, history: "_History", on_step: OnStep | None) -> None:
    """Run an engine in a folder and take down its states."""
    assert engine.run is not None
    duration = simulation.duration
    for frame in engine.run(folder, simulation):
        history.add(frame)
        if on_step is not None:
            last = history.rows[-1]
            unit, way = ("m g d", f"sunk {last['mean_sinking']:.3f} d")
            if simulation.stress is not None:
                unit, way = "s d^3", f"moved by {last['mean_displacement']:.1e} d"
            text = f"energy {last['kinetic_energy']:.1e} {unit}, {way}"
            done = round(1000 * frame.time / duration)
            on_step(Step(stage=f"relaxing in {engine.title}", done=min(done, 1000), total=1000, text=text))


@dataclass
class _History:
    """What is known of the states of a run."""

    simulation: Simulation
    held: Packing
    contact_gap: float  # of the packing, in its unit of lengths
    rows: list[dict[str, float]] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)  # the first and the last one

    def add(self, frame: Frame) -> None:
        """Take down a state."""
        self.frames = [*self.frames[:1], frame]
        simulation = self.simulation
        free = simulation.bodies.assembly.movable
        moved = (frame.position - simulation.strained(frame.bounds))[free] / simulation.diameter
        degree, touching = (many[free] for many in self._contacts(frame))
        few = FEWEST_CONTACTS if simulation.law.friction else FEWEST_FRICTIONLESS
        self.rows.append(
            {
                "time": frame.time,
                "kinetic_energy": frame.kinetic_energy * simulation.rest / simulation.rest_energy,
                "mean_sinking": float(linear.matmul(moved, self._down).mean()),
                "mean_displacement": float(linear.norm(moved, axis=1).mean()),
                "largest_displacement": float(linear.norm(moved, axis=1).max()),
                "coordination_number": float(degree.mean()),
                "share_of_rattlers": float((degree + touching < few).mean()),
                "solid_fraction": _slab_fraction(simulation, frame.position),
            }
        )
        log.info("t = %.4g s: %s", frame.time, self.rows[-1])

    @property
    def _down(self) -> Floats:
        """Unit vector of gravity; 0 without."""
        return self.simulation.gravity / (float(linear.norm(self.simulation.gravity)) or 1.0)

    @property
    def gap(self) -> float:
        """Gap up to which grains touch, m."""
        factor = 1.0 if self.held.unit == NO_UNIT else unit_factor(self.held.unit, "m")
        return max(TOUCHING * self.simulation.diameter, self.contact_gap * factor)

    def _contacts(self, frame: Frame) -> tuple[Integers, Integers]:
        """Return how many other grains and how many walls each grain touches, (n,)."""
        bodies, walls = self.simulation.bodies, self.simulation.walls
        centers, radii, grain = bodies.spheres
        arms = centers - bodies.assembly.position[grain]
        now = frame.position[grain] + linear.einsum("sij,sj->si", frame.matrices[grain], arms)
        low, factors = walls.bounds[0], np.ones(3)
        if frame.bounds is not None:
            low, factors = frame.bounds[0], np.ptp(frame.bounds, axis=0) / np.ptp(walls.bounds, axis=0)
        i, j, _ = near_pairs(now, radii, self.gap, lower=low, periods=walls.periods * factors)
        a, b = np.minimum(grain[i], grain[j]), np.maximum(grain[i], grain[j])
        pairs = np.unique((a * bodies.count + b)[a != b])
        ends = np.concatenate([pairs // bodies.count, pairs % bodies.count])
        degree = np.bincount(ends, minlength=bodies.count)
        touching = np.zeros(bodies.count, dtype=np.int64)
        for distance in walls.distances(now, frame.bounds):
            touching[np.unique(grain[distance - radii <= self.gap])] += 1
        return degree, touching

    @property
    def rests(self) -> bool:
        """Whether the bed rests at the last state."""
        return len(self.rows) > 1 and self.rows[-1]["kinetic_energy"] < self.simulation.rest

    def relaxation(self, engine: str) -> Relaxation:
        """Return what the run has changed."""
        first, last = self.frames[0], self.frames[-1]
        inset = INSET * self.held.median_diameter
        bulk = Regions(self.held).at(inset).grains(self.held)
        mine = bulk & self.held.movable
        mine = mine if mine.any() else self.held.movable
        sunk = linear.matmul((last.position - first.position)[mine], self._down).mean() / self.simulation.diameter
        return Relaxation(
            engine=engine,
            sinking=float(sunk),
            mean_displacement=self.rows[-1]["mean_displacement"],
            largest_displacement=self.rows[-1]["largest_displacement"],
            coordination_before=self.rows[0]["coordination_number"],
            coordination_after=self.rows[-1]["coordination_number"],
            duration=last.time / self.simulation.time_unit,
        )

    def packing(self, engine: str) -> Packing:
        """Return the grains at the last state, in the unit of the packing."""
        held, last = self.held, self.frames[-1]
        factor = 1.0 if held.unit == NO_UNIT else unit_factor("m", held.unit)
        container = held.container
        if last.bounds is not None:
            factors = np.ptp(last.bounds, axis=0) / np.ptp(self.simulation.walls.bounds, axis=0)
            container = stretched(container, factors.tolist())
        position = last.position * factor
        if last.bounds is not None:
            position += container.bounds[0] - last.bounds[0] * factor
        told = {"engine": engine, "time_step": self.simulation.time_step, "rests": self.rests}
        return replace(
            held,
            container=container,
            position=within_periods(position, container),
            orientation=quaternions_of(linear.matmul(last.matrices, held.matrices)),
            # little kinetic energy proves no rest
            stop_reason="count" if self.rests else "steps",
            provenance={**held.provenance, "relaxed": told},
            contact_gap=self.gap * factor,
            forces=None,
            relaxation=self.relaxation(engine),
        )

    def dataset(self, engine: str) -> "Dataset":
        """Return the history."""
        told = {
            "kinetic_energy": "mean kinetic energy of a grain, in m g d of the median grain, under a stress s in s d^3",
            "mean_sinking": "mean displacement along gravity, in median diameters",
            "mean_displacement": "mean displacement of a grain, in median diameters",
            "largest_displacement": "largest displacement of a grain, in median diameters",
            "coordination_number": "mean number of grains that a grain touches",
            "share_of_rattlers": "share of grains that touch too few grains and walls to bear a load",
            "solid_fraction": "solid fraction below the height that holds 85 % of the volume of the grains",
        }
        rows = {
            name: (("time",), np.array([row[name] for row in self.rows]), {"units": "1", "long_name": text})
            for name, text in told.items()
        }
        time = (("time",), np.array([row["time"] for row in self.rows]), {"units": "s", "long_name": "time"})
        changed = self.relaxation(engine)
        about = {
            "engine": engine,
            "rests": int(self.rests),
            "sinking": changed.sinking,
            "change_of_coordination": changed.coordination_after - changed.coordination_before,
            "touching_gap": self.gap / self.simulation.diameter,
            "time_step": self.simulation.time_step,
        }
        made: Dataset = load("xarray").Dataset(rows, coords={"time": time}, attrs=about)
        return made


def _slab_fraction(simulation: Simulation, position: Floats) -> float:
    """Return the solid fraction between the bulk's distance from the bottom and the height that holds 85 % of the
    volume, where each grain counts as a sphere of its volume; NaN where the cross-section is not the same everywhere.
    """
    walls, bodies = simulation.walls, simulation.bodies
    axis = int(np.abs(simulation.gravity).argmax())
    others = [k for k in range(3) if k != axis]
    span = walls.bounds[1] - walls.bounds[0]
    upright = np.count_nonzero(simulation.gravity) == 1 and not walls.periodic[axis]
    if (
        not upright
        or walls.mesh is not None
        or (walls.round is not None and (walls.round.kind == "sphere" or axis != 2))
    ):
        return math.nan
    area = float(np.prod(span[others])) if walls.round is None else math.pi * walls.round.radius**2
    sign = -float(np.sign(simulation.gravity[axis]))
    height = sign * (position[:, axis] - walls.bounds[0 if sign > 0 else 1, axis])
    radius = bodies.assembly.diameters / 2
    order = np.argsort(height, kind="stable")
    below = np.cumsum(bodies.assembly.volumes[order])
    top = float(height[order][np.searchsorted(below, HELD * below[-1])])
    bottom = INSET * simulation.diameter
    if top <= bottom:
        return math.nan
    inside = _below(top - height, radius) - _below(bottom - height, radius)
    return float(inside.sum()) / (area * (top - bottom))


def _below(level: Floats, radius: Floats) -> Floats:
    """Return the volumes of spheres below a level above their centers."""
    depth = np.clip(level + radius, 0.0, 2 * radius)
    return np.asarray(math.pi * depth**2 * (radius - depth / 3))
