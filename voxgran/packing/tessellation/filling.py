"""Spheres that fill the places of a mesh, wave by wave: all places of one kind are climbed from, the largest are taken.

The walls of a container are planes: the flat ones as they are, all others as tangent planes at the nearest points of
the wall, which are looked up again wherever a sphere reaches too far.
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.stopping import stop_if_asked
from voxgran.containers.model import Container, boundary_of, periods_of
from voxgran.geometry.level_grid import LevelGrid, level_cells
from voxgran.packing.tessellation.climb import AGAIN, HINT, MOST, MOVES, TAKEN, climb_all, link_all, take_largest
from voxgran.packing.tessellation.mesh import CELL, CORNER, TILE, outward, thickness, triangulated_by_tiles, with_images

#: columns of the queue: place, expected and largest radius, and kind of place
KIND, COLUMNS = 5, 6
#: places of holes that a sphere leaves around it
REST = CORNER + 1
#: places that are climbed from between two looks whether to stop
AT_ONCE = 2048
#: tangent planes of a place, at most, and how often they are looked up
PLANES, LOOKS = 4, 8
#: what a sphere may reach beyond a wall before another plane is looked up, in radii
BEYOND = 1e-12
#: distance of the next places from the center of a sphere, and the hole expected there, in radii of the sphere
NEXT, SMALLER = 1.3, 0.5
#: width of the layer of periodic images that the triangulation of spheres sees, in the largest radius
IMAGES = 3.0
#: reach of the look for walls, in expected radii
AROUND = 4.0
#: radius up to which a sphere grows between two looks, in expected ones
FARTHEST = 2.0


class Walls:
    """The walls of a container, for places counted from its lower corner."""

    def __init__(self, container: Container) -> None:
        self.container = container
        self.lower, upper = np.array(container.bounds)
        self.size = float((upper - self.lower).max())
        flat = boundary_of(container).flat
        rows = [(axis, side) for axis in range(container.dimension) for side in (1.0, -1.0) if flat[axis]]
        self.flat = np.zeros((len(rows), 4))
        for row, (axis, side) in enumerate(rows):
            self.flat[row, axis] = side
            self.flat[row, 3] = 0.0 if side > 0 else (upper - self.lower)[axis]
        self.is_flat = boundary_of(container).is_flat
        self.periodic = np.array(container.periodic, dtype=np.int64)
        self.lengths, self.periods = upper - self.lower, periods_of(container)
        self.thickness = thickness(container)
        #: half the shortest period: beyond it a sphere would overlap its own images
        self.widest = float(0.5 * self.lengths[self.periodic == 1].min(initial=np.inf))

    def depth(self, places: Floats) -> Floats:
        """Return the distances of places (n, 3) from the nearest wall, negative outside."""
        return -np.asarray(self.container.signed_distance(places + self.lower))

    def planes(self, places: Floats) -> Floats:
        """Return the tangent planes at the wall nearest to each place, (n, 4)."""
        distance, away = outward(self.container, places + self.lower, self.size)
        return np.column_stack([-away, (away * places).sum(axis=1) - distance])


def filled_cells(spheres: Floats, walls: Walls) -> LevelGrid:
    """Return cells in which all spheres (n, 4) are linked."""
    reach = spheres[:, 3].copy() if len(spheres) else np.ones(1)
    cells, level = level_cells(walls.lengths, walls.periods, reach, walls.container.dimension)
    link_all(spheres, level, cells)
    return cells


def climbed(spheres: Floats, queue: Floats, walls: Walls, smallest: float) -> tuple[Floats, Floats]:
    """Return for places of one kind the largest spheres there among those that stand, (m, 4), and what holds them.

    Those that would be smaller than the radius `smallest` have a radius of 0. What holds them, (m, 4, 3), are the
    directions from what they touch.
    """
    cells, found, normals = filled_cells(spheres, walls), np.zeros((len(queue), 4)), np.zeros((len(queue), 4, 3))
    starts = queue[:, :COLUMNS].copy()
    starts[:, MOVES] = queue[:, KIND] != CELL
    starts[:, HINT] = np.maximum(starts[:, HINT], smallest)
    for first in range(0, len(queue), AT_ONCE):
        stop_if_asked()
        part = slice(first, first + AT_ONCE)
        _climb_within(spheres, cells, walls, starts[part], found[part], normals[part], smallest)
    found[found[:, 3] < smallest, 3] = 0.0
    return found, normals


def _climb_within(
    spheres: Floats, cells: LevelGrid, walls: Walls, starts: Floats, found: Floats, normals: Floats, smallest: float
) -> None:
    """Write the spheres of some starts; walls that are not flat are looked up until no sphere reaches beyond one."""
    flat, dimension = len(walls.flat), walls.container.dimension
    planes = np.zeros((len(starts), flat + PLANES, 4))
    planes[:, :flat] = walls.flat
    known = np.full(len(starts), flat, dtype=np.int64)
    if walls.is_flat:
        climb_all(spheres, cells, dimension, starts, planes, known, found, normals)
        return
    near = np.flatnonzero(walls.depth(starts[:, :3]) < AROUND * starts[:, HINT])
    planes[near, flat], known[near] = walls.planes(starts[near, :3]), flat + 1
    todo = np.arange(len(starts))
    for look in range(LOOKS):
        part, directions = np.zeros((len(todo), 4)), np.zeros((len(todo), 4, 3))
        begin = starts[todo]
        # walls that are not known yet hold nothing: no climb goes far before they are looked up again
        begin[:, MOST] = np.minimum(begin[:, MOST], FARTHEST * begin[:, HINT])
        climb_all(spheres, cells, dimension, begin, planes[todo], known[todo], part, directions)
        depth = walls.depth(part[:, :3])
        found[todo], normals[todo] = part, directions
        found[todo, 3] = np.minimum(part[:, 3], np.maximum(depth, 0.0))
        beyond = (part[:, 3] > depth + BEYOND * part[:, 3]) & (part[:, 3] >= smallest)
        short = ~beyond & (part[:, 3] >= begin[:, MOST]) & (part[:, 3] < starts[todo, MOST])
        moves = begin[:, MOVES] > 0.0
        starts[todo[moves], :3] = part[moves, :3]
        starts[todo[short], HINT] *= 2.0
        new = todo[beyond]
        todo = todo[beyond | (short & moves)]
        if look == LOOKS - 1 or not len(todo):
            return
        # the oldest plane makes room for another one
        planes[new, flat + (known[new] - flat) % PLANES] = walls.planes(starts[new, :3])
        known[new] = np.minimum(known[new] + 1, flat + PLANES)


def taken(found: Floats, walls: Walls, slack: float) -> tuple[Integers, Integers]:
    """Return which spheres (m, 4) are taken, the largest first, and which are to climb again."""
    order = np.argsort(-found[:, 3], kind="stable")
    order = order[found[order, 3] > 0.0]
    if not len(order):
        return order, order
    spheres = found[order]
    cells, level = level_cells(walls.lengths, walls.periods, spheres[:, 3].copy(), walls.container.dimension)
    fate = np.zeros(len(order), dtype=np.int64)
    take_largest(spheres, level, cells, slack, fate)
    return order[fate == TAKEN], order[fate == AGAIN]


def wrapped(places: Floats, walls: Walls) -> Floats:
    """Return places brought into the periodic lengths."""
    turns = np.where(walls.periodic == 1, np.floor(places / np.where(walls.lengths > 0.0, walls.lengths, 1.0)), 0.0)
    return np.asarray(places - turns * walls.lengths)


def next_places(spheres: Floats, normals: Floats, walls: Walls, most: float) -> Floats:
    """Return the queue of holes around spheres (k, 4): between each and all but one of what hold it.

    Around a sphere that is not held they lie along the axes.
    """
    dimension = walls.container.dimension
    holds = (normals != 0.0).any(axis=2)
    held = holds.sum(axis=1) == dimension + 1
    toward = -(normals.sum(axis=1, keepdims=True) - normals)
    use = holds & held[:, None]
    axes = np.vstack([np.eye(3)[:dimension], -np.eye(3)[:dimension]])
    free = np.flatnonzero(~held)
    owner = np.concatenate([np.nonzero(use)[0], np.repeat(free, len(axes))])
    way = np.concatenate([toward[use], np.tile(axes, (len(free), 1))])
    length = linear.norm(way, axis=1)
    owner, way = owner[length > 0.0], (way / np.where(length > 0.0, length, 1.0)[:, None])[length > 0.0]
    radius = spheres[owner, 3]
    rows = np.zeros((len(owner), COLUMNS))
    rows[:, :3] = wrapped(spheres[owner, :3] + NEXT * radius[:, None] * way, walls)
    rows[:, HINT], rows[:, MOST], rows[:, KIND] = SMALLER * radius, most, REST
    return rows


def last_places(spheres: Floats, walls: Walls, smallest: float, most: float) -> Floats:
    """Return the queue of all cells of the Delaunay triangulation of the centers that may hold a sphere.

    One whose middle is nearer than `smallest` to all four spheres is left out.
    """
    dimension = walls.container.dimension
    reach = IMAGES * float(spheres[:, 3].max(initial=0.0))
    rows = with_images(spheres, np.zeros(3), walls.lengths, walls.container.periodic, reach)
    cells = triangulated_by_tiles(rows, dimension, TILE * walls.thickness, reach)
    middle = rows[cells, :3].mean(axis=1)
    radius = linear.norm(rows[cells, :3] - middle[:, None], axis=2) - rows[cells, 3]
    use = (
        (radius.max(axis=1) >= smallest)
        & (middle >= 0.0).all(axis=1)
        & (middle < walls.lengths + (np.arange(3) >= dimension)).all(axis=1)
    )
    queue = np.zeros((int(use.sum()), COLUMNS))
    queue[:, :3] = middle[use]
    queue[:, HINT], queue[:, MOST], queue[:, KIND] = smallest, most, REST
    return queue
