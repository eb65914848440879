"""Tables of a report: rows of label, value and note, as texts."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.lazy import DataTree
from voxgran.contacts.assembly import density_text
from voxgran.contacts.forces import AT_REST
from voxgran.contacts.verify import Verification
from voxgran.measures.registered.density import main_fraction
from voxgran.measures.registered.gradation import size_classes
from voxgran.measures.registered.segregation import warning_of
from voxgran.packing.model import Packing

#: name of the mean coordination number at the contact gap, and share of grains at rest of a bed that is
MEAN_NUMBER, MOSTLY = "mean_coordination_number", 0.95


@dataclass(frozen=True, slots=True)
class Fact:
    """One line of a table or one headline number; `tone` is the assessment of the value: ``""``, ``"good"`` or
    ``"bad"``.
    """

    label: str
    value: str
    note: str = ""
    tone: str = ""


def number(value: Any) -> str:
    """Return a number, a flag or anything else as text: four digits, with separators of thousands."""
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, bool):
        return "yes" if plain else "no"
    if isinstance(plain, int):
        return f"{plain:,}".replace(",", "\u202f").replace("-", "\u2212")
    if isinstance(plain, float):
        return "not known" if math.isnan(plain) else f"{plain:.4g}".replace("-", "\u2212")
    return "none" if plain is None else str(plain)


def decimals_of(error: float) -> int | None:
    """Return how many decimals a number has whose error is written with two digits; None where that is not 0 to 6."""
    digits = 1 - math.floor(math.log10(error)) if error > 0 else -1
    return digits if 0 <= digits <= 6 else None


def headline(packing: Packing, statistics: "DataTree | None", verification: "Verification | None") -> list[Fact]:
    """Return the most important numbers of a packing, its measures and its verification."""
    space = "volume" if packing.dimension == 3 else "area"
    region, fraction = main_fraction(packing, statistics)
    notes = {
        "bulk": "of the bulk: away from walls and the free surface",
        "bed": "of the bed: below its free surface, from wall to wall; too few grains lie away from walls",
        "container": f"true grain {space} / container {space}",
    }
    facts = [
        Fact("grains", number(packing.count), f"stopped: {packing.stop_reason.replace('_', ' ')}"),
        Fact("solid fraction", f"{fraction:.4f}", notes[region]),
        Fact("porosity", f"{1.0 - fraction:.4f}", "1 \u2212 solid fraction"),
    ]
    if region != "container":
        whole = f"true grain {space} / container {space}, with the room above the bed"
        facts.append(Fact("solid fraction of the container", f"{packing.solid_fraction:.4f}", whole))
    bulk = scalar(statistics, "bulk_solid_fraction")
    if region == "container" and bulk is not None:
        note = "away from walls" if math.isfinite(bulk) else "too few grains away from walls"
        facts.append(Fact("bulk solid fraction", f"{bulk:.4f}" if math.isfinite(bulk) else "not known", note))
    strict = scalar(statistics, "strict_solid_fraction")
    if strict is not None:
        facts.append(Fact("strict solid fraction", f"{strict:.4f}", "all grains shrunk until none overlap"))
    facts += _rest(packing, statistics)
    if verification is None:
        facts.append(Fact("verified", "not run", "true shapes were not checked"))
    elif verification.ok:
        facts.append(Fact("verified", "yes", "true shapes: no overlap, no escape", "good"))
    else:
        facts.append(Fact("verified", "no", "see the table of the verification", "bad"))
    return facts


def _rest(packing: Packing, statistics: "DataTree | None") -> list[Fact]:
    """Return the numbers of a bed: neighbours, how many grains rest, and whether it is sorted by size."""
    facts = []
    neighbours = scalar(statistics, MEAN_NUMBER)
    if statistics is not None and neighbours is not None and math.isfinite(neighbours):
        facts.append(Fact("coordination number", f"{neighbours:.2f}", str(statistics[MEAN_NUMBER].attrs["long_name"])))
    among = scalar(statistics, "coordination_without_rattlers")
    if statistics is not None and among is not None and math.isfinite(among):
        share = 100 * float(statistics["share_of_rattlers"])
        definition = str(statistics["share_of_rattlers"].attrs["definition"])
        note = f"{share:.1f} % of the grains are rattlers: {definition}"
        facts.append(Fact("without rattlers", f"{among:.2f}", note))
    forces = packing.forces if packing.count else None
    if forces is not None:
        rest = forces.share_at_rest
        tone = "good" if rest >= MOSTLY else "bad"
        note = f"grains with a residual below {AT_REST:g} {forces.unit_of_residual}"
        if among is None:
            note += f"; {100 * forces.share_of_rattlers:.1f} % are rattlers"
        facts.append(Fact("at rest", f"{100 * rest:.1f} %", note, tone))
    sorted_by_size = scalar(statistics, "segregation")
    if sorted_by_size is not None and math.isfinite(sorted_by_size):
        warning = warning_of(sorted_by_size, packing.count)
        note = warning or "rank correlation of diameter and height"
        random_order = scalar(statistics, "layer_p_value")
        if random_order is not None and math.isfinite(random_order):
            note += f"; gradations of layers differ as much in random order with a probability of {random_order:.2g}"
        facts.append(
            Fact("segregation", f"{sorted_by_size:.2f}".replace("-", "\u2212"), note, "bad" if warning else "")
        )
    by_density = scalar(statistics, "density_segregation")
    if by_density is not None and math.isfinite(by_density):
        note = "rank correlation of density and height: below 0 where heavy grains lie below light ones"
        facts.append(Fact("density segregation", f"{by_density:.2f}".replace("-", "\u2212"), note))
    return facts


def scalar(statistics: "DataTree | None", name: str) -> float | None:
    """Return a number of the root of the statistics, None if absent."""
    if statistics is None or name not in statistics.data_vars:
        return None
    return float(statistics[name])


def details(packing: Packing) -> list[Fact]:
    """Return how the packing was made, from its provenance."""
    record, unit = packing.provenance, packing.unit
    arrays = ("vertices", "faces", "corners", "holes")
    container = {key: value for key, value in packing.container.to_mapping().items() if key not in arrays}
    kind = str(container.pop("kind"))
    facts = [
        Fact("method", number(record.get("method"))),
        Fact("parameters", _pairs(record.get("parameters", {}))),
        Fact("seed", number(record.get("seed"))),
        Fact("container", f"{kind}: {_pairs(container)}" if container else kind),
        Fact("unit of lengths", "not given" if unit == "1" else unit),
        Fact("density of the material", density_text(packing.density, ".4g")),
    ]
    if packing.count:
        low, middle, high = (number(float(v)) for v in np.quantile(packing.diameters, [0.0, 0.5, 1.0]))
        facts.append(Fact("equivalent diameter", f"{low} to {high}, median {middle}"))
    for key in ("asked", "placed", "missed", "tiled", "counters", "assumed"):
        if record.get(key):
            facts += _missed(record) if key == "missed" else [Fact(key, _pairs(record[key]))]
    seconds = record.get("timing", {}).get("wall_seconds")
    return [*facts, Fact("wall time", f"{number(float(seconds))} s")] if seconds is not None else facts


def sieve_rows(packing: Packing) -> list[tuple[str, str, str, str]]:
    """Return a row for each class of sizes, the largest first: its ends, and its shares of the mass as requested and as
    placed, in percent, with their difference; no rows without a requested distribution.
    """
    found = size_classes(packing)
    if found is None:
        return []
    ends, asked, placed = found
    rows = [
        (f"{number(float(low))} to {number(float(high))}", *(f"{100 * share:.2f}" for share in shares))
        for low, high, *shares in zip(ends[:-1], ends[1:], asked, placed, placed - asked, strict=True)
    ]
    return [(name, one, two, three.replace("-", "\u2212")) for name, one, two, three in reversed(rows)]


def _missed(record: Mapping[str, Any]) -> list[Fact]:
    """Return the differences from the request; the distance of the sizes has a row of its own."""
    missed = record["missed"]
    if not isinstance(missed, Mapping) or "gradation" not in missed:
        return [Fact("missed", _pairs(missed))]
    note = (
        "largest difference, by number, between the share up to a size of the grains that were drawn for this run and "
        "that of those of them that were placed (Kolmogorov\u2013Smirnov)"
    )
    note += ", before they grew" if "growth" in record else ""
    others = {key: value for key, value in missed.items() if key != "gradation"}
    return [Fact("missed", _pairs(others)), Fact("sizes, placed against drawn", number(missed["gradation"]), note)]


def shape_names(packing: Packing) -> list[str]:
    """Return the names of the shapes, with their density where densities differ."""
    names = [shape.name for shape in packing.shapes]
    if not isinstance(packing.density, tuple):
        return names
    return [f"{name} (density {number(density)})" for name, density in zip(names, packing.density, strict=True)]


def shape_rows(packing: Packing) -> list[tuple[str, str, str, str]]:
    """Return name, geometry, grains and share by volume of each shape, the most frequent first."""
    counts = np.bincount(packing.shape_id, minlength=len(packing.shapes))
    volumes = np.bincount(packing.shape_id, weights=packing.volumes, minlength=len(packing.shapes))
    whole = max(float(volumes.sum()), 1e-300)
    rows, names = [], shape_names(packing)
    for index in np.argsort(-counts, kind="stable"):
        geometry = packing.shapes[index].geometry
        kind = str(getattr(geometry, "kind", type(geometry).__name__.lower()))
        rows.append((names[index], kind, number(counts[index]), f"{100 * volumes[index] / whole:.1f} %"))
    return rows


def proof_rows(verification: "Verification") -> list[Fact]:
    """Return the results of the verification, one row per number."""
    notes = {
        "ok": "no overlap and no escape beyond the tolerance",
        "tolerance": "in mean diameters, the same for all methods",
        "deepest": "largest depth of one grain in another, in mean diameters",
        "overlapping_pairs": "pairs of grains that overlap beyond the tolerance",
        "escaped": "grains that reach through a wall beyond the tolerance",
        "largest_escape": "how far the worst of them, in mean diameters",
        "count": "grains that were looked at",
        "pair_tests": "pairs near enough for an exact test",
        "mean_diameter": "the unit of depths, in the unit of lengths",
        "touching_at": "factor on all sizes at which none overlap or escape",
    }
    rows = []
    for field in dataclasses.fields(verification):
        value = getattr(verification, field.name)
        if isinstance(value, bool | int | float | str | np.generic):
            tone = ("good" if value else "bad") if field.name == "ok" else ""
            rows.append(Fact(field.name.replace("_", " "), number(value), notes.get(field.name, ""), tone))
    return rows


def worst_rows(found: Sequence[Any]) -> list[list[str]]:
    """Return head and rows of the ten worst pairs or escapes, empty if there are none."""
    if not found:
        return []
    names = [field.name for field in dataclasses.fields(found[0])]
    rows = [[_inner(getattr(one, name)) for name in names] for one in found[:10]]
    return [[name.replace("_", " ") for name in names], *rows]


def _pairs(value: Any) -> str:
    """Return a mapping as text: name value, name value, without entries that are None."""
    if isinstance(value, list | tuple):
        return ", ".join(_inner(item) for item in value)
    if not isinstance(value, Mapping):
        return number(value)
    parts = [f"{str(key).replace('_', ' ')} {_inner(item)}" for key, item in value.items() if item is not None]
    return ", ".join(parts) or "none"


def _inner(value: Any) -> str:
    """Return a value inside a mapping or list as text, in brackets if it has parts."""
    return f"({_pairs(value)})" if isinstance(value, Mapping | list | tuple) else number(value)
