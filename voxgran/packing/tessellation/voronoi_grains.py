"""Cells as grains: each a shape of its own, a convex polyhedron or a polygon."""

import math

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran.containers.kernel_container import ROUND, UPRIGHT, KernelContainer
from voxgran.geometry.polyhedron import CROWDED, CUT
from voxgran.packing.tessellation.voronoi_cells import Cells, Seeds, build_cell
from voxgran.shapes.mesh import hull_of
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline

#: distance, in sizes of a cell, below which two corners are one
ONE_CORNER = 1e-6


def shapes_of(cells: Cells, seeds: Seeds) -> list[Shape | None]:
    """Return all cells as shapes, whose offsets are their centroids from the lower corner; None for an empty cell."""
    found: list[Shape | None] = []
    flat = cells.walls.dimension == 2
    for i in range(len(seeds.place)):
        corners = corners_of(cells, seeds, i)
        if flat:
            corners = corners[corners[:, 2] > 0.0][:, :2]
        corners = _apart(corners)
        if len(corners) <= cells.walls.dimension:
            found.append(None)
            continue
        hull = load("scipy.spatial").ConvexHull(corners).vertices
        geometry = Outline("polygon", vertices=corners[hull]) if flat else hull_of(corners[np.sort(hull)])
        shape = Shape.of(geometry, name="cell")
        x, y, z = (float(value) for value in np.array(shape.offset) + seeds.place[i])
        found.append(Shape(shape.geometry, "cell", (x, y, z)))
    return found


def largest_factor(shape: Shape, walls: KernelContainer) -> float:
    """Return the factor, at most 1, about its centroid at which a cell lies within a round wall."""
    if walls.kind not in (UPRIGHT, ROUND):
        return 1.0
    axes = 3 if walls.kind == ROUND else 2
    arms = np.zeros((len(shape.vertices), 3))
    arms[:, : shape.vertices.shape[1]] = shape.vertices
    arms, away = arms[:, :axes], (np.array(shape.offset) - walls.middle)[:axes]
    # |away + t arm|**2 = radius**2 for the largest t
    a, b = (arms**2).sum(axis=1), linear.matmul(arms, away)
    room = walls.radius**2 - linear.matmul(away, away)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = room / (b + np.sqrt(np.maximum(b * b + a * room, 0.0)))
    return float(min(1.0, np.where(a > 0.0, t, math.inf).min())) if room > 0.0 else 0.0


def corners_of(cells: Cells, seeds: Seeds, i: int) -> Floats:
    """Return the corners of a cell from its seed, (k, 3)."""
    while True:
        corners = np.zeros((len(cells.work.corner), 3))
        many = _copy_corners(cells.around(seeds), i, corners)
        if many >= 0:
            return corners[:many]
        cells.grow()


@kernel
def _copy_corners(tessellation, i, corners):  # type: ignore[no-untyped-def]
    """Write the corners of cell i and return their number; -1 where there is no room."""
    state, cell = build_cell(tessellation, i, False), tessellation.cell
    if state != CUT:
        return -1 if state == CROWDED else 0
    for k in range(cell.count[0]):
        for c in range(3):
            corners[k, c] = cell.corner[k, c]
    return cell.count[0]


def _apart(corners: Floats) -> Floats:
    """Return the corners without those that lie next to an earlier one; their hull lies in that of all."""
    if not len(corners):
        return corners
    near = ONE_CORNER * float(np.ptp(corners, axis=0).max())
    square = ((corners[:, None] - corners[None]) ** 2).sum(axis=2) < near * near
    first = square.argmax(axis=1)
    return corners[first == np.arange(len(corners))]
