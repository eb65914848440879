"""What a union of spheres leaves open of a solid: the growth of radii that covers it, and the holes inside."""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.scalars import cube_root
from voxgran.clumps.method import Body
from voxgran.clumps.sphere_sets import SphereSet, union_gaps
from voxgran.lattice.grid import Grid
from voxgran.lattice.label import connected_components
from voxgran.voxels.closed_form import spheres_bits

#: accuracy of the growth that covers a surface, in equivalent diameters
ACCURACY = 1e-5
#: voxels along the equivalent diameter in which holes are looked for
LATTICE = 96.0
#: largest number of these voxels
MOST_VOXELS = 50_000_000


def covering_growth(body: Body, spheres: SphereSet) -> float:
    """Return the least length by which all radii must grow, or may shrink, to cover the tessellation, from above.

    The distance from the union changes no faster than the point moves. Triangles on which it may exceed the largest
    value found are divided until there are none (branch and bound).
    """
    corners = body.shape.vertices[body.shape.faces]
    best = -np.inf
    while len(corners):
        middle = corners.mean(axis=1)
        reach = linear.norm(corners - middle[:, None], axis=2).max(axis=1)
        gap = union_gaps(middle, spheres.centers, spheres.radii)[0]
        best = max(best, float(gap.max()))
        corners = _quartered(corners[gap + reach > best + ACCURACY])
    return best + ACCURACY


def _quartered(corners: Floats) -> Floats:
    """Return the four triangles between the corners and the middles of the edges of each, (4 m, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    d, e, f = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = ((a, d, f), (d, b, e), (f, e, c), (d, e, f))
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def enclosed_holes(body: Body, spheres: SphereSet) -> Floats:
    """Return the voxels of the solid in holes that the union encloses, (n, 3); cavities of the solid do not count."""
    reach = np.abs(spheres.centers).max(axis=0) + spheres.radii.max()
    # long solids get coarser voxels
    size = max(1.0 / LATTICE, cube_root(float(np.prod(2.0 * reach) / MOST_VOXELS)))
    grid = Grid.around(-reach, reach, size)
    empty = ~spheres_bits(spheres.centers, spheres.radii, grid, cover="center").unpacked()
    labels = connected_components(empty, connectivity=6)[0]
    places = grid.coordinates(np.argwhere(empty & (labels != labels[0, 0, 0])))
    return places[body.depth(places) > 0.0] if len(places) else places
