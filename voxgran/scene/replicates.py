"""Several packings of one scene with different seeds: their mean and its standard error."""

import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.errors import FileFormatError, InputError, MissingFileError, PackingWarning, warn
from voxgran._base.files import as_path, write_text
from voxgran._base.lazy import DataTree, load
from voxgran._base.progress import OnStep, numbered
from voxgran.io.netcdf import save_statistics
from voxgran.io.vtk_files import load_packing
from voxgran.packing.driver import Recorder
from voxgran.packing.model import Packing
from voxgran.report.significance import standard_error
from voxgran.scene.description import SceneDescription
from voxgran.scene.run import PACKING, SUMMARY, SceneResult, opened_folder, run_one


def run_seeds(
    scene: SceneDescription,
    folder: str | os.PathLike[str],
    *,
    resume: bool = False,
    overwrite: bool = False,
    on_step: OnStep | None = None,
    recorder: Recorder | None = None,
) -> SceneResult:
    """Pack a scene once per seed, each in a folder ``seed_K`` of its own, and average; all else as
    :meth:`voxgran.Scene.run` says.

    The folder gets ``summary.json`` and ``statistics.nc`` over all; the result holds packing, verification and
    statistics of the first seed, and a summary of all with their means and standard errors.
    """
    with opened_folder(folder, resume=resume, overwrite=overwrite) as target:
        return _run_in(target, scene, resume=resume, overwrite=overwrite, on_step=on_step, recorder=recorder)


def _run_in(
    target: Path,
    scene: SceneDescription,
    *,
    resume: bool,
    overwrite: bool,
    on_step: OnStep | None,
    recorder: Recorder | None,
) -> SceneResult:
    """Pack a scene once per seed in a folder that no other process uses, and average."""
    first: SceneResult | None = None
    runs: list[dict[str, Any]] = []
    trees: list[DataTree] = []
    for number in range(scene.general.seeds):
        one = _with_seed(scene, number)
        place = target / f"seed_{one.general.seed}"
        told = numbered(on_step, number, scene.general.seeds)
        result = run_one(one, place, resume=resume, overwrite=overwrite, on_step=told, recorder=recorder)
        first = first or result
        runs.append(result.summary)
        trees.append(result.statistics)
    assert first is not None
    summary = averaged(runs)
    if scene.twin is not None:
        made = [load_packing(target / f"seed_{run['seed']}" / PACKING) for run in runs]
        summary |= scene.twin.told(made, target, scene.output, on_step)
    save_statistics(_joined(trees, [run["seed"] for run in runs]), target / "statistics.nc", overwrite=True)
    write_text(target / SUMMARY, json.dumps(summary, indent=2) + "\n")
    return replace(first, summary=summary, folder=target)


def packings_of_run(folder: str | os.PathLike[str]) -> list[Packing]:
    """Read the packings that a run has left in ``packing.vtp`` of a folder or of its folders ``seed_K``, in the order
    of the seeds; a seed without packing is left out with a `PackingWarning`.

    Raises
    ------
    MissingFileError
        If there is no such folder.
    InputError
        If there is no packing in it.
    FileFormatError
        If a packing or the summary is damaged.
    """
    target = as_path(folder)
    if not target.is_dir():
        raise MissingFileError(f"{target} is not there: name a folder that 'voxgran run' wrote")
    places = _seed_folders(target) or [target]
    found = [place / PACKING for place in places if (place / PACKING).is_file()]
    if not found:
        raise InputError(
            f"{target} holds no packing: {PACKING} is missing there and in folders seed_K; name a folder that "
            "'voxgran run' wrote"
        )
    for place in places:
        if not (place / PACKING).is_file():
            warn(f"{place} holds no {PACKING}: it is left out; run the scene again with --resume", PackingWarning)
    return [load_packing(path) for path in found]


def _seed_folders(target: Path) -> list[Path]:
    """Return the folders of the seeds of a run, in their order; none where it had a single one."""
    summary = target / SUMMARY
    if summary.is_file():
        # what an earlier run with more seeds has left is not of this one
        try:
            record = json.loads(summary.read_text(encoding="utf-8"))
        except (ValueError, RecursionError):
            raise FileFormatError(f"{summary} is no JSON: it is cut or damaged; run the scene again") from None
        seeds = record.get("seeds") if isinstance(record, dict) else None
        return [target / f"seed_{seed}" for seed in seeds if type(seed) is int] if isinstance(seeds, list) else []
    if (target / PACKING).is_file():
        return []
    numbered = [place for place in target.glob("seed_*") if place.name.removeprefix("seed_").isdecimal()]
    return sorted(numbered, key=lambda place: int(place.name.removeprefix("seed_")))


def averaged(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the summary over the summaries of several runs: seeds, mean and standard error of each number that all
    have (standard deviation over the root of the number of runs), whether all are verified, and the summaries.
    """
    numbers = [
        name
        for name, value in runs[0].items()
        if isinstance(value, int | float)
        and not isinstance(value, bool)
        and name != "seed"
        and all(isinstance(run.get(name), int | float) for run in runs)
    ]
    values = {name: np.array([run[name] for run in runs], dtype=np.float64) for name in numbers}
    return {
        "method": runs[0].get("method", ""),
        "seeds": [run["seed"] for run in runs],
        "mean": {name: float(value.mean()) for name, value in values.items()},
        "standard_error": {name: standard_error(value) for name, value in values.items()},
        "verify": {"ok": all(run["verify"]["ok"] for run in runs)},
        "runs": list(runs),
    }


def _with_seed(scene: SceneDescription, number: int) -> SceneDescription:
    """Return the scene of one seed; only the first one is drawn and shown."""
    output = scene.output if number == 0 else replace(scene.output, vtk=False, report=False, snapshots=0)
    # all seeds are compared with the sample together
    twin = None if scene.twin is None else replace(scene.twin, compares=False)
    general = replace(scene.general, seed=scene.general.seed + number, seeds=1)
    return replace(scene, general=general, output=output, twin=twin)


def _joined(trees: "Sequence[DataTree]", seeds: Sequence[int]) -> "DataTree":
    """Return the numbers of all packings along a dimension ``seed``."""
    xarray = load("xarray")
    scalars = [
        tree.dataset[[name for name, value in tree.dataset.data_vars.items() if not value.ndim]] for tree in trees
    ]
    common = [name for name in scalars[0].data_vars if all(name in one for one in scalars)]
    joined = xarray.concat([one[common] for one in scalars], dim="seed", combine_attrs="drop_conflicts")
    tree: DataTree = xarray.DataTree(joined.assign_coords(seed=list(seeds)), name="measures")
    return tree
