"""The records that the kernels of control-point packing read: grains, shapes, walls, scratch."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.packing.control_point.distance_fields import Fields, Reaches
from voxgran.packing.control_point.point_trees import Trees

#: columns of `PairCache.pairs`: number of the pair (-1: none), the control points that refused it last (-1: none), and
#: filled rows of `lists`; with signed distances one point, and whether it belongs to the second grain
PAIR, POINT, OTHER_POINT, COUNT = range(4)
#: columns of `PairCache.poses`: rotation matrix row by row, shift, slack, and a direction
TURN, SHIFT, SLACK, WAY = 0, 9, 12, 13


class PairCache(NamedTuple):
    """What is known of pairs of grains that were compared.

    In the relative pose of `poses`, all control points were farther apart than they must be by the slack, those in
    `lists` excepted; these are empty with signed distances. The direction is that towards the grain of lower number
    along which the two were farthest apart last (zero: none).
    """

    pairs: Integers
    poses: Floats
    lists: Integers


@bare_kernel
def row_of_pair(room: int, pair: int) -> int:
    """Return the entry of a pair in a table whose length is a power of two."""
    return (pair * 2654435761 >> 7) & (room - 1)


@bare_kernel
def claim_row(pairs: Integers, poses: Floats, pair: int) -> int:
    """Return the entry of a pair, cleared where another pair had it."""
    row = row_of_pair(len(pairs), pair)
    if pairs[row, PAIR] != pair:
        pairs[row, PAIR], pairs[row, POINT], pairs[row, COUNT], poses[row, SLACK] = pair, -1, 0, -1.0
        poses[row, WAY], poses[row, WAY + 1], poses[row, WAY + 2] = 0.0, 0.0, 0.0
    return row


@bare_kernel
def keep_pose(poses: Floats, row: int, relative: Floats, shift: Floats, slack: float) -> None:
    """Store a relative pose that was not refused, and its slack."""
    poses[row, SLACK] = slack
    for m in range(3):
        poses[row, SHIFT + m] = shift[m]
        for n in range(3):
            poses[row, TURN + 3 * m + n] = relative[m, n]


@inlined_kernel
def moved_since(poses: Floats, row: int, relative: Floats, shift: Floats, radius: float) -> float:
    """Return an upper bound of the displacement of points within a radius since a relative pose was stored."""
    way, spin = 0.0, 0.0
    for m in range(3):
        way += (shift[m] - poses[row, SHIFT + m]) ** 2
        for n in range(3):
            spin += (relative[m, n] - poses[row, TURN + 3 * m + n]) ** 2
    # two rotations differ by a matrix with two equal singular values and a zero
    return float(np.sqrt(way) + np.sqrt(0.5 * spin) * radius)


#: kinds of walls
FLAT, ROUND, MESH, BALL = 0, 1, 2, 3
#: tests of contact
SDF, KDTREE = 0, 1
#: columns of the extent of a grain: bounding radius, half the spacing of its points, volume over surface, largest
#: curvature of its surface (below 0 where that is not smooth), error of a smooth surface, and distance that its points
#: keep at the most from other surfaces; stretch and limit of its `Reaches`, and 1 where it is a sphere that is compared
#: with others by its center, else 0
RADIUS, HALF_SPACING, HALF_THICKNESS, CURVATURE, SURFACE_ERROR, KEEP_OUT, STRETCH, LIMIT, IS_SPHERE = range(9)


class Bodies(NamedTuple):
    """The shapes at unit diameter; with a mesh container, the last tree and the last triangles are its own.

    `spacing` is twice the covering radius of the control points. The points `hull` with room `margin` around each hold
    the solid in their convex hull. `contact` is the test of contact, `both` whether the control points of both grains
    are tested against the signed distance of the other; `reaches` are the support functions of the shapes.
    """

    contact: int
    both: bool
    trees: Trees
    fields: Fields
    reaches: Reaches
    radius: Floats
    spacing: Floats
    hull: Floats
    hull_start: Integers
    margin: Floats
    triangles: Floats
    triangle_start: Integers


class GrainPoses(NamedTuple):
    """Positions of the grains, longest step that each one tries, its `extent` by the columns above, and its `span`.

    The span is how far it reaches down and up along each axis; it is empty where there are no reaches. `lifted` counts
    the upward moves that each grain still makes after a collision.
    """

    position: Floats
    orientation: Floats
    placed: Integers
    step: Floats
    shape: Integers
    diameter: Floats
    extent: Floats
    span: Floats
    lifted: Integers


class Walls(NamedTuple):
    """The container: its bounds, which axes have walls and which are periodic, the radius of a round one.

    Where there is a `lid`, it is the flat wall against gravity, and the bounds tell where it is now.
    """

    kind: int
    lower: Floats
    upper: Floats
    walled: Integers
    periodic: Integers
    radius: float
    offset: Floats
    lid: bool


class Scratch(NamedTuple):
    """Room for the pose that is tried, for a relative pose, for a walk over two trees, and for neighbours to be
    compared.
    """

    place: Floats
    quaternion: Floats
    turn: Floats
    span: Floats
    way: Floats
    plane: Floats
    relative: Floats
    shift: Floats
    stack: Integers
    listed: Integers
    pending: Integers


class Cells(NamedTuple):
    """Linked cells of the centers: the first grain of each cell, the next grain after each grain (-1: none).

    `reach` is the largest bounding radius plus the largest distance at which two grains are refused.
    """

    lower: Floats
    width: Floats
    count: Integers  # type: ignore[assignment]
    head: Integers
    after: Integers
    reach: float


class CloseLists(NamedTuple):
    """Which grains are near each other: see :mod:`voxgran.packing.control_point.verlet_lists`."""

    anchor: Floats  # (n, 3): positions of the grains when the lists were made
    near: NDArray[np.int32]  # (n, ROOM): other grains near each one; without rows where there are no lists
    many: Integers  # (n,): how many there are
    state: Integers  # (1,): 0: the lists hold; 1: they have to be made; 2: there was a row too short for them
    slip: float  # largest displacement of a grain from its anchor


class WalkRules(NamedTuple):
    """How grains move.

    entry: the lattice vector along which gravity is strongest, against which grains enter; zero where they enter
    anywhere.  in_turn, falls: whether they enter in turn, and whether they fall when they do.  newest: how
    many of the newest grains move.  shares, vibration: fractions and schedule by the names of
    :mod:`voxgran.packing.walking.vibration`.  oriented: whether grains enter in the orientations that they have, which
    are random otherwise.  lifts: number of upward moves after a collision; 0 where vibration is one of cycles.
    """

    gravity: Floats
    tilt: float
    entry: Integers
    in_turn: bool
    falls: bool
    newest: int
    shares: Floats
    vibration: Integers
    longest: float
    shortest: float
    dimension: int
    oriented: bool
    lifts: int


class Pairs(NamedTuple):
    """What the comparison of two grains reads and writes; they are kept apart by `gap`, in median diameters."""

    grains: GrainPoses
    bodies: Bodies
    cache: PairCache
    scratch: Scratch
    gap: float


class World(NamedTuple):
    """What attempts read and write."""

    pairs: Pairs
    cells: Cells
    lists: CloseLists
    walls: Walls
    rules: WalkRules
