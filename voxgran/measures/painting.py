"""Labels of the grains of a packing on a lattice."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.containers.model import periods_of
from voxgran.geometry.periods import face_distances, upright_turns
from voxgran.lattice.grid import Grid
from voxgran.packing.model import Packing
from voxgran.shapes.spheres import Spheres
from voxgran.voxels.occupy import centers_in, occupy


def labels_on(
    packing: Packing,
    origin: Floats,
    edges: Floats,
    counts: tuple[int, int, int],
    part: tuple[Integers, Integers] | None = None,
) -> NDArray[np.int32]:
    """Return for each voxel, by its center, 0 for void or k + 1 for grain k, the first of several.

    `origin` (3,) is the corner of the first voxel, `edges` (3,) are those of a voxel.  Grains continue across periodic
    faces.  `part`: the indices of the first voxel and after the last one of the part of the lattice that is returned.

    Raises
    ------
    InputError
        If a grain is an open surface.
    """
    start, stop = (np.zeros(3, dtype=np.int64), np.array(counts)) if part is None else part
    image = np.zeros(tuple((stop - start).tolist()), dtype=np.int32)
    packing, shifts = with_images(packing)
    shifts = shifts - origin
    spheres = np.array(
        [isinstance(s.geometry, Spheres) or (s.is_sphere and s.dimension == 3) for s in packing.shapes], dtype=bool
    )
    round_ones = spheres[packing.shape_id] if packing.count else np.zeros(0, dtype=bool)
    # a voxel more than is needed
    places, reach = packing.position[:, None] + shifts, (packing.bounding_radii[:, None] + 2 * edges)[:, None]
    near = np.any(((places + reach > start * edges) & (places - reach < stop * edges)).all(axis=2), axis=1)
    _paint_round(image, edges, packing, np.flatnonzero(round_ones & near), shifts, start)
    for grain in np.flatnonzero(~round_ones & near):
        _paint_other(image, edges, packing, int(grain), shifts, np.array(counts), start)
    return image


def with_images(packing: Packing) -> tuple[Packing, Floats]:
    """Return a packing with its centers moved into the bounds of the container along periodic axes, and the (k, 3)
    shifts to the periodic images that may reach into them.
    """
    (lower, upper), periods = packing.container.bounds, periods_of(packing.container)
    turns = upright_turns(packing.position, lower, periods)
    if turns.any():
        packing = replace(packing, position=packing.position - linear.matmul(turns, periods))
    reach = upper - lower + float(packing.bounding_radii.max(initial=0.0))
    far = np.floor(linear.norm(reach) / face_distances(periods)).astype(np.int64)
    shifts = linear.matmul(np.array(list(np.ndindex(*(2 * far + 1)))) - far, periods)
    # from bounds without length in 2D nothing is shifted
    return packing, shifts[((np.abs(shifts) < reach) | (shifts == 0.0)).all(axis=1)]


def _paint_round(
    image: NDArray[np.int32], edges: Floats, packing: Packing, grains: Integers, shifts: Floats, start: Integers
) -> None:
    """Paint spheres and clumps of spheres, in closed form."""
    for index in np.unique(packing.shape_id[grains]):
        geometry = packing.shapes[index].geometry
        if isinstance(geometry, Spheres):
            body, radii = geometry.centers, geometry.radii
        else:
            body, radii = np.zeros((1, 3)), np.array([packing.shapes[index].bounding_radius])
        members = grains[packing.shape_id[grains] == index]
        scale = packing.scale[members]
        centers = linear.einsum("gij,sj->gsi", packing.matrices[members], body) * scale[:, None, None]
        centers += packing.position[members, None, :]
        labels = np.repeat(members.astype(np.int32) + 1, len(radii))
        sizes = (scale[:, None] * radii).ravel()
        _paint_spheres(image, centers.reshape(-1, 3), sizes, labels, shifts, edges, start)


def _paint_other(
    image: NDArray[np.int32],
    edges: Floats,
    packing: Packing,
    grain: int,
    shifts: Floats,
    counts: Integers,
    start: Integers,
) -> None:
    """Paint one grain of any shape; each periodic image is voxelized where it lies on the lattice."""
    shape, reach = packing.shapes[packing.shape_id[grain]], float(packing.bounding_radii[grain])
    pose: dict[str, Any] = {"scale": float(packing.scale[grain]), "rotation": packing.orientation[grain]}
    flat = packing.dimension == 2
    cubes = bool((edges == edges[0])[: packing.dimension].all())
    for shift in shifts:
        place = packing.position[grain] + shift
        low = np.maximum(np.floor((place - reach) / edges).astype(int) - 1, 0)
        high = np.minimum(np.ceil((place + reach) / edges).astype(int) + 1, counts)
        if flat:
            low[2], high[2] = 0, 1
        # the whole grain is voxelized, so that round-off is the same in each part
        inner, outer = np.maximum(low, start), np.minimum(high, start + image.shape)
        if (inner >= outer).any():
            continue
        corner = low * edges - place
        nx, ny, nz = (int(value) for value in high - low)
        if cubes:
            x, y, z = (float(value) for value in corner)
            local = Grid((x, y, 0.0 if flat else z), float(edges[0]), (nx, ny, nz))
            mask = occupy(shape, local, cover="center", **pose)
        else:
            mask = centers_in(shape, corner, edges, (nx, ny, nz), **pose)
        mask = mask[tuple(slice(a, b) for a, b in zip(inner - low, outer - low, strict=True))]
        window = image[tuple(slice(a, b) for a, b in zip(inner - start, outer - start, strict=True))]
        window[mask & ((window == 0) | (window > grain + 1))] = grain + 1


@kernel
def _paint_spheres(image, centers, radii, labels, shifts, edges, start):  # type: ignore[no-untyped-def]
    """Label the voxels whose centers lie in spheres; the lowest label wins."""
    a, b, c = start
    nx, ny, nz = a + image.shape[0], b + image.shape[1], c + image.shape[2]
    wide, high = edges[1] / edges[0], edges[2] / edges[0]
    for sphere in range(len(radii)):
        label, radius = labels[sphere], radii[sphere] / edges[0]
        for s in range(len(shifts)):
            x = (centers[sphere, 0] + shifts[s, 0]) / edges[0] - 0.5
            y = (centers[sphere, 1] + shifts[s, 1]) / edges[1] - 0.5
            z = (centers[sphere, 2] + shifts[s, 2]) / edges[2] - 0.5
            for i in range(max(a, int(np.ceil(x - radius))), min(nx, int(np.floor(x + radius)) + 1)):
                reach = radius / wide
                for j in range(max(b, int(np.ceil(y - reach))), min(ny, int(np.floor(y + reach)) + 1)):
                    rest = radius * radius - (i - x) ** 2 - ((j - y) * wide) ** 2
                    if rest < 0.0:
                        continue
                    half = np.sqrt(rest) / high
                    for k in range(max(c, int(np.ceil(z - half))), min(nz, int(np.floor(z + half)) + 1)):
                        if image[i - a, j - b, k - c] == 0 or image[i - a, j - b, k - c] > label:
                            image[i - a, j - b, k - c] = label
