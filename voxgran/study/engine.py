"""Running a study: what is finished is read, what is left is ordered and computed, and all of it is gathered.

The folder of a study has one file for each run that is finished, under the hash of its scene, written whole.
"""

import contextlib
import hashlib
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from voxgran._base.arrays import as_count
from voxgran._base.cluster import address_of
from voxgran._base.errors import InputError, Interrupted, LongRunWarning, OutputExistsError, PackingWarning, shown, warn
from voxgran._base.files import made_folder, remove_drafts_in, write_text, written_whole
from voxgran._base.lazy import load
from voxgran._base.lock import FOLDER_LOCK, is_left
from voxgran._base.machine import memory_limit, processor_count
from voxgran._base.progress import OnStep, Step
from voxgran._base.stopping import Signals
from voxgran.scene.run import opened_folder
from voxgran.study.cells import Cell
from voxgran.study.dask_runs import DaskRuns
from voxgran.study.durations import SPREAD, Durations, Kind, told_duration
from voxgran.study.executor import Executor
from voxgran.study.files import files_of, run_hash
from voxgran.study.plan import CellPlan, StudyPlan, cell_plan, note_of_beds, told_values
from voxgran.study.processes import Processes
from voxgran.study.result import StudyResult, dataset_of, rows_of, save_results
from voxgran.study.runs import Record, Run, from_text, marked, seconds_before, to_text
from voxgran.study.settings import StudySettings

#: share of the memory of the machine that processes may take
MEMORY_SHARE = 0.8
#: bytes of a unit of memory
UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}
#: seconds between reports of progress
TELL_SECONDS = 0.1
#: number of a cell and number of a seed
Place = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How a study is run; none of it changes a result. The fields are the arguments of :meth:`voxgran.Study.run`.

    Raises
    ------
    InputError
        If a value breaks a rule.
    """

    workers: int | None = None
    memory: int | str | None = None
    dask: Any = None
    retry: bool = False
    overwrite: bool = False
    zarr: bool = False
    on_step: OnStep | None = None

    def __post_init__(self) -> None:
        """Check what can be checked before anything is read."""
        if self.workers is not None:
            as_count(self.workers, "workers", at_least=1)
        memory_bytes(self.memory)
        if self.dask is not None:
            address_of(self.dask)
        if self.zarr:
            load("zarr")


def memory_bytes(given: int | str | None) -> int:
    """Return a limit of memory in bytes: a number, a text such as ``"8 GB"``, or a share of the machine as ``"50%"``.

    Raises
    ------
    InputError
        If it is none of these, or not above 0.
    """
    whole = memory_limit()
    if given is None:
        return int(MEMORY_SHARE * whole)
    text = str(given).strip().lower()
    found = re.fullmatch(r"(\d+\.?\d*)\s*(%|([kmgt]i?)?b?)", text)
    number = float(found[1]) * (whole / 100 if found[2] == "%" else UNITS[found[3] or ""]) if found else 0.0
    if isinstance(given, bool) or not number >= 1:
        raise InputError(f"memory is {shown(given)}: it must be bytes, a text such as '8 GB', or a share such as '50%'")
    return int(number)


@dataclass(frozen=True, slots=True)
class Store:
    """The finished runs in a folder; `packings` is whether their packings are kept too."""

    folder: Path
    packings: bool = False

    def path(self, key: str) -> Path:
        """Return the file of a run."""
        return self.folder / CELLS / f"{key}.json"

    def packing(self, key: str) -> Path:
        """Return the file of the packing of a run."""
        return self.folder / CELLS / f"{key}.vtp"

    def checkpoint(self, key: str) -> Path:
        """Return the file of the checkpoint of a run."""
        return self.folder / CHECKPOINTS / f"{key}.voxgran"

    def read(self, key: str) -> Record | None:
        """Return what a run has left; None where it is not finished, its file is damaged or its packing is missing."""
        try:
            seal, _, rest = self.path(key).read_text(encoding="utf-8").partition("\n")
            text = rest.removesuffix(END)
            record = from_text(text) if seal == _seal(text) else None
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None
        if record is None or (self.packings and not record.failure and not self.packing(key).is_file()):
            return None
        return record

    def write(self, run: Run, record: Record, values: Mapping[str, Any], packing: bytes = b"") -> None:
        """Write what a run has left, with what its values are called, and its packing where it is given as bytes.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        if packing:
            with written_whole(self.packing(run.key)) as draft:
                draft.write_bytes(packing)
        text = to_text(record, {"values": dict(values), "seed": run.seed, "scene": run.mapping})
        # a file that a power cut has damaged is found by its seal, and the run computed again
        write_text(self.path(run.key), f"{_seal(text)}\n{text}{END}", sync=False)

    def refuse_other(self) -> None:
        """Refuse a folder that holds something and no study.

        Raises
        ------
        OutputExistsError
            If it does.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise OutputExistsError(f"{self.folder} is a file: a study needs a folder; name another")
        if not self.folder.is_dir() or (self.folder / CELLS).is_dir():
            return
        if any(entry.name != FOLDER_LOCK and not is_left(entry) for entry in self.folder.iterdir()):
            raise OutputExistsError(f"{self.folder} holds something else than a study: name another folder")


def planned(settings: StudySettings, store: Store) -> StudyPlan:
    """Return the plan of a study with what is finished in its folder.

    Parameters
    ----------
    settings : StudySettings
        The study.
    store : Store
        Its folder.
    """
    rows = []
    for cell in settings.cells:
        found = [_finished(store, cell, seed) for seed in settings.seeds]
        failed = sum(bool(record and record.failure) for record in found)
        left = sum(record is None for record in found)
        rows.append(cell_plan(cell, done=len(found) - left - failed, failed=failed, left=left))
    sides = {dimension.name: len(dimension) for dimension in settings.dimensions}
    return StudyPlan(cells=tuple(rows), seeds=settings.seeds, dimensions=sides)


def _finished(store: Store, cell: Cell, seed: int) -> Record | None:
    """Return what a run has left; None where it is not finished."""
    return store.read(run_hash(cell.key, seed))


def run_study(settings: StudySettings, folder: Path, options: Options) -> StudyResult:
    """Compute what is not finished, and gather all results.

    Parameters
    ----------
    settings : StudySettings
        The study.
    folder : Path
        Its folder.
    options : Options
        How it is run.

    Raises
    ------
    Interrupted
        On SIGINT, SIGTERM or SIGHUP; what is finished is kept. Other errors are those of :meth:`voxgran.Study.run`.
    """
    store = Store(folder, settings.keep == "packings")
    store.refuse_other()
    with opened_folder(folder, resume=True, overwrite=True):
        try:
            remove_drafts_in(made_folder(folder / CELLS), folder / CHECKPOINTS)
            work = _Work(settings, store, options)
            computed = work.do()
            rows = rows_of(settings.cells, settings.seeds, work.records)
            dataset = dataset_of(settings.dimensions, settings.cells, settings.seeds, work.records)
            save_results(dataset, rows, folder, zarr=options.zarr)
        except BaseException:
            for empty in (CELLS, CHECKPOINTS):
                with contextlib.suppress(OSError):
                    (folder / empty).rmdir()
            raise
    return StudyResult(dataset=dataset, rows=rows, folder=folder, computed=computed, experiments=settings.experiments)


def _executor(options: Options, runs: int) -> Executor:
    """Return what computes so many runs."""
    if options.dask is not None:
        return DaskRuns(address_of(options.dask))
    return Processes(min(options.workers or processor_count(), runs), memory_bytes(options.memory))


@dataclass(slots=True)
class _Work:
    """The runs of a study: their records by cell and seed, and those that are left, by their keys."""

    settings: StudySettings
    store: Store
    options: Options
    records: dict[Place, Record] = field(default_factory=dict)
    left: dict[str, tuple[Place, Run]] = field(default_factory=dict)
    durations: Durations = field(default_factory=Durations)
    elapsed: float = 0.0  # seconds that runs have taken now, by the clock
    used: float = 0.0  # CPU seconds of them
    told: float = 0.0
    mark: str = ""

    def do(self) -> int:
        """Read what is finished, and compute what is left; return how many runs were computed.

        Raises
        ------
        Interrupted
            On SIGINT, SIGTERM or SIGHUP.
        """
        missing = self._read()
        computed = 0
        if missing:
            # processes load their libraries while the runs are planned
            executing = _executor(self.options, sum(map(len, missing.values())))
            with executing as executor, marked(self.store.folder / CHECKPOINTS) as self.mark:
                plans = [self._plan(at, numbers) for at, numbers in missing.items()]
                if note := note_of_beds(plans):
                    warn(note, PackingWarning)
                if slow := [plan for plan in plans if plan.slow]:
                    others = f"; so it is with {len(slow) - 1} of the other cells" if len(slow) > 1 else ""
                    warn(f"{told_values(slow[0].values)}: {slow[0].slow}{others}", LongRunWarning)
                computed = self._compute(executor)
        self._fill()
        return computed

    def _read(self) -> dict[int, list[int]]:
        """Read what is finished; return the numbers of the seeds that are left, by the number of the cell."""
        left: dict[int, list[int]] = {}
        for at, cell in enumerate(self.settings.cells):
            for number, seed in enumerate(self.settings.seeds):
                record = None if self.options.overwrite else _finished(self.store, cell, seed)
                if record is None or (record.failure and self.options.retry):
                    left.setdefault(at, []).append(number)
                else:
                    self.records[at, number] = record
        return left

    def _plan(self, at: int, missing: Sequence[int]) -> CellPlan:
        """Note the runs of a cell that are left, or why it cannot be computed, which is asked anew each time."""
        cell, limit = self.settings.cells[at], memory_bytes(self.options.memory)
        plan = cell_plan(cell, done=0, failed=0, left=len(missing))
        refusal = plan.refusal
        if not refusal and self.options.dask is None and plan.memory > limit:
            refusal = (
                f"its {plan.memory / 2**20:.0f} MiB are more than the {limit / 2**20:.0f} MiB that memory allows: give "
                "more memory, at the prompt --memory, or a larger machine"
            )
        for number in missing:
            if refusal:
                self.records[at, number] = Record(failure=refusal)
                continue
            seed = self.settings.seeds[number]
            key = run_hash(cell.key, seed)
            file = str(self.store.packing(key).absolute()) if self.store.packings else ""
            kept = str(self.store.checkpoint(key).absolute())
            run = Run(
                key=key,
                cell=cell.key,
                mapping=cell.mapping,
                seed=seed,
                packing=file,
                checkpoint=kept,
                mark=self.mark,
                memory=plan.memory,
                attempts=plan.attempts,
                grains=plan.grains,
                before=seconds_before(kept),
                files={name: cell.hashes.of(name) for name in files_of(cell.mapping)},
            )
            # two cells may be the same scene, by values that change nothing
            self.left.setdefault(run.key, ((at, number), run))
        return plan

    def _compute(self, executor: Executor) -> int:
        """Compute the runs that are left, the longest first; return how many."""
        total = len(self.left)
        for cell in self.settings.cells:
            self.durations.add(cell.key, cell.mapping)
        for (at, _), record in self.records.items():
            self._note(at, record)
        for _, run in self.left.values():
            self.durations.expect(run.cell, run.attempts, run.grains)
        with Signals() as signals:
            signals.patient = True
            for came in executor.results(self._order()):
                if came is not None:
                    self._keep(*came)
                self._tell(executor)
                if signals.number:
                    raise Interrupted(self._farewell(), signals.number)
        return total

    def _order(self) -> list[Run]:
        """Return the runs that are left, the longest first; before them the shortest and the longest one of each kind
        that was not timed, by which the time that is left is told soon.
        """
        # where nothing is known of the seconds, more attempts and more grains are expected to take longer
        lengths = {
            key: (self.durations.expected(run.cell)[1], run.attempts, run.grains) for key, (_, run) in self.left.items()
        }
        order = sorted((run for _, run in self.left.values()), key=lambda run: lengths[run.key], reverse=True)
        first: list[dict[Kind, Run]] = [{}, {}]
        for found, runs in zip(first, (sorted(order, key=lambda run: lengths[run.key]), order), strict=True):
            for run in runs:
                kind = self.durations.cells[run.cell].kind
                if not self.durations.is_timed(kind):
                    found.setdefault(kind, run)
        return list({run.key: run for runs in (first[0].values(), first[1].values(), order) for run in runs}.values())

    def _keep(self, run: Run, record: Record, packing: bytes) -> None:
        """Keep what a run has left."""
        place, _ = self.left.pop(run.key)
        record.attempts, record.grains = run.attempts, run.grains
        self.store.write(run, record, self.settings.cells[place[0]].values, packing)
        self.records[place] = record
        self._note(place[0], record)
        self.durations.cells[run.cell].left -= 1
        if record.elapsed:
            self.elapsed, self.used = self.elapsed + record.elapsed, self.used + record.seconds - run.before

    def _fill(self) -> None:
        """Give cells that are the same scene the same records."""
        known = {
            run_hash(self.settings.cells[at].key, self.settings.seeds[number]): record
            for (at, number), record in self.records.items()
        }
        for at, cell in enumerate(self.settings.cells):
            for number, seed in enumerate(self.settings.seeds):
                if (at, number) not in self.records:
                    self.records[at, number] = known[run_hash(cell.key, seed)]

    def _note(self, at: int, record: Record) -> None:
        """Note the time of a run of a cell."""
        if not record.failure:
            self.durations.note(self.settings.cells[at].key, record.attempts, record.grains, record.seconds)

    def _left(self, under_way: Sequence[tuple[Run, float]]) -> str:
        """Return in words how long the runs that are left will take, by those that are finished; empty if not known."""
        if not self.left:
            return ""
        # CPU seconds in a second of a run: fewer where others use the processors too
        pace = max(0.01, min(1.0, self.used / self.elapsed)) if self.elapsed else 1.0
        computed = [(run.cell, run.before + seconds * pace) for run, seconds in under_way]
        before = sum(run.before for _, run in self.left.values()) - sum(run.before for run, _ in under_way)
        least, most, late = self.durations.remaining(computed, before)
        if late:
            return ", longer than expected"
        if not least:
            return ""
        known = most <= SPREAD * least
        left = ((least + most) / 2 if known else least) / pace
        still = ", which has not changed for two minutes" * self.durations.stands_still(left, time.monotonic())
        return f", {'about' if known else 'at least'} {told_duration(left)} left{still}"

    def _tell(self, executor: Executor) -> None:
        """Report progress, ten times a second at the most."""
        now, running = time.monotonic(), executor.running
        if self.options.on_step is None or (self.left and now - self.told < TELL_SECONDS):
            return
        self.told = now
        failed = sum(bool(record.failure) for record in self.records.values())
        total = len(self.settings.cells) * len(self.settings.seeds)
        text = f"{len(self.records)} of {total}, {running} running, {failed} failed"
        if executor.compiling:
            # how long that takes is not known
            text += ", compiling kernels (once per machine)"
        elif executor.loading:
            text += ", loading libraries"
        else:
            text += self._left(executor.under_way)
        self.options.on_step(Step(stage="runs", done=len(self.records), total=total, text=text))

    def _farewell(self) -> str:
        """Return the message of a study that was stopped."""
        total = len(self.records) + len(self.left)
        if not self.records:
            return f"stopped before the first of {total} runs was finished: the same command computes them"
        return (
            f"stopped after {len(self.records)} of {total} runs, which are kept: the same command computes the others"
        )


#: folder of the finished runs
CELLS = "cells"
#: folder of the checkpoints of runs that are not finished
CHECKPOINTS = "checkpoints"


#: end of the file of a run
END = "\n}\n"


def _seal(text: str) -> str:
    """Return the first line of a file, by which damage is found; the file as a whole is JSON."""
    return f'{{"sha256": "{hashlib.sha256(text.encode()).hexdigest()}", "run":'
