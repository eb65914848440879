"""Provenance of a packing as one text, with a hash of it and of the grains."""

import hashlib
import math
from collections.abc import Mapping
from typing import Any

from voxgran.measures.model import Groups, Measure, dataset, json_text, variable
from voxgran.packing.model import Packing

#: entries that differ between runs with the same grains; they are recorded but not hashed
NOT_HASHED = ("timing", "wall_seconds")


def content_hash(packing: Packing) -> str:
    """Return the SHA-256 hash, 64 hexadecimal digits, of the record and of the arrays of a packing, without times."""
    return hashlib.sha256(json_text(_record(packing)).encode()).hexdigest()


def _record(packing: Packing) -> dict[str, Any]:
    """Return the hashed record: provenance without times, and the properties of the packing."""
    provenance = {key: value for key, value in packing.provenance.items() if key not in NOT_HASHED}
    arrays = hashlib.sha256()
    for array in (packing.shape_id, packing.scale, packing.position, packing.orientation):
        arrays.update(array.tobytes())
    container = hashlib.sha256(json_text(packing.container.to_mapping()).encode()).hexdigest()
    return {
        "provenance": provenance,
        "stop_reason": packing.stop_reason,
        "unit": packing.unit,
        "density": packing.density,
        "gravity": packing.gravity,
        "contact_gap": packing.contact_gap,
        "container": {"kind": packing.container.kind, "sha256": container},
        "shapes": [{"name": shape.name, "key": shape.key} for shape in packing.shapes],
        "grains": {"count": packing.count, "sha256": arrays.hexdigest()},
    }


def _seconds(provenance: Mapping[str, Any]) -> float:
    """Return the wall time of the run, NaN if unknown."""
    timing = provenance.get("timing")
    seconds = timing.get("wall_seconds") if isinstance(timing, Mapping) else provenance.get("wall_seconds")
    return float(seconds) if isinstance(seconds, int | float) else math.nan


def _compute(packing: Packing) -> Groups:
    """Return the record, its hash and the wall time."""
    told = {key: packing.provenance[key] for key in NOT_HASHED if key in packing.provenance}
    values = {
        "record": variable((), json_text(_record(packing)), "1", "how the packing was made, as JSON"),
        "content_hash": variable((), content_hash(packing), "1", "SHA-256 of the record"),
        "not_hashed": variable((), json_text(told), "1", "times, as JSON"),
        "wall_seconds": variable((), _seconds(packing.provenance), "s", "wall time of the run"),
        "stop_reason": variable((), packing.stop_reason, "1", "why the method stopped"),
    }
    return {"/provenance": dataset(values)}


registration = Measure(
    summary="record of how the packing was made, with a hash", groups=("/provenance",), compute=_compute, tilted=True
)
