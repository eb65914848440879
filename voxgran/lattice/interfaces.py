"""Surface of one grain of a label image, conforming to the surfaces of its neighbours.

Every voxel center is a node, and cubes of eight nodes are divided into six tetrahedra along their diagonals
(Freudenthal 1942, Kuhn 1960). Each edge between a node of the grain and another node has one vertex of the surface,
which both sides share. For any position on the edge the parts of a tetrahedron with different labels do not overlap:
neighbours share the same triangles, and no surface intersects itself. The vertices are placed where the shares of the
two labels in the smoothed image are equal, and in the plane of the border at the border of the image. Vertices towards
the void are shifted by a common share, so that the grain keeps its volume.
"""

import itertools

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.lazy import load
from voxgran.geometry.triangles import enclosed_volume

#: smallest distance of a vertex from a node, in edges
MARGIN = 0.05
#: lower bound of the difference of shares along an edge, so that no vertex jumps
LEAST_SLOPE = 0.05
#: accuracy of the shift
SHIFT = 1e-15

#: edges of the outward triangles in a right-handed tetrahedron, by the nodes that belong to the grain, as bits
_ONE = {1: ("01", "02", "03"), 2: ("01", "13", "12"), 4: ("23", "02", "12"), 8: ("23", "13", "03")}
_TWO = {3: ("02", "03", "13", "12"), 5: ("03", "01", "12", "23"), 9: ("01", "02", "23", "13")}
_HALF = {
    **{case: [edges] for case, edges in _ONE.items()},
    **{case: [(a, b, c), (a, c, d)] for case, (a, b, c, d) in _TWO.items()},
}
#: the other side of a cut has the same triangles with the opposite orientation
TRIANGLES = {**_HALF, **{15 - case: [(c, b, a) for a, b, c in made] for case, made in _HALF.items()}}


def fitted_surface(labels: Integers, own: Booleans, beyond: Booleans, *, smoothing: float) -> tuple[Floats, Integers]:
    """Return vertices (n, 3) and triangles (m, 3) of the surface of a grain, conforming to those of its neighbours.

    All images are (nx, ny, nz): `labels` around the grain, 0 for void, up to the range of the smoothing and mirrored
    beyond the border of the image; `own`, the voxels of the grain, none in the outermost layer; `beyond`, the voxels
    beyond the border. `smoothing` is the standard deviation of the Gaussian that rounds the steps, in voxels, above 0.
    Vertices are in voxels; triangles are outward, those of cavities inward. The enclosed volume is the number of
    voxels, unless there is too little void around the grain.
    """
    lower, upper, faces = _cut_edges(own)
    inside = own.ravel()[lower]
    here, there = np.where(inside, lower, upper), np.where(inside, upper, lower)
    nodes = np.column_stack(np.unravel_index(here, own.shape)) + 0.5
    way = np.column_stack(np.unravel_index(there, own.shape)) + 0.5 - nodes
    share, slope = _crossings(labels, beyond, here, there, smoothing)
    free = np.where(labels.ravel()[there] == 0, 1.0 / slope, 0.0) * ~beyond.ravel()[there]

    def vertices(shift: float) -> Floats:
        """Return the vertices after a shift of those at the void to a larger share of the grain."""
        return nodes + np.clip(share + shift * free, MARGIN, 1 - MARGIN)[:, None] * way

    wanted = float(own.sum())

    def missing(shift: float) -> float:
        """Return what the enclosed volume lacks after a shift; it falls."""
        return wanted - enclosed_volume(vertices(shift), faces)

    if missing(-1.0) <= 0.0 or not free.any():
        return vertices(-1.0), faces
    if missing(1.0) >= 0.0:
        return vertices(1.0), faces
    return vertices(load("scipy.optimize").brentq(missing, -1.0, 1.0, xtol=SHIFT, rtol=SHIFT)), faces


def _cut_edges(own: Booleans) -> tuple[Integers, Integers, Integers]:
    """Return the edges between nodes of the grain and others, by both nodes, and the triangles between them."""
    cells = tuple(n - 1 for n in own.shape)
    mixed = np.zeros(cells, dtype=np.uint8)
    for corner in itertools.product((0, 1), repeat=3):
        mixed += own[tuple(slice(c, c + n) for c, n in zip(corner, cells, strict=True))]
    place = np.nonzero((mixed > 0) & (mixed < 8))
    steps = np.array([own.shape[1] * own.shape[2], own.shape[2], 1])
    first, taken = np.ravel_multi_index(place, own.shape), own.ravel()
    found = []
    for order in itertools.permutations(range(3)):
        path = np.concatenate([[0], np.cumsum(steps[list(order)])])
        code = np.concatenate([[0], np.cumsum(4 >> np.array(order))])
        case = sum(taken[first + path[k]].astype(np.int64) << k for k in range(4))
        # a path along the axes in cyclic order is right-handed
        odd = order in ((0, 2, 1), (1, 0, 2), (2, 1, 0))
        for which, made in TRIANGLES.items():
            base = first[case == which]
            for edges in made:
                ends = [(int(edge[0]), int(edge[1])) for edge in (edges[::-1] if odd else edges)]
                found.append(np.column_stack([(base + path[a]) * 8 + code[b] - code[a] for a, b in ends]))
    keys, faces = np.unique(np.concatenate(found), return_inverse=True)
    lower, way = keys // 8, keys % 8
    upper = lower + (way >> 2 & 1) * steps[0] + (way >> 1 & 1) * steps[1] + (way & 1)
    return lower, upper, faces.reshape(-1, 3).astype(np.int64)


def _crossings(
    labels: Integers, beyond: Booleans, here: Integers, there: Integers, smoothing: float
) -> tuple[Floats, Floats]:
    """Return the positions of the vertices on the edges, as fractions from the grain, and the slopes of its share."""
    smooth, flat = load("scipy.ndimage").gaussian_filter, labels.ravel()
    part, slope, other = np.full(len(here), 0.5), np.ones(len(here)), flat[there]
    label = flat[here[0]]

    def shares(of: int) -> Floats:
        """Return the smoothed share of a label at all nodes."""
        return np.asarray(smooth((labels == of).astype(np.float64), smoothing, truncate=3.0).ravel())

    mine = shares(int(label))
    # edges at the border of the image, or to the same grain across a periodic face, are cut at the midpoint
    known = ~beyond.ravel()[there] & (other != label)
    for of in np.unique(other[known]).tolist():
        some = known & (other == of)
        difference = mine - shares(of)
        at_here, at_there = difference[here[some]], difference[there[some]]
        slope[some] = np.maximum(at_here - at_there, LEAST_SLOPE)
        # the same from both sides
        part[some] += (at_here + at_there) / (2 * slope[some])
    return part, slope
