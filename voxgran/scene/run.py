"""Running a scene: pack, check, measure and save."""

import contextlib
import json
import math
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from voxgran._base.checkpoint import remove_checkpoint
from voxgran._base.errors import CheckpointError, InputError, OutputExistsError, PackingWarning, warn
from voxgran._base.files import as_path, refuse_links, remove_drafts_in, write_text
from voxgran._base.guarded import refused
from voxgran._base.lazy import DataTree, loaded
from voxgran._base.lock import FOLDER_LOCK, is_left, locked_folder
from voxgran._base.progress import OnStep, Step, repeated
from voxgran.contacts.verify import Verification, verify
from voxgran.decks.engine import engine_registry
from voxgran.decks.write import Deck, write_deck
from voxgran.io.files import load, save
from voxgran.io.netcdf import save_statistics
from voxgran.io.series import Series
from voxgran.io.vtk_files import save_scene
from voxgran.measures.model import measure
from voxgran.measures.registered.density import main_numbers
from voxgran.packing.beds.layers import pack_layers
from voxgran.packing.driver import Recorder
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.report.page import save_report
from voxgran.scene.checked_sections import compressed
from voxgran.scene.description import SceneDescription
from voxgran.scene.plan import DECKS, Plan, make_plan
from voxgran.shapes.model import Shape

CHECKPOINT, COMPRESSING = "checkpoint.voxgran", "compression.voxgran"
SUMMARY = "summary.json"
PACKING = "packing.vtp"
#: measures that a summary has, where they are measured and not NaN
NUMBERS = (
    "bulk_solid_fraction",
    "bed_solid_fraction",
    "strict_solid_fraction",
    "mean_coordination_number",
    "coordination_without_rattlers",
    "contact_anisotropy",
    "segregation",
    "density_segregation",
    "layer_p_value",
    "share_at_rest",
    "share_of_rattlers",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneResult:
    """What a run left.

    Attributes
    ----------
    packing : Packing
        The packing.
    verification : Verification
        Its check against the true shapes.
    statistics : xarray.DataTree
        Its measures.
    summary : dict
        The main numbers, JSON-able.
    folder : Path
        Where the files are.
    """

    packing: Packing
    verification: Verification
    statistics: "DataTree"
    summary: dict[str, Any]
    folder: Path


def run_one(
    scene: SceneDescription,
    folder: str | os.PathLike[str],
    *,
    resume: bool,
    overwrite: bool,
    on_step: OnStep | None,
    recorder: Recorder | None = None,
) -> SceneResult:
    """Pack, check, measure and save a scene with its first seed; all else as :meth:`voxgran.Scene.run` says."""
    place = as_path(folder)
    if resume and is_complete(place) and not (place / FOLDER_LOCK).exists():
        return read_folder(scene, place)
    plan, grains = make_plan(scene), tuple(grain for entry in scene.shapes for grain in entry.grains())
    with opened_folder(folder, resume=resume, overwrite=overwrite) as target:
        if resume and is_complete(target):
            return read_folder(scene, target)
        return _run_in(target, scene, plan, grains, resume=resume, on_step=on_step, recorder=recorder)


def _run_in(
    target: Path,
    scene: SceneDescription,
    plan: Plan,
    grains: tuple[tuple[Shape, dict[str, Any] | None], ...],
    *,
    resume: bool,
    on_step: OnStep | None,
    recorder: Recorder | None,
) -> SceneResult:
    """Pack, check, measure and save a scene in a folder that no other process uses."""
    checkpoint = target / CHECKPOINT
    kept = [target / COMPRESSING, *_checkpoints(scene, checkpoint)]
    if not resume:
        for path in kept:
            remove_checkpoint(path)
    if scene.output.snapshots and recorder is None:
        place, most = target / "snapshots.pvd", scene.output.snapshots
        recorder = Series(place, max_snapshots=most, every=plan.grains, resume=resume, overwrite=True)
    run: dict[str, Any] = {"checkpoint": checkpoint, "resume": resume, "on_step": on_step, "recorder": recorder}
    packing = pack_scene(scene, tuple(shape for shape, _ in grains), **run)
    packing = compressed(scene.compress, packing, checkpoint=target / COMPRESSING, resume=resume, on_step=on_step)
    clumps = [record for _, record in grains]
    told = {"scene": scene.to_mapping()} | ({"clumps": clumps} if any(clumps) else {})
    packing = replace(packing, provenance={**packing.provenance, **told})
    result = finish_folder(packing, target, scene=scene, on_step=on_step)
    result.summary["plan"] = plan.to_mapping()
    if scene.twin is not None:
        result.summary.update(scene.twin.told([packing], target, scene.output, on_step))
    write_text(target / SUMMARY, json.dumps(result.summary, indent=2) + "\n")
    for path in kept:
        remove_checkpoint(path)
    return result


def pack_scene(
    scene: SceneDescription, shapes: tuple[Shape, ...], *, checkpoint: Path | None = None, **run: Any
) -> Packing:
    """Return the packing of a scene with these shapes, with options of the run of :func:`voxgran.pack`.

    Each layer has a checkpoint of its own.
    """
    if scene.twin is not None:
        return scene.twin.request.packed(scene.general.seed, checkpoint=checkpoint, **run)
    if not scene.layers:
        return pack(shapes, scene.container, **scene.asked(), checkpoint=checkpoint, **run, **scene.parameters)
    density, given, at = scene.density(), [], 0
    places = [None] * len(scene.layers) if checkpoint is None else _checkpoints(scene, checkpoint)
    for layer, place in zip(scene.layers, places, strict=True):
        shares = [share for entry in layer.shapes for share in entry.shares()]
        here = slice(at, at + len(shares))
        own = {name: getattr(layer, name) for name in ("count", "height", "sizes", "orientations")}
        own["density"] = density[here] if isinstance(density, list) else density
        kept = {name: value for name, value in own.items() if value is not None}
        given.append({"shapes": shapes[here], "weights": shares, "checkpoint": place, **kept})
        at += len(shares)
    asked = {name: scene.asked()[name] for name in ("seed", "unit", "settle")}
    rest = {name: value for name, value in scene.parameters.items() if name != "height"}
    return pack_layers(given, scene.container, scene.method, **asked, **run, **rest)


def _checkpoints(scene: SceneDescription, checkpoint: Path) -> list[Path]:
    """Return the checkpoints of a run: that of the packing, or one of each layer."""
    return [checkpoint.with_name(f"{checkpoint.name}.{k}") for k in range(len(scene.layers))] or [checkpoint]


def is_complete(folder: Path) -> bool:
    """Return whether a run has left all of its results in a folder, and no checkpoint to go on from."""
    return (folder / SUMMARY).is_file() and (folder / PACKING).is_file() and not (folder / CHECKPOINT).exists()


def read_folder(scene: SceneDescription, folder: Path) -> SceneResult:
    """Return the results that a run has left, checked and measured anew; nothing is packed.

    Raises
    ------
    CheckpointError
        If they are those of another scene.
    FileFormatError
        If the packing or the summary is damaged.
    """
    packing = load(folder / PACKING)
    if packing.provenance.get("scene") != json.loads(json.dumps(scene.to_mapping())):
        raise CheckpointError(
            f"{folder} holds the packing of another scene: resume with the scene that wrote it, or ask with --overwrite"
        )
    with refused(folder / SUMMARY):
        summary = dict(json.loads((folder / SUMMARY).read_text(encoding="utf-8")))
    proof, statistics = verify(packing), measure(packing, which=scene.which)
    return SceneResult(packing=packing, verification=proof, statistics=statistics, summary=summary, folder=folder)


@contextlib.contextmanager
def opened_folder(folder: str | os.PathLike[str], *, resume: bool, overwrite: bool) -> Iterator[Path]:
    """Give the folder for results, made if needed, and keep other processes from it (context manager);
    drafts that killed processes left there are removed.

    Raises
    ------
    OutputExistsError
        If it holds something and neither `resume` nor `overwrite` is set.
    InUseError
        If another process writes into it.
    OutputError
        If it cannot be made or written to, or a link in it leads to another place.
    """
    target = as_path(folder)
    if target.exists() and not target.is_dir():
        raise OutputExistsError(f"{target} is a file: results need a folder; name another")
    # a link to a folder that is not there yet makes that folder
    with locked_folder(os.path.realpath(target)):
        if not (resume or overwrite) and any(
            entry.name != FOLDER_LOCK and not is_left(entry) for entry in target.iterdir()
        ):
            raise OutputExistsError(f"{target} is not empty: name another folder, or ask with --overwrite or --resume")
        refuse_links(target)
        remove_drafts_in(target)
        yield target


def finish_folder(
    packing: Packing, folder: Path, *, scene: SceneDescription, on_step: OnStep | None = None
) -> SceneResult:
    """Check, measure and save a packing.

    Raises
    ------
    OutputError
        If something cannot be written.
    """
    began = time.monotonic()
    with repeated(on_step) as told:

        def tell(number: int, text: str) -> None:
            told(Step(stage="finishing", done=number, total=5, text=text))

        tell(0, "verifying")
        proof = verify(packing, on_step=told)
        save(packing, folder / PACKING, overwrite=True)
        tell(1, "measuring")
        statistics = measure(packing, which=scene.which)
        if scene.output.statistics:
            save_statistics(statistics, folder / "statistics.nc", overwrite=True)
        tell(2, "writing surfaces")
        if scene.output.vtk:
            save_scene(packing, folder / "scene.vtm", overwrite=True)
        tell(3, "drawing the report")
        if scene.output.report:
            save_report(
                packing,
                folder / "report.html",
                statistics=statistics,
                verification=proof,
                interactive=scene.output.interactive,
                overwrite=True,
            )
        tell(4, "writing input of engines")
        decks = _write_decks(packing, folder / DECKS, scene)
        tell(5, "done")
    summary = summary_of(packing, proof, statistics) | ({"dem": decks} if decks else {})
    summary["seconds_finishing"] = time.monotonic() - began
    return SceneResult(packing=packing, verification=proof, statistics=statistics, summary=summary, folder=folder)


def _write_decks(packing: Packing, folder: Path, scene: SceneDescription) -> dict[str, str]:
    """Write the input of all engines that the scene names; warn of grains that one cannot hold. Return the file that
    each engine starts with.
    """
    written = {}
    for engine in scene.output.dem:
        try:
            written[engine] = f"{DECKS}/{deck_of(packing, folder, scene, engine).files[0].name}"
        except InputError as error:
            # all else that was computed stays
            warn(f"input for {engine} is not written: {error}", PackingWarning)
    return written


def deck_of(packing: Packing, folder: Path, scene: SceneDescription, engine: str) -> Deck:
    """Write the input of an engine with the material and the clumps of a scene.

    Raises
    ------
    InputError
        If the engine cannot hold the grains.
    """
    # solids that an engine holds as they are stay what they are
    solid = next(kind for kind in engine_registry().get(engine).kinds if kind != "sphere")
    clump = scene.output.clump if solid == "clump" else None
    return write_deck(packing, folder, engine, material=scene.material, clump=clump, overwrite=True)


def summary_of(packing: Packing, proof: Verification, statistics: "DataTree") -> dict[str, Any]:
    """Return the main numbers of a packing, JSON-able; solid fraction and porosity are those of the `region`."""
    record = packing.provenance
    numbers = {name: float(statistics[name]) for name in NUMBERS if name in statistics}
    numbers = {name: value for name, value in numbers.items() if math.isfinite(value)}
    return {
        "method": record.get("method", ""),
        "seed": record.get("seed", 0),
        "grains": packing.count,
        **({} if packing.fixed is None else {"fixed_grains": int(packing.fixed.sum())}),
        **main_numbers(packing, statistics),
        **numbers,
        "stop_reason": packing.stop_reason,
        "verify": {name: getattr(proof, name) for name in ("ok", "overlapping_pairs", "deepest", "escaped")},
        "counters": dict(record.get("counters", {})),
        "missed": dict(record.get("missed", {})),
        "seconds_packing": record.get("timing", {}).get("wall_seconds", 0.0),
        "libraries": list(loaded()),
    }
