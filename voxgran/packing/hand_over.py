"""The packing that a method hands over: placed grains, back from the normalized frame to the user's unit of lengths."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers
from voxgran._base.config import to_mapping
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem


def packing_of_poses(
    problem: Problem,
    placed: Integers,
    *,
    position: Floats,
    orientation: Floats | None,
    provenance: dict[str, Any],
    stop_reason: str,
    gravity: ArrayLike | None,
    contact_gap: float,
    voxel_size: float | None = None,
) -> Packing:
    """Return the packing of grains in the user's unit of lengths.

    Parameters
    ----------
    problem : Problem
        In the normalized frame.
    placed : (m,) ndarray of int
        Which grains.
    position, orientation : ndarray of float
        Their poses, in median diameters; no rotation where left out.
    provenance : dict
        What the method tells beyond its parameters, which are added.
    stop_reason : str
        Empty while there is more to do.
    gravity : (3,) array_like of float or None
        Unit vector in which gravity acts; zero or None where there is none.
    contact_gap : float
        Distance of surfaces up to which the method leaves grains open that touch, in median diameters.
    voxel_size : float, optional
        Edge of a voxel, in median diameters, where there are any.
    """
    shape_id, unit = problem.shape_id[placed], problem.unit_length
    own = np.array([shape.diameter for shape in problem.original])
    resolved = to_mapping(problem.parameters)
    if voxel_size is not None:
        resolved["voxel_size"] = voxel_size * unit
    resolved.update(provenance.get("parameters", {}))
    return Packing.of(
        problem.original,
        problem.container.scaled(unit),
        position=position * unit,
        scale=problem.diameter[placed] * unit / own[shape_id],
        shape_id=shape_id,
        orientation=orientation,
        density=problem.density,
        provenance={**provenance, "parameters": resolved},
        stop_reason=stop_reason or "interrupted",
        unit=problem.unit,
        gravity=gravity if gravity is not None and np.any(gravity) else None,
        contact_gap=contact_gap * unit,
    )
