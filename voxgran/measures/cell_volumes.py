"""Solid volume in each cell of a lattice: each grain is cut once by the cells that it touches."""

from collections.abc import Iterator

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.geometry.halfspaces import cut_disks, cut_spheres
from voxgran.measures.window import Solids, chosen_planes

#: grains that are cut at a time, which bounds the memory
GRAINS = 20_000


def cell_volumes(solids: Solids, lower: Floats, edges: Floats, held: Booleans) -> Floats:
    """Return the volume (in 2D area) of the grains in each cell of a lattice.

    The first cell has the corner `lower`, (d,), all have the `edges`, (d,), and `held` has the shape of the lattice;
    other cells are left at 0. On periodic axes the lattice is one period long. Spheres and disks that overlap count
    once, the common volume of other grains counts for each.
    """
    packing = solids.packing
    volumes = np.zeros(held.size)
    if solids.spheres is not None:
        centers, radii, planes = solids.spheres
    else:
        centers, radii = packing.position, packing.bounding_radii
    d = len(lower)
    low, high = np.zeros(d), np.asarray(edges, dtype=np.float64)
    for body, cell, place in _touched(centers, radii, lower, edges, held, packing.container.periodic):
        if solids.spheres is None:
            shift = np.zeros((len(body), 3))
            shift[:, :d] = place - centers[body, :d]
            parts = solids.cut_grains(body, low, high, shift=shift)[0]
        else:
            start, normals, offsets = chosen_planes(planes, body)
            chosen = start, np.ascontiguousarray(normals[:, :d]), offsets
            cut = cut_spheres if d == 3 else cut_disks
            parts = cut(place, radii[body], lower=low, upper=high, planes=chosen)
        volumes += np.bincount(cell, weights=parts, minlength=held.size)
    return volumes.reshape(held.shape)


def _touched(
    centers: Floats, radii: Floats, lower: Floats, edges: Floats, held: Booleans, periodic: tuple[bool, ...]
) -> Iterator[tuple[Integers, Integers, Floats]]:
    """Yield, for some bodies at a time, body, flat index of a cell that its sphere touches, and center (m, d) relative
    to the corner of that cell.
    """
    d, inside = len(lower), held.reshape(-1)
    for begin in range(0, len(radii), GRAINS):
        body = np.arange(begin, min(begin + GRAINS, len(radii)))
        places, cells = (centers[body, :d] - lower) / edges, np.zeros((len(body), d), np.int64)
        for a in range(d):
            reach = radii[body] / edges[a]
            first = np.floor(places[:, a] - reach).astype(np.int64)
            last = np.floor(places[:, a] + reach).astype(np.int64)
            if not periodic[a]:
                first, last = np.maximum(first, 0), np.minimum(last, held.shape[a] - 1)
            counts = np.maximum(last - first + 1, 0)
            turn = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
            column = np.repeat(first, counts) + turn
            body, places = np.repeat(body, counts), np.repeat(places, counts, axis=0)
            cells = np.repeat(cells, counts, axis=0)
            cells[:, a] = column
        place = (places - cells) * edges
        flat = np.ravel_multi_index(tuple((cells % held.shape).T), held.shape)
        apart = place - np.clip(place, 0.0, edges)
        near = inside[flat] & (np.sqrt((apart**2).sum(axis=1)) < radii[body])
        yield body[near], flat[near], place[near]
