"""The space that a wall encloses: a component of what is left of a block without the wall, by exact booleans.

The block reaches beyond the wall on all sides but two: the lid and the floor, planes across gravity, end it. What is
left of it without the wall is the outside, which reaches the sides of the block, and the spaces that wall, lid and
floor close. The sum of solids is that of manifold3d, in double precision.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import DirtyMeshError
from voxgran._base.lazy import load
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.bodies import split
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
#: vertices and triangles of a connected surface, and whether it is open
Shell = tuple[Floats, Integers, bool]


class Wall:
    """A wall, a solid, and the spaces that it encloses.

    Attributes
    ----------
    low, high : float
        Its ends along the upward direction.
    """

    def __init__(self, solid: Any, up: Floats) -> None:
        self.up, self.solid = up, solid
        vertices = _triangles(solid)[0]
        height = linear.matmul(vertices, up)
        self.low, self.high = float(height.min()), float(height.max())
        lower, upper = vertices.min(axis=0), vertices.max(axis=0)
        margin = float(linear.norm(upper - lower))
        self.corner = lower - margin
        cube = load("manifold3d").Manifold.cube
        self.block = cube((upper - lower + 2 * margin).tolist()).translate(self.corner.tolist())

    def space(self, floor: float, lid: float, point: Floats | None) -> Triangles | None:
        """Return the space between two levels that holds a point, or the largest one; None if there is none."""
        left = _between(self.block, self.up, floor, lid) - self.solid
        return _chosen([part for part in _parts(left) if (part[0].min(axis=0) > self.corner).all()], point)

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


def enclosed(
    shells: Sequence[Shell], up: Floats, *, lid: float | None, floor: float | None, point: Floats | None
) -> Triangles | None:
    """Return the space that a wall of several shells encloses, the part that holds a point or the largest one; None if
    there is none.

    A shell within the material of others is a cavity in it. Open shells without thickness bound the space themselves.

    Raises
    ------
    DirtyMeshError
        If a shell is not closed once its rims are.
    """
    thick = [_solid((vertices, faces)) for vertices, faces, is_open in shells if not is_open]
    thin = [_closed(vertices, faces, up) for vertices, faces, is_open in shells if is_open]
    material = _nested(thick + thin)
    if material.is_empty():
        return None
    wall, inside = Wall(material, up), _nested(thin)
    # levels far from the wall cut no more than those above and below it
    ends = 2 * wall.low - wall.high, 2 * wall.high - wall.low
    lid, floor = (None if level is None else min(max(level, ends[0]), ends[1]) for level in (lid, floor))
    if not inside.is_empty():
        largest = wall.highest(None, None)
        if largest is None or _volume(largest) < inside.volume():
            left = _between(inside, up, ends[0] if floor is None else floor, ends[1] if lid is None else lid)
            return _chosen(_parts(left - _nested(thick)), point)
    if lid is None:
        return wall.highest(floor, point)
    return wall.space(wall.low + COARSE * (wall.high - wall.low) if floor is None else floor, lid, point)


def wall_around(shape: Shape) -> float:
    """Return the volume of the space that a closed mesh encloses if it is large against that of the mesh; else 0."""
    lower, upper = shape.bounds
    if shape.volume > THIN * float(np.prod(upper - lower)):
        return 0.0
    most = 0.0
    for up in np.eye(3):
        wall = Wall(_solid(placed(shape)), up)
        inset = CLEAR * (wall.high - wall.low)
        found = wall.space(wall.low + inset, wall.high - inset, None)
        most = max(most, 0.0 if found is None else _volume(found))
    return most if most > HOLLOW * shape.volume else 0.0


def _between(solid: Any, up: Floats, floor: float, lid: float) -> Any:
    """Return what of a solid lies between two levels."""
    return solid.trim_by_plane((-up).tolist(), -lid).trim_by_plane(up.tolist(), floor)


def _solid(mesh: Triangles) -> Any:
    """Return the solid that a closed surface bounds, however its faces are wound.

    Raises
    ------
    DirtyMeshError
        If it is not closed.
    """
    library, (vertices, faces) = load("manifold3d"), mesh
    wound = faces[:, ::-1] if _volume(mesh) < 0 else faces
    solid = library.Manifold(library.Mesh64(vertices, np.ascontiguousarray(wound, dtype=np.uint64)))
    if solid.status() != library.Error.NoError:
        raise DirtyMeshError(
            f"wall is no closed surface once its rims are closed ({solid.status().name}): mend it with "
            "vg.repair, or 'voxgran repair' at the prompt"
        )
    return solid


def _nested(solids: Sequence[Any]) -> Any:
    """Return the sum of solids, from which those within it, cavities, are taken."""
    total = load("manifold3d").Manifold()
    for solid in sorted(solids, key=lambda one: -one.volume()):
        is_within = (solid - total).volume() <= SAME * solid.volume()
        total = total - solid if is_within else total + solid
    return total


def _closed(vertices: Floats, faces: Integers, up: Floats) -> Any:
    """Return the solid of an open surface with its rims closed: the highest one by a plane across gravity at its lowest
    point, the others by triangles of least area.
    """
    height = linear.matmul(vertices, up)
    tall = float(np.ptp(height))
    loops, levels = hole_loops(faces, len(vertices)), []
    for loop in loops:
        new, caps = closed_loop(vertices, faces, loop)
        vertices, faces = np.concatenate([vertices, new]), np.concatenate([faces, caps])
        level = height[loop]
        if level.mean() > (height.min() + height.max()) / 2 and np.ptp(level) > FLAT * tall:
            levels.append((float(level.mean()), float(level.min())))
    solid = _solid((vertices, faces))
    return solid.trim_by_plane((-up).tolist(), -max(levels)[1]) if levels else solid


def placed(shape: Shape) -> Triangles:
    """Return the triangles of a shape where they were made."""
    return shape.vertices + np.array(shape.offset), shape.faces


def _parts(solid: Any) -> list[Triangles]:
    """Return the connected parts of a solid, each with its cavities."""
    parts = [_triangles(part) for part in solid.decompose() if not part.is_empty()]
    return split(*_triangles(solid)) if any(_volume(part) < 0 for part in parts) else parts


def _chosen(parts: list[Triangles], point: Floats | None) -> Triangles | None:
    """Return the part that holds a point, or the largest one; None if there is none."""
    held = parts if point is None else [part for part in parts if _holds(part, point)]
    return max(held, key=_volume, default=None)


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
