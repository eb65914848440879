"""One run of a study, a cell with a seed: what is asked for, how it is computed, and what it leaves.

Runs write checkpoints: a run that was ended with its process goes on from its last one.
"""

import contextlib
import json
import logging
import os
import resource
import socket
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from voxgran import __version__
from voxgran._base.checkpoint import remove_checkpoint
from voxgran._base.errors import CheckpointError, InUseError, LongRunWarning, OutputError, VoxgranError
from voxgran._base.files import made_folder, write_text
from voxgran._base.lazy import counting_preparation
from voxgran._base.machine import forget_peak, peak_memory
from voxgran._base.progress import Step, silent
from voxgran._base.scalars import check_types, values_of_json
from voxgran.contacts.verify import verify
from voxgran.io.files import save
from voxgran.measures.model import measure, measure_registry
from voxgran.packing.model import Packing
from voxgran.scene.checked_sections import compressed
from voxgran.scene.description import SceneDescription
from voxgran.scene.run import pack_scene
from voxgran.shapes.model import Shape
from voxgran.study.files import refuse_changed

LOG = logging.getLogger(__name__)

#: numbers of the verification, with unit and meaning; depths are in mean diameters
VERIFIED = {
    "overlapping_pairs": ("overlapping_pairs", "number of pairs of grains that overlap"),
    "deepest": ("deepest_overlap", "largest depth of an overlap, in mean diameters"),
    "escaped": ("escaped_grains", "number of grains that protrude beyond a wall"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What a process is asked to compute.

    Attributes
    ----------
    key : str
        Hash of the scene with its seed: the name of the results.
    cell : str
        Hash of the scene without its seed.
    mapping : dict
        The scene as nested values, with absolute paths.
    seed : int
        Seed of the scene.
    packing : str
        File for the packing; empty where it is not kept.
    checkpoint : str
        File for the checkpoint, from which a run that was ended goes on; empty where it begins anew.
    mark : str
        What is in the folder of the checkpoint, by which a Dask worker finds that it sees the same folder.
    memory, attempts, grains : int
        Bytes at the peak, attempts and grains, as planned.
    before : float
        CPU seconds that have led to its checkpoint.
    version : str
        Version of voxgran that the results are to be of.
    files : dict
        Hashes of the files that the scene names, by which the worker finds that one has changed.
    """

    key: str
    cell: str
    mapping: dict[str, Any]
    seed: int
    packing: str = ""
    checkpoint: str = ""
    mark: str = ""
    memory: int = 0
    attempts: int = 0
    grains: int = 0
    before: float = 0.0
    version: str = __version__
    files: dict[str, str] = field(default_factory=dict)


@dataclass(slots=True, kw_only=True)
class Record:
    """What a run has left.

    Attributes
    ----------
    failure : str
        Why there are no numbers, in a sentence; empty where there are.
    stop_reason : str
        Why the packing ended.
    numbers : dict
        Value, unit and meaning of each number, by name.
    seconds : float
        CPU time, without that in which libraries were imported and kernels compiled.
    memory : int
        Bytes of memory at the peak of the process during the run.
    warnings : list of str
        What was warned of.
    attempts, grains : int
        Attempts at the most and grains, as planned.
    elapsed : float
        Seconds by the clock since it was begun the last time; 0 where they are not known.
    """

    failure: str = ""
    stop_reason: str = ""
    numbers: dict[str, list[Any]] = field(default_factory=dict)
    seconds: float = 0.0
    memory: int = 0
    warnings: list[str] = field(default_factory=list)
    attempts: int = 0
    grains: int = 0
    elapsed: float = 0.0


#: types of what a run has left, as its file holds it
TYPES: dict[str, Any] = {
    **dict.fromkeys(("failure", "stop_reason"), str),
    **dict.fromkeys(("memory", "attempts", "grains"), int),
    **dict.fromkeys(("seconds", "elapsed"), float),
    "numbers": dict,
    "warnings": [str],
}


class SceneCache:
    """The scene of the last run and its shapes: the runs of a cell differ by their seeds only."""

    def __init__(self) -> None:
        self._key: str | None = None
        self._made: tuple[SceneDescription, tuple[Shape, ...]]

    def of(self, run: Run) -> tuple[SceneDescription, tuple[Shape, ...]]:
        """Return scene and shapes of a run."""
        if self._key != run.cell:
            self._key = None
            scene = SceneDescription.from_mapping(run.mapping)
            self._made = scene, tuple(shape for entry in scene.shapes for shape, _ in entry.grains())
            self._key = run.cell
        scene, shapes = self._made
        return replace(scene, general=replace(scene.general, seed=run.seed, seeds=1)), shapes


def compute(run: Run, cache: SceneCache | None = None) -> Record:
    """Pack, verify and measure a scene; what goes wrong becomes the sentence of a record.

    Parameters
    ----------
    run : Run
        What is asked for.
    cache : SceneCache, optional
        Scene and shapes of the run before.
    """
    record, began, clock = Record(), _seconds(), time.monotonic()
    if run.version != __version__:
        return Record(failure=f"the worker has voxgran {__version__} in place of {run.version}: install the same")
    forget_peak()
    with warnings.catch_warnings(record=True, action="always") as caught, counting_preparation() as preparation:
        # the study has told it before it started
        warnings.simplefilter("ignore", LongRunWarning)
        kept = Checkpoint(run.checkpoint, lambda: _seconds() - began - preparation.seconds)
        try:
            scene, shapes = (cache or SceneCache()).of(run)
            packing = compressed(scene.compress, kept.pack(scene, shapes))
            # all that is read has been read before: a change in between is found here
            refuse_changed(run.files)
            record.numbers = numbers_of(packing, scene.which)
            record.stop_reason = packing.stop_reason
            if run.packing:
                save(packing, run.packing, overwrite=True)
        except VoxgranError as error:
            record.failure = str(error)
        except MemoryError:
            record.failure = "the memory of the machine ran out: give fewer workers, or pack fewer grains"
        except Exception as error:
            LOG.debug("a run failed with a fault of the program", exc_info=True)
            record.failure = f"{type(error).__name__}: {error}"
    record.failure = " ".join(record.failure.split())
    record.warnings = list(dict.fromkeys(" ".join(str(one.message).split()) for one in caught))
    record.seconds, record.memory = _seconds() - began - preparation.seconds + kept.before, peak_memory()
    record.elapsed = time.monotonic() - clock - preparation.seconds
    kept.remove()
    return record


def compute_with_file(run: Run) -> tuple[Record, bytes]:
    """Return the record of a run and the content of the file of its packing, empty where it is not kept: for workers
    on machines that may not see the folder of the study. The checkpoint is used by those that see it.
    """
    if run.checkpoint and not is_seen(run.checkpoint, run.mark):
        run = replace(run, checkpoint="")
    if not run.packing:
        return compute(run), b""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / Path(run.packing).name
        record = compute(replace(run, packing=str(place)))
        return record, place.read_bytes() if place.is_file() else b""


def numbers_of(packing: Packing, which: tuple[str, ...] | None) -> dict[str, list[Any]]:
    """Return the numbers of a packing as a whole, with unit and meaning: those of its verification and its measures.

    Of the usual measures only those are computed that give numbers of the whole packing.
    """
    names = which
    if names is None:
        entries = [measure_registry().get(name) for name in measure_registry().names()]
        names = tuple(e.name for e in entries if e.usual and "/" in e.groups and e.applies(packing))
    proof, tree = verify(packing, on_step=silent), measure(packing, which=names)
    found = {name: [float(getattr(proof, key)), "1", text] for key, (name, text) in VERIFIED.items()}
    for name, value in tree.dataset.data_vars.items():
        if value.ndim == 0 and value.dtype.kind in "iufb":
            told = (str(value.attrs.get("units", "1")), str(value.attrs.get("long_name", name)))
            found[str(name)] = [float(value), *told]
    return found


def to_text(record: Record, of: Mapping[str, Any]) -> str:
    """Return a record, and what it is of, as JSON."""
    numbers = {name: [json.dumps(value), *told] for name, (value, *told) in record.numbers.items()}
    made = {name: getattr(record, name) for name in Record.__dataclass_fields__} | {"numbers": numbers}
    return json.dumps({"voxgran": __version__, **of, "record": made}, default=str)


def from_text(text: str) -> Record:
    """Return the record in a text of :func:`to_text`; a text that is none may give a KeyError or TypeError, too.

    Raises
    ------
    ValueError
        If it is no JSON, or a number has a name that a dataset cannot hold.
    """
    held = values_of_json(text)["record"]
    check_types(held, TYPES, "the record")
    made = Record(**held)
    check_types(made.numbers, {name: [str] for name in made.numbers}, "numbers")
    made.numbers = {name: [float(value), *told] for name, (value, *told) in made.numbers.items()}
    if any(len(told) != 3 for told in made.numbers.values()):
        raise ValueError("a number has no value, unit and meaning")
    if strange := next((name for name in made.numbers if "/" in name), None):
        raise ValueError(f"{strange!r} is no name of a number: xarray keeps it for paths")
    return made


def _seconds() -> float:
    """Return the CPU time of this process and of those that it has waited for; of a thread beside others, its
    own.
    """
    if threading.current_thread() is not threading.main_thread():
        return time.thread_time()
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + used.ru_utime + used.ru_stime


#: file in the folder of checkpoints by which a worker on another machine finds that it sees the same folder
MARK = "study"


@contextlib.contextmanager
def marked(folder: Path) -> Iterator[str]:
    """Yield a text that is in a file of the folder of checkpoints as long as the study runs (context manager).

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    mark = f"{socket.gethostname()} {os.getpid()} {time.time_ns()}"
    write_text(made_folder(folder) / MARK, mark)
    try:
        yield mark
    finally:
        if is_seen(str(folder / "any"), mark):
            with contextlib.suppress(OSError):
                (folder / MARK).unlink()


def is_seen(checkpoint: str, mark: str) -> bool:
    """Return whether this machine sees the folder of a checkpoint that has this mark, and may write there."""
    folder = Path(checkpoint).parent
    try:
        return (folder / MARK).read_text(encoding="utf-8") == mark and os.access(folder, os.W_OK)
    except (OSError, ValueError):
        return False


def seconds_before(checkpoint: str) -> float:
    """Return the CPU time that led to a checkpoint, 0 where there is none."""
    if os.path.exists(checkpoint):
        with contextlib.suppress(OSError, ValueError):
            return float(_clock(checkpoint).read_text(encoding="ascii"))
    return 0.0


def _clock(checkpoint: str) -> Path:
    """Return the file beside a checkpoint that holds the CPU time."""
    return Path(f"{checkpoint}.seconds")


class Checkpoint:
    """The checkpoint of a run, and beside it the CPU time that led to it.

    Parameters
    ----------
    file : str
        Path of the checkpoint; empty where the run is always begun anew.
    seconds : callable
        Returns the CPU time of the run so far, without that before the checkpoint.
    """

    def __init__(self, file: str, seconds: Callable[[], float]) -> None:
        self._file, self._seconds = file, seconds
        self._stamp = self._written()
        #: CPU time that led to the checkpoint from which the run goes on
        self.before = seconds_before(file)

    def pack(self, scene: SceneDescription, shapes: tuple[Shape, ...]) -> Packing:
        """Pack a scene, from its checkpoint if it has one; layers are always packed anew.

        Parameters
        ----------
        scene : SceneDescription
            The scene.
        shapes : tuple of Shape
            Its shapes.
        """
        if not self._file or scene.layers:
            return pack_scene(scene, shapes)
        kept: dict[str, Any] = {"checkpoint": Path(self._file), "resume": True, "on_step": self._note}
        try:
            try:
                return pack_scene(scene, shapes, **kept)
            except CheckpointError:
                # damaged, or of another version
                self.remove()
                self.before = 0.0
                return pack_scene(scene, shapes, **kept)
        except (CheckpointError, InUseError, OutputError):
            # the disk is full, another worker still computes this run, or another file lies there: that stays
            self._file, self.before = "", 0.0
            return pack_scene(scene, shapes)

    def remove(self) -> None:
        """Remove the checkpoint of a finished run."""
        if self._file:
            with contextlib.suppress(OSError, ValueError):
                remove_checkpoint(self._file)
                # what holds no number is another file
                float(_clock(self._file).read_text(encoding="ascii"))
                _clock(self._file).unlink()

    def _note(self, step: Step) -> None:
        """Write the CPU time when a checkpoint has been written since the last step."""
        del step
        stamp = self._written()
        if stamp != self._stamp:
            self._stamp = stamp
            write_text(_clock(self._file), str(self.before + self._seconds()), sync=False)

    def _written(self) -> int:
        """Return when the checkpoint was written, 0 where there is none."""
        with contextlib.suppress(OSError):
            return os.stat(self._file).st_mtime_ns
        return 0
