"""Distances of many pairs of closed surfaces, and a proof of separation where possible.

Pairs of the same two shapes are processed in one kernel. Pairs without proof (surfaces that meet, or a grain that may
lie inside another) are left to :mod:`voxgran.contacts.meshes`.
"""

import math
from collections.abc import Callable

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats
from voxgran._base.compiling.threads import in_blocks, thread_count
from voxgran._base.kernels import kernel
from voxgran._base.progress import OnStep, Step, silent
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import Pairs
from voxgran.contacts.meshes import ROUNDING
from voxgran.contacts.triangles import boxed_arrays, find_nearest_pair
from voxgran.geometry.tree import TriangleTree

#: number of pairs that a thread processes between two checks for a request to stop
AT_ONCE = 64
#: pairs of which a thread takes no fewer
LEAST_PAIRS = 16


def surface_gaps(
    assembly: Assembly, pairs: Pairs, gap: float, *, tree_of: Callable[[int], TriangleTree], on_step: OnStep = silent
) -> tuple[Floats, Floats, Floats, Booleans]:
    """Return gap, normal, point and proven of m pairs of grains with closed surfaces; gaps beyond `gap` are infinite.

    The normals (m, 3) point from grain i to its partner, the points (m, 3) are the middles between the nearest points,
    from centroid i. Pairs that are not proven to be separate have undefined values. `tree_of` gives the box tree of a
    shape.

    Raises
    ------
    Stopped
        If a stop of the run was requested.
    """
    m = pairs.count
    found, near = np.full(m, np.inf), np.zeros((m, 6))
    proven = np.zeros(m, dtype=np.bool_)
    one, other = assembly.shape_id[pairs.i], assembly.shape_id[pairs.j]
    turn, scale = assembly.matrices[pairs.i], assembly.scale[pairs.i]
    stretch = assembly.scale[pairs.j] / scale
    matrix = linear.einsum("kji,kjl->kil", turn, assembly.matrices[pairs.j]) * stretch[:, None, None]
    offset = linear.einsum("kji,kj->ki", turn, pairs.offset) / scale[:, None]
    done = 0
    for a, b in np.unique(np.column_stack([one, other]), axis=0).tolist():
        some = np.flatnonzero((one == a) & (other == b))
        trees = tree_of(a), tree_of(b)
        far = linear.norm(offset[some], axis=1)
        margin = ROUNDING * (trees[0].size + stretch[some] * trees[1].size + far)
        reach = np.maximum(max(gap, 0.0) / scale[some], margin)
        distance, points = np.full(len(some), np.inf), np.zeros((len(some), 6))
        poses = np.ascontiguousarray(matrix[some]), offset[some], reach, distance, points
        known = boxed_arrays(trees[0], len(some)), boxed_arrays(trees[1], len(some))
        together = AT_ONCE * thread_count()
        for first in range(0, len(some), together):
            stop_if_asked()
            on_step(Step(stage="surfaces", done=done, total=m, text=f"{done} of {m} pairs"))
            part = [array[first : first + together] for array in poses]
            in_blocks(_nearest_of_pairs, len(part[0]), *known, *part, least=LEAST_PAIRS)
            done += len(part[0])
        found[some], near[some] = distance, points
        proven[some] = (distance > margin) & ~_nested(trees, matrix[some], offset[some], stretch[some])
    apart = near[:, 3:] - near[:, :3]
    length = linear.norm(apart, axis=1)
    unit = np.divide(apart, length[:, None], out=np.zeros_like(apart), where=length[:, None] > 0)
    normal = linear.einsum("kij,kj->ki", turn, unit)
    point = linear.einsum("kij,kj->ki", turn, near[:, :3] + near[:, 3:]) * scale[:, None] / 2
    return found * scale, normal, point, proven & ((length > 0) | np.isinf(found))


def _nested(trees: tuple[TriangleTree, TriangleTree], matrix: Floats, offset: Floats, stretch: Floats) -> Booleans:
    """Return the mask of the pairs in which a corner of one surface lies inside the other."""
    one, other = trees
    theirs = linear.matmul(matrix, other.corners[0, 0]) + offset
    mine = linear.einsum("kji,kj->ki", matrix, one.corners[0, 0] - offset) / stretch[:, None] ** 2
    held = np.zeros(len(matrix), dtype=np.bool_)
    for points, tree in ((theirs, one), (mine, other)):
        near = np.flatnonzero(((points >= tree.low[0]) & (points <= tree.high[0])).all(axis=1) & ~held)
        held[near] = tree.signed_distance(points[near]) < 0
    return held


@kernel
def _nearest_of_pairs(one, other, matrix, offset, reach, distance, points, first, stop):  # type: ignore[no-untyped-def]
    """Write the distance and the nearest points of two surfaces in a block of poses."""
    for k in range(first, stop):
        square = find_nearest_pair(one, other, matrix[k], offset[k], reach[k], points[k])
        distance[k] = math.sqrt(square)
