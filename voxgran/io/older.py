"""Fields of packings that files of earlier versions hold in their provenance; nothing else reads them there."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from voxgran._base.errors import InputError
from voxgran.containers.gravity import Down, as_down
from voxgran.containers.model import Container
from voxgran.shapes.sizes import SizeDistribution, make_sizes


def fields_of(provenance: Mapping[str, Any], container: Container, diameters: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Return gravity, contact gap and asked sizes as keyword arguments of :meth:`voxgran.Packing.of`, from provenance,
    container and equivalent diameters (n,) of the grains, as measures took them.
    """
    stated = _mapping(provenance.get("parameters"))
    voxel, spacing = stated.get("voxel_size"), stated.get("spacing")
    gaps = [float(voxel)] if isinstance(voxel, int | float) else []
    if isinstance(spacing, int | float) and len(diameters):
        gaps.append(float(spacing) * float(provenance.get("median_diameter", np.median(diameters))))
    sizes = provenance.get("sizes") or _mapping(provenance.get("asked")).get("sizes")
    return {
        "gravity": _gravity(stated.get("gravity"), container),
        "contact_gap": max([0.0, *gaps]),
        "asked_sizes": _sizes(sizes),
    }


def _mapping(value: Any) -> Mapping[str, Any]:
    """Return a mapping, empty in place of anything else."""
    return value if isinstance(value, Mapping) else {}


def _sizes(stated: Any) -> SizeDistribution | None:
    """Return the distribution of a record, None where it is none."""
    try:
        return make_sizes(stated) if isinstance(stated, Mapping) else None
    except InputError:
        return None


def _gravity(stated: Any, container: Container) -> Down | None:
    """Return the direction of gravity, the usual one where nothing was stated, None where it cannot be."""
    try:
        return as_down("down" if stated is None else stated, container)
    except InputError:
        return None
