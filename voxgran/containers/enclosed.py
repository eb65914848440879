"""The space that a wall encloses: a component of what is left of a block without the wall, by exact booleans.

The block reaches beyond the wall on all sides but two: the lid and the floor, planes across gravity, end it. What is
left of it without the wall is the outside, which reaches the sides of the block, and the spaces that wall, lid and
floor close. The sum of solids is that of manifold3d, in double precision.
"""

from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import DirtyMeshError
from voxgran._base.lazy import load
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.holes import closed_loop, hole_loops
from voxgran.shapes.winding import winding_numbers

#: how far lid and floor lie within the wall, in its heights: for flat rims, and for rims that are flat in single
#: precision; and levels that are tried beside these
NEAR, COARSE, LEVELS = 1e-9, 1e-6, 16
#: halvings of the steps between these levels, and the share of the volume that a lower level may lose
HALVINGS, SAME = 20, 1e-6
#: distance of a rim from a plane across gravity, in heights of the wall, up to which it is flat
FLAT = 1e-6
#: share of the box around a wall that it fills at most, and the least volume of the space in it, in volumes of the
#: wall, at which a mesh is taken to be a wall; lid and floor then lie as far within it
THIN, HOLLOW, CLEAR = 0.5, 2.0, 1e-3

#: vertices and triangles of a closed surface
Triangles = tuple[Floats, Integers]


class Wall:
    """A wall, a closed surface, and the spaces that it encloses.

    Attributes
    ----------
    low, high : float
        Its ends along the upward direction.

    Raises
    ------
    DirtyMeshError
        If the surface is not closed.
    """

    def __init__(self, mesh: Triangles, up: Floats) -> None:
        library = load("manifold3d")
        self.up, (self.vertices, faces) = up, mesh
        self.solid = library.Manifold(library.Mesh64(self.vertices, np.ascontiguousarray(faces, dtype=np.uint64)))
        if self.solid.status() != library.Error.NoError:
            raise DirtyMeshError(
                f"wall is no closed surface once its rims are closed ({self.solid.status().name}): mend it with "
                "vg.repair, or 'voxgran repair' at the prompt"
            )
        height = linear.matmul(self.vertices, up)
        self.low, self.high = float(height.min()), float(height.max())
        lower, upper = self.vertices.min(axis=0), self.vertices.max(axis=0)
        margin = float(linear.norm(upper - lower))
        self.corner = lower - margin
        self.block = library.Manifold.cube((upper - lower + 2 * margin).tolist()).translate(self.corner.tolist())

    def space(self, floor: float, lid: float, point: Floats | None) -> Triangles | None:
        """Return the space between two levels that holds a point, or the largest one; None if there is none."""
        block = self.block.trim_by_plane((-self.up).tolist(), -lid).trim_by_plane(self.up.tolist(), floor)
        parts = [_triangles(part) for part in (block - self.solid).decompose() if not part.is_empty()]
        solids = [part for part in parts if _volume(part) > 0 and (part[0].min(axis=0) > self.corner).all()]
        if point is not None:
            solids = [part for part in solids if _holds(part, point)]
        # a wall is one piece, so that nothing stands in a space without touching its sides
        return max(solids, key=_volume, default=None)

    def highest(self, floor: float | None, point: Floats | None) -> Triangles | None:
        """Return the space below the highest lid at which it is largest; None if there is none."""
        tall = self.high - self.low
        steps = np.concatenate([[NEAR, COARSE], np.arange(1, LEVELS) / LEVELS])
        low = [self.low + min(step, COARSE) * tall if floor is None else floor for step in steps]
        tries = [(self.space(a, self.high - step * tall, point)) for step, a in zip(steps, low, strict=True)]
        volumes = np.array([0.0 if found is None else _volume(found) for found in tries])
        best = int(np.argmax(volumes >= volumes.max() * (1 - SAME)))
        found, most = tries[best], float(volumes[best])
        if best < 2 or found is None:
            return found
        # a little lower than where it would overflow
        dry, wet = float(steps[best]), float(steps[best - 1])
        for _ in range(HALVINGS):
            half = (dry + wet) / 2
            more = self.space(low[best], self.high - half * tall, point)
            if more is not None and _volume(more) >= most:
                found, dry = more, half
            else:
                wet = half
        return found


def enclosed(shape: Shape, up: Floats, *, lid: float | None, floor: float | None, point: Floats | None) -> Shape | None:
    """Return the space that a wall encloses, as a shape whose offset places it; None if there is none.

    Raises
    ------
    DirtyMeshError
        If the surface is not closed once its rims are.
    """
    mesh = _closed(shape, up) if shape.is_open else _placed(shape)
    wall = Wall(mesh, up)
    # levels far from the wall cut no more than those above and below it
    ends = 2 * wall.low - wall.high, 2 * wall.high - wall.low
    lid, floor = (None if level is None else min(max(level, ends[0]), ends[1]) for level in (lid, floor))
    if lid is None:
        found = wall.highest(floor, point)
    else:
        found = wall.space(wall.low + COARSE * (wall.high - wall.low) if floor is None else floor, lid, point)
    if shape.is_open and (found is None or _volume(found) < abs(wall.solid.volume())):
        # a shell without thickness is the boundary of the space itself
        found = _within(wall, lid, floor)
    if found is None:
        return None
    return Shape.from_mesh(*found, name=f"inside of {shape.name}", unit=shape.unit)


def wall_around(shape: Shape) -> float:
    """Return the volume of the space that a closed mesh encloses if it is large against that of the mesh; else 0."""
    lower, upper = shape.bounds
    if shape.volume > THIN * float(np.prod(upper - lower)):
        return 0.0
    most = 0.0
    for up in np.eye(3):
        wall = Wall(_placed(shape), up)
        inset = CLEAR * (wall.high - wall.low)
        found = wall.space(wall.low + inset, wall.high - inset, None)
        most = max(most, 0.0 if found is None else _volume(found))
    return most if most > HOLLOW * shape.volume else 0.0


def _within(wall: Wall, lid: float | None, floor: float | None) -> Triangles | None:
    """Return what a closed surface bounds, between two levels."""
    inside = wall.solid
    if lid is not None:
        inside = inside.trim_by_plane((-wall.up).tolist(), -lid)
    if floor is not None:
        inside = inside.trim_by_plane(wall.up.tolist(), floor)
    return None if inside.is_empty() else _triangles(inside)


def _closed(shape: Shape, up: Floats) -> Triangles:
    """Return an open surface with its rims closed: the highest one by a plane across gravity at its lowest point, the
    others by triangles of least area.
    """
    vertices, faces = _placed(shape)
    height = linear.matmul(vertices, up)
    tall = float(np.ptp(height))
    loops, levels = hole_loops(faces, len(vertices)), []
    for loop in loops:
        new, caps = closed_loop(vertices, faces, loop)
        vertices, faces = np.concatenate([vertices, new]), np.concatenate([faces, caps])
        level = height[loop]
        if level.mean() > (height.min() + height.max()) / 2 and np.ptp(level) > FLAT * tall:
            levels.append((float(level.mean()), float(level.min())))
    if _volume((vertices, faces)) < 0:
        faces = faces[:, ::-1]
    if not levels:
        return vertices, faces
    return _triangles(Wall((vertices, faces), up).solid.trim_by_plane((-up).tolist(), -max(levels)[1]))


def _placed(shape: Shape) -> Triangles:
    """Return the triangles of a shape where they were made."""
    return shape.vertices + np.array(shape.offset), shape.faces


def _triangles(solid: Any) -> Triangles:
    """Return the triangles of a solid of manifold3d."""
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties[:, :3], dtype=np.float64), np.array(mesh.tri_verts, dtype=np.int64)


def _volume(part: Triangles) -> float:
    """Return the volume within triangles, negative where they face inward."""
    a, b, c = np.moveaxis(part[0][part[1]] - part[0].mean(axis=0), 1, 0)
    return float(linear.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def _holds(part: Triangles, point: Floats) -> bool:
    """Return whether a point lies within triangles."""
    return bool(winding_numbers(part[0][part[1]], point[None])[0] > 0.5)
