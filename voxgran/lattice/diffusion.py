"""Steady diffusion through the pores of an image: effective diffusivity, porosity that conducts, tortuosity factor.

Two or three voxels along each axis make a cell. The open area of a face between cells is the mean of those of the two
layers of voxels at the face, as if the surface of the grains lay anywhere within them. Where these areas are exact, the
error falls with the square of the edge (Ng, Min & Gibou 2009, doi:10.1016/j.jcp.2009.08.032); the steps of single
voxels, which other programs keep, narrow each throat by about half a voxel.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Booleans, Floats, as_count
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, PackingWarning, warn
from voxgran.lattice.distance import as_mask
from voxgran.lattice.image import known_edges
from voxgran.lattice.label import percolating
from voxgran.lattice.multigrid import flow_between, pair_sums

#: share of the solid that is one voxel thick above which cells are single voxels: it is 0.04 in beds of spheres of 6
#: voxels, where cells of two voxels are right, and 0.07 in a scanned electrode, where they are open across walls
THIN = 0.05
#: voxels of the cells of a second solution, for each number of the first
COMPARED = {1: 2, 2: 3, 3: 2, 4: 3}


@dataclass(frozen=True, eq=False)
class Diffusivity:
    """Steady diffusion through pores along each axis.

    Attributes
    ----------
    relative : (3,) ndarray of float
        Effective diffusivity over the diffusivity in the free fluid; 0 along an axis across which no pores connect the
        two sides, NaN along an axis along which the cross-section of the region changes.
    effective_porosity : (3,) ndarray of float
        Share of the region that is pores of bodies that connect the two sides.
    porosity : float
        Share of the region that is pores.
    error : (3,) ndarray of float
        Error of `relative` by the voxels, estimated: the difference to the solution with the cells of another `block`.
    block : int
        Voxels along each axis of a cell.
    """

    relative: Floats
    effective_porosity: Floats
    porosity: float
    error: Floats
    block: int

    @property
    def tortuosity_factor(self) -> Floats:
        """Effective porosity over relative diffusivity (3,); infinite along an axis that is not connected."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.relative == 0.0, np.inf, self.effective_porosity / self.relative)


@explained(hint="effective_diffusivity(labels == 0, periodic='xyz')")
def effective_diffusivity(
    pores: "ArrayLike",
    *,
    region: "ArrayLike | None" = None,
    voxel_size: "ArrayLike | None" = None,
    periodic: Periodic = False,
    block: int | None = None,
) -> Diffusivity:
    """Return the effective diffusivity of the pores of an image along each axis.

    The concentration is 1 at one side of the image and 0 at the opposite one; nothing passes the other sides but where
    they are periodic. The number is likewise that of electric or thermal conduction through the pores alone: its
    inverse is the formation factor.

    Parameters
    ----------
    pores : (nx, ny, nz) array_like of bool, or Image
        Mask of the pores, such as ``labels == 0``.
    region : (nx, ny, nz) array_like of bool, optional
        Mask of what counts as the sample, such as a cylinder in the image. Default: the image.
    voxel_size : float or (3,) array_like of float, optional
        Edge of a voxel, or its edges along x, y and z, of which only the ratios matter. Default: those that an Image
        tells, otherwise the unit.
    periodic : str, bool or sequence
        Periodic axes, such as ``"xy"``, as in :class:`voxgran.Box`. Flow along a periodic axis too is that from side
        to side.
    block : {1, 2, 3, 4}, optional
        Voxels along each axis that make a cell of the solution. 2 is good for grains that are 8 voxels wide, 3 for
        those of 20 or more. 1 makes each voxel a cell, as other programs do, which suits thin walls: larger cells may
        be open across them. Default: 2, and 1 where more than 5 % of the solid is one voxel thick.

    Returns
    -------
    Diffusivity
        Relative diffusivity with its error, effective porosity and tortuosity factor along x, y and z.

    Raises
    ------
    InputError
        If the image has not three axes, no voxels or no whole numbers, the region has another shape or is empty, an
        edge of a voxel is not a length, `periodic` names no axes, or `block` is not 1, 2, 3 or 4.

    Warns
    -----
    PackingWarning
        If more than 5 % of the solid is one voxel thick and `block` is not 1.

    Notes
    -----
    In dense packings of spheres 20 voxels wide numbers are too small by 2 %, with `block=3` right to 0.5 %, and with
    `block=1` too small by 20 %. In a scanned electrode with walls of one voxel, `block=1` gives the published number of
    other programs, and `block=2` one that is larger by 28 %. The solver adds 1e-5.
    Memory beside the mask: about 12 bytes per voxel, with `block=1` 42.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> pores = np.zeros((20, 20, 20), dtype=bool)
    >>> pores[:, 5:15, :] = True
    >>> found = vg.effective_diffusivity(pores)
    >>> found.relative.round(6).tolist(), found.tortuosity_factor.round(6).tolist()
    ([0.5, 0.0, 0.5], [1.0, inf, 1.0])
    """
    mask, edges, around = as_mask(pores, "pores"), known_edges(voxel_size, pores), as_periodic(periodic)
    inside = np.ones(mask.shape, dtype=bool) if region is None else as_mask(region, "region")
    width = None if block is None else as_count(block, "block", at_least=1, at_most=4)
    if inside.shape != mask.shape:
        raise InputError(f"region has shape {inside.shape}: it must be that of pores, {mask.shape}; give one mask each")
    if not inside.any():
        raise InputError("region holds no voxel: there is nothing that could conduct; give an image with voxels")
    mask = mask & inside
    lengths = np.array(edges or (1.0, 1.0, 1.0))
    thin = thin_share(inside & ~mask, around)
    if width is None:
        width = 1 if thin > THIN else 2
    if thin > THIN and block != 1:
        chosen = "is 1, and" if block is None else f"is {width}, not 1;"
        warn(
            f"{100 * thin:.0f} % of the solid is one voxel thick, and cells of more voxels open thin walls: block "
            f"{chosen} the attribute error tells how much depends on it; finer voxels lower it",
            PackingWarning,
        )
    return diffusivity_of(mask, inside, range(3), lengths, around, block=width)


def thin_share(solid: Booleans, periodic: Sequence[bool]) -> float:
    """Return the share of the voxels of a solid that are in no cube of two voxels along each axis within it.

    Where an axis is not periodic the solid goes on beyond the image as at its border.
    """
    if not solid.any():
        return 0.0
    thick = solid
    for axis, around in enumerate(periodic):
        thick = np.pad(thick, [(int(k == axis),) * 2 for k in range(3)], mode="wrap" if around else "edge")
    for axis in range(3):
        lines = np.moveaxis(thick, axis, 0)
        thick = np.moveaxis(lines[:-1] & lines[1:], 0, axis)
    for axis in range(3):
        lines = np.moveaxis(thick, axis, 0)
        thick = np.moveaxis(lines[:-1] | lines[1:], 0, axis)
    return 1.0 - float(thick.sum() / solid.sum())


def diffusivity_of(
    pores: Booleans, region: Booleans, axes: Iterable[int], edges: Floats, periodic: Sequence[bool], *, block: int
) -> Diffusivity:
    """Return the diffusivity along axes, with its error; see `effective_diffusivity`."""
    known = [diffusivity_along(pores, region, axis, edges, periodic, block=block) for axis in axes]
    relative, effective = np.transpose(known)
    # what is not connected, or has no cross-section, needs no second solution
    unknown = [
        abs(value - diffusivity_along(pores, region, axis, edges, periodic, block=COMPARED[block])[0]) if value else 0.0
        for axis, value in zip(axes, relative, strict=True)
    ]
    return Diffusivity(relative, effective, float(pores.sum() / region.sum()), np.array(unknown), block)


def diffusivity_along(
    pores: Booleans, region: Booleans, axis: int, edges: Floats, periodic: Sequence[bool], *, block: int = 2
) -> tuple[float, float]:
    """Return relative diffusivity and effective porosity along one axis; see `effective_diffusivity`."""
    sides = [around and k != axis for k, around in enumerate(periodic)]
    through = percolating(pores, axis, periodic=sides, region=region)
    share = float(through.sum() / region.sum())
    layers = np.moveaxis(region, axis, 0)
    kept = np.flatnonzero(layers.any(axis=(1, 2)))
    section = layers[kept[0]]
    if not (layers[kept] == section).all():
        return np.nan, share
    if not share:
        return 0.0, share
    # that axis first, in units of whose conductances all are
    order = [axis, *(k for k in range(3) if k != axis)]
    scales, lines = (edges[axis] / edges[order]) ** 2, through.transpose(order)[kept[0] : kept[-1] + 1]
    widths = _widths(len(lines), block)
    conductance = np.empty((3, *(-(-many // block) for many in lines.shape)), dtype=np.float32)
    for k in range(3):
        conductance[k] = _openings(lines, k, [sides[other] for other in order], block)
        conductance[k] *= scales[k]
    inlet, outlet = (pair_sums(2 / widths[end] * lines[end], (0, 1), block) for end in (0, -1))
    even = 1 - (np.cumsum(widths) - widths / 2) / len(lines)
    return flow_between(conductance, inlet, outlet, even) * len(lines) / float(section.sum()), share


def _widths(count: int, block: int) -> Floats:
    """Return the widths of the cells of a line of voxels; the last one may be less than a block."""
    return np.diff([*range(0, count, block), count]).astype(np.float64)


def _openings(pores: Booleans, axis: int, periodic: Sequence[bool], block: int) -> Floats:
    """Return the open voxels of the faces between each cell and the next one along an axis, over their distance.

    Of two voxels on either side of a face of which one is open half a face is open, where next to it both are: so a
    wall along the face stays closed.
    """
    lines, widths = np.moveaxis(pores, axis, 0), _widths(pores.shape[axis], block)
    firsts = np.arange(0, len(lines), block)
    before, after = lines[np.roll(firsts, -1) - 1], lines[np.roll(firsts, -1)]
    both = before & after
    open_part = both.astype(np.float32)
    if block > 1:
        near = both
        for other, around in enumerate(np.delete(periodic, axis), start=1):
            wide = np.pad(near, [(int(k == other),) * 2 for k in range(3)], mode="wrap" if around else "constant")
            near = near | np.delete(wide, (0, 1), other) | np.delete(wide, (-1, -2), other)
        open_part[near & (before ^ after)] = 0.5
    if not periodic[axis] or len(widths) == 1:
        open_part[-1] = 0.0
    found = pair_sums(open_part, (1, 2), block)
    found *= (2 / (widths + np.roll(widths, -1)))[:, None, None].astype(np.float32)
    return np.moveaxis(found, 0, axis)
