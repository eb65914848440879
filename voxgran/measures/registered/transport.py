"""Steady diffusion through the pores: effective diffusivity, effective porosity and tortuosity factor along each axis.

The pores are those of the measure `voids`, on voxels of the same size: in beds those below the height that holds
85 % of the volume of the grains. Three voxels along each axis make a cell; errors are the differences from the numbers
of cells of two voxels.
"""

import math

import numpy as np

from voxgran._base.arrays import as_length
from voxgran.lattice.diffusion import Diffusivity, diffusivity_of
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.pores import pores_of
from voxgran.measures.registered.voids import default_voxel_size
from voxgran.packing.model import Packing

#: variables with their meanings
MEANINGS = {
    "effective_diffusivity": "diffusivity through the pores along {} over that in the free fluid",
    "effective_porosity": "share of the region that is pores connecting its two sides along {}",
    "tortuosity_factor": "effective porosity over effective diffusivity along {}",
}


def transport(packing: Packing, *, voxel_size: float | None = None, block: int = 3) -> Diffusivity:
    """Return the diffusivity of the pore space along each axis, (d,), on voxels as those of `voids` by default.

    Raises
    ------
    InputError
        If the voxel size is not above 0, a grain is an open surface, or the container is tilted.
    TooLargeError
        If there are more than 2**31 voxels.
    """
    size = default_voxel_size(packing) if voxel_size is None else as_length(voxel_size, "voxel_size")
    pores = pores_of(packing, size).below
    if not pores.room.any():
        nothing = np.full(packing.dimension, np.nan)
        return Diffusivity(nothing, nothing, math.nan, nothing, block)
    axes = range(packing.dimension)
    return diffusivity_of(pores.mask & pores.room, pores.room, axes, np.ones(3), pores.periodic, block=block)


def _compute(packing: Packing) -> Groups:
    """Return the numbers of all axes, with the size of the voxels."""
    found = transport(packing)
    part = np.divide(found.error, found.relative, out=np.zeros_like(found.error), where=found.relative > 0.0)
    winding = np.where(np.isfinite(found.tortuosity_factor), found.tortuosity_factor, 0.0)
    # bodies of pores are connected whatever the cells
    errors = [found.error, 0.0 * part, part * winding]
    whole = {}
    for (name, meaning), each in zip(MEANINGS.items(), errors, strict=True):
        values = found.relative if name == "effective_diffusivity" else getattr(found, name)
        for axis, value, error in zip("xyz", values, each, strict=False):
            whole[f"{name}_{axis}"] = variable((), value, "1", meaning.format(axis), error=error)
    whole["transport_voxel_size"] = variable(
        (), default_voxel_size(packing), length_unit(packing), "edge of the voxels of the diffusion"
    )
    return {"/": dataset(whole)}


registration = Measure(
    summary="steady diffusion through the pores: effective diffusivity and tortuosity factor along each axis",
    groups=("/",),
    compute=_compute,
    applies=lambda packing: not any(packing.shapes[k].is_open for k in np.unique(packing.shape_id)),
    usual=False,
    sees_fixed=True,
)
