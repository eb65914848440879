"""Labels of the grains of a packing on a lattice."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.lattice.grid import Grid
from voxgran.packing.model import Packing
from voxgran.shapes.spheres import Spheres
from voxgran.voxels.occupy import occupy


def labels_on(packing: Packing, grid: Grid) -> NDArray[np.int32]:
    """Return for each voxel, by its center, 0 for void or k + 1 for grain k, the first of several.

    Grains continue across periodic faces.

    Raises
    ------
    InputError
        If a grain is an open surface.
    """
    image = np.zeros(grid.shape, dtype=np.int32)
    packing, shifts = with_images(packing)
    spheres = np.array(
        [isinstance(s.geometry, Spheres) or (s.is_sphere and s.dimension == 3) for s in packing.shapes], dtype=bool
    )
    round_ones = spheres[packing.shape_id] if packing.count else np.zeros(0, dtype=bool)
    _paint_round(image, grid, packing, np.flatnonzero(round_ones), shifts)
    for grain in np.flatnonzero(~round_ones):
        _paint_other(image, grid, packing, int(grain), shifts)
    return image


def with_images(packing: Packing) -> tuple[Packing, Floats]:
    """Return a packing with its centers moved into the container along periodic axes, and the (k, 3) shifts to the
    periodic images that may reach into it.
    """
    container = packing.container
    lower, upper = container.bounds
    axes, lengths = np.flatnonzero(container.periodic), upper - lower
    turns = np.zeros_like(packing.position)
    turns[:, axes] = np.floor((packing.position - lower)[:, axes] / lengths[axes])
    if turns.any():
        packing = replace(packing, position=packing.position - turns * lengths)
    far = np.zeros(3, dtype=np.int64)
    far[axes] = np.ceil(float(packing.bounding_radii.max(initial=0.0)) / lengths[axes])
    return packing, (np.array(list(np.ndindex(*(2 * far + 1)))) - far) * lengths


def _paint_round(image: NDArray[np.int32], grid: Grid, packing: Packing, grains: Integers, shifts: Floats) -> None:
    """Paint spheres and clumps of spheres, in closed form."""
    for index in np.unique(packing.shape_id[grains]):
        geometry = packing.shapes[index].geometry
        if isinstance(geometry, Spheres):
            body, radii = geometry.centers, geometry.radii
        else:
            body, radii = np.zeros((1, 3)), np.array([packing.shapes[index].bounding_radius])
        members = grains[packing.shape_id[grains] == index]
        scale = packing.scale[members]
        centers = np.einsum("gij,sj->gsi", packing.matrices[members], body) * scale[:, None, None]
        centers += packing.position[members, None, :] - np.array(grid.origin)
        labels = np.repeat(members.astype(np.int32) + 1, len(radii))
        sizes = (scale[:, None] * radii).ravel()
        _paint_spheres(image, centers.reshape(-1, 3), sizes, labels, shifts, grid.voxel_size)


def _paint_other(image: NDArray[np.int32], grid: Grid, packing: Packing, grain: int, shifts: Floats) -> None:
    """Paint one grain of any shape; each periodic image is voxelized where it lies on the lattice."""
    shape, reach = packing.shapes[packing.shape_id[grain]], float(packing.bounding_radii[grain])
    size, counts, flat = grid.voxel_size, np.array(grid.shape), packing.dimension == 2
    for shift in shifts:
        place = packing.position[grain] + shift - np.array(grid.origin)
        low = np.maximum(np.floor((place - reach) / size).astype(int) - 1, 0)
        high = np.minimum(np.ceil((place + reach) / size).astype(int) + 1, counts)
        if flat:
            low[2], high[2] = 0, 1
        if (low >= high).any():
            continue
        x, y, z = (float(value) for value in low * size - place)
        nx, ny, nz = (int(value) for value in high - low)
        local = Grid((x, y, 0.0 if flat else z), size, (nx, ny, nz))
        mask = occupy(
            shape, local, scale=float(packing.scale[grain]), rotation=packing.orientation[grain], cover="center"
        )
        window = image[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
        window[mask & ((window == 0) | (window > grain + 1))] = grain + 1


@kernel
def _paint_spheres(image, centers, radii, labels, shifts, voxel_size):  # type: ignore[no-untyped-def]
    """Label the voxels whose centers lie in spheres; the lowest label wins."""
    nx, ny, nz = image.shape
    for sphere in range(len(radii)):
        label, radius = labels[sphere], radii[sphere] / voxel_size
        for s in range(len(shifts)):
            x = (centers[sphere, 0] + shifts[s, 0]) / voxel_size - 0.5
            y = (centers[sphere, 1] + shifts[s, 1]) / voxel_size - 0.5
            z = (centers[sphere, 2] + shifts[s, 2]) / voxel_size - 0.5
            for i in range(max(0, int(np.ceil(x - radius))), min(nx, int(np.floor(x + radius)) + 1)):
                for j in range(max(0, int(np.ceil(y - radius))), min(ny, int(np.floor(y + radius)) + 1)):
                    rest = radius * radius - (i - x) ** 2 - (j - y) ** 2
                    if rest < 0.0:
                        continue
                    half = np.sqrt(rest)
                    for k in range(max(0, int(np.ceil(z - half))), min(nz, int(np.floor(z + half)) + 1)):
                        if image[i, j, k] == 0 or image[i, j, k] > label:
                            image[i, j, k] = label
