"""The demo: scanned rocks and random solids packed in a box, settled until they rest, proven against their true meshes,
measured, saved and shown.
"""

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from voxgran._base.files import write_text
from voxgran._base.lazy import DataTree
from voxgran._base.progress import OnStep
from voxgran.contacts.verify import Verification, verify
from voxgran.containers.kinds.box import Box
from voxgran.io.data_files import data_file
from voxgran.io.files import save
from voxgran.io.netcdf import save_statistics
from voxgran.io.vtk_files import save_scene
from voxgran.measures.model import measure
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.report.page import Shown, draw_pictures, write_page
from voxgran.scene.processes import Process, compute, start
from voxgran.scene.run import opened_folder, summary_of
from voxgran.shapes.family import make_shape
from voxgran.shapes.files import load_shape
from voxgran.shapes.sizes import lognormal

#: scanned bodies, with their share by number; each of the four random solids has the share 1
SCANS = {"eros.obj": 1.0, "itokawa_lp.obj": 1.0, "bennu_lp.obj": 1.0}
SEEDS = (1, 2, 3, 4)
GRAINS = 340
#: short walks, which leave loose beds: true shapes settle after them
PARAMETERS: dict[str, dict[str, Any]] = {
    "digital": {"voxel_size": 1 / 16, "sweeps": 200, "orientations": 48},
    "control_point": {"sweeps": 20},
}
#: measures in the table of the methods
SHOWN = ("bulk_solid_fraction", "mean_coordination_number", "share_at_rest", "segregation")
#: coefficient of friction of the rocks
FRICTION = 0.3


def run_demo(
    folder: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    on_step: OnStep | None = None,
    on_row: Callable[[dict[str, Any]], None] | None = None,
    grains: int = GRAINS,
) -> list[dict[str, Any]]:
    """Pack and settle the same grains by both methods and leave files, statistics and a page; return one row per
    method: grains, solid fractions, coordination, share at rest, verification, seconds.

    `on_row` is told of each row as soon as its bed is saved, before the page is made.

    Raises
    ------
    OutputExistsError
        If the folder holds something and `overwrite` is not set.
    InUseError
        If another process writes into the folder.
    OutputError
        If something cannot be written.
    MissingFileError
        If the scans are not installed.
    """
    with opened_folder(folder, resume=False, overwrite=overwrite) as target:
        return _run_in(target, grains, on_step, on_row)


def _run_in(
    target: Path, grains: int, on_step: OnStep | None, on_row: Callable[[dict[str, Any]], None] | None
) -> list[dict[str, Any]]:
    """Pack, check, measure and draw in a folder that no other process uses."""
    rows = []

    def keep(result: _Result, stem: str) -> _Result:
        """Save a bed with its numbers, and tell them."""
        save(result.packing, target / f"packing{stem}.vtp", overwrite=True)
        save_statistics(result.statistics, target / f"statistics{stem}.nc", overwrite=True)
        numbers = summary_of(result.packing, result.proof, result.statistics)
        write_text(target / f"summary{stem}.json", json.dumps(numbers, indent=2, default=str) + "\n")
        rows.append(_row(result, numbers))
        if on_row is not None:
            on_row(rows[-1])
        return result

    # one core each: the second method works in a process of its own while the first shows its progress here
    with start(compute, Process) as other:
        other.connection.send(partial(packed, "control_point", grains))
        first = keep(packed("digital", grains, on_step), "")
        keep(other.receive(), "_control_point")
        # it draws while this process computes what else the page shows
        other.connection.send(partial(draw_pictures, first.packing))
        save_scene(first.packing, target / "scene.vtm", overwrite=True)
        write_page(
            first.packing,
            target / "report.html",
            Shown(other.receive),
            statistics=first.statistics,
            verification=first.proof,
            pictures_folder=target,
            title="Scanned rocks and random solids in a box",
            comparisons={str(row["method"]): row for row in rows},
            overwrite=True,
        )
    return rows


@dataclass(frozen=True, slots=True)
class _Result:
    """One packing with its proof, its measures and the seconds that packing took."""

    packing: Packing
    proof: Verification
    statistics: "DataTree"
    seconds: float


def packed(method: str, grains: int, on_step: OnStep | None = None) -> _Result:
    """Pack the grains by one method of `PARAMETERS`, let them settle, prove and measure."""
    shapes = [
        *(load_shape(data_file(name)) for name in SCANS),
        *(make_shape("solid_union", seed=seed) for seed in SEEDS),
    ]
    box = Box((8, 8, 14), periodic=(True, True, False))
    began = time.monotonic()
    asked: dict[str, Any] = {"count": grains, "sizes": lognormal(1.0, 0.2), "seed": 1, "settle": {"friction": FRICTION}}
    packing = pack(shapes, box, method=method, on_step=on_step, **asked, **PARAMETERS[method])
    seconds = time.monotonic() - began
    return _Result(packing, verify(packing), measure(packing), seconds)


def _row(result: _Result, numbers: dict[str, Any]) -> dict[str, Any]:
    """Return one row of the table."""
    proof = result.proof
    return {
        **{name: numbers[name] for name in ("method", "grains", "solid_fraction")},
        **{name: numbers.get(name, float("nan")) for name in SHOWN},
        "verify": "ok" if proof.ok else f"{proof.overlapping_pairs} overlaps, {proof.escaped} escaped",
        "deepest": proof.deepest,
        "seconds": result.seconds,
        "stop_reason": numbers["stop_reason"],
    }
