"""Smooth surfaces of all labels of an image at once: neighbours share their triangles, and each label keeps its volume.

The points of the net of voxel faces (:mod:`voxgran.lattice.label_net`) are smoothed within boxes of a voxel by a filter
that does not shrink (Taubin 1995, doi:10.1145/218380.218473). Points of lines where three labels meet move along these
lines only, and those at the border of the image in its plane, so that neither is rounded. Then each label gets a
pressure, and its points move along the gradient of its volume: the least motion that restores all volumes is a linear
system of one equation for each label. Sharing does not prevent that triangles cross, above all near lines where three
labels meet: there the smoothing is taken back until none do.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran.lattice.label_net import Net, Split, net_of, split_of, triangles_of
from voxgran.lattice.label_pieces import Tiles, keep_largest_pieces, tiles_of
from voxgran.lattice.label_seams import Seams
from voxgran.lattice.label_volumes import BOX, PARTS, Findings, examine, push

#: share of the mean of its neighbours that a point takes in each of the two steps of the filter
STEPS = 0.63, -0.67
#: pairs of steps for a smoothing of one voxel; how far they round a step of voxels grows with the root of their number
PAIRS = 20
#: relative errors of the volumes: what may be left, and from which on a label is smoothed less
ACCURACY, LOST = 1e-6, 0.2
#: error of a volume in voxels that may be left: what steps of points round
ROUNDED = 8 / PARTS
#: rounding of the missing volumes, relative to the largest one
ROUNDING = 1e-9
#: by how much volumes resist pressures more than they do
SLACK = 1e-7
#: solutions for the volumes, and times that what is moved is halved where triangles cross
MOST_SOLUTIONS, MOST_REPAIRS = 36, 4


@dataclass(frozen=True, slots=True)
class LabelSurfaces:
    """Closed surfaces of the labels 1 ... n of an image."""

    net: Net
    split: Split
    moved: NDArray[np.float32]  # (points, 3) displacement of each point of the net, in voxels: whole steps
    turn: Integers  # (n + 1, 3) corners before this one follow after the end of a periodic axis
    tiles: Tiles  # of labels that fill every plane of a periodic axis
    shape: Integers  # (3,) of the image
    crossed: Booleans  # (quadrangles,) which are cut from point 1 to 3
    corner: Integers  # (3,) where the image begins, in voxels
    several: list[int]  # labels of several pieces, of which the largest is left

    def of(self, label: int) -> tuple[Floats, NDArray[np.int32]]:
        """Return the vertices (v, 3) in voxels, and the outward triangles (m, 3), of a label.

        Voxel (i, j, k) is the cube from (i, j, k) to (i + 1, j + 1, k + 1). Across a periodic face a label goes on
        beyond the end of the image; one that winds around the torus is cut in this face.
        """
        triangles, point, number = triangles_of(self.net, self.split, label, self.crossed)
        at = self.net.at[point]
        if self.turn[label].any():
            at = at + self.shape * (at < self.turn[label])
        if len(self.tiles.label) > len(self.turn):
            at = at + self.shape * self.tiles.tile[number]
        if self.corner.any():
            at = at + self.corner
        return np.asarray(at + self.moved[point].astype(np.float64), dtype=np.float64), triangles


def label_surfaces(
    labels: NDArray[np.int32],
    count: int,
    *,
    wraps: Booleans,
    smoothing: float,
    spacing: Floats,
    seams: Seams | None = None,
) -> LabelSurfaces:
    """Return the surfaces of an (nx, ny, nz) image of labels 1 ... `count`, each of which is there, 0 for void.

    `wraps`, (3,): which axes are periodic.  `smoothing`: in voxels; 0 for the faces of the voxels.  `spacing`, (3,):
    edges of a voxel.  `seams`: what is known where the image is a part of a larger one, and begins at its corner.  The
    image is changed: of several pieces of a label the largest is left.
    """
    shape = np.array(labels.shape, dtype=np.int64)
    # along an axis of one voxel each label meets itself, and is cut there as at a border
    wraps = wraps & (shape > 1)
    # the others may be in pieces because the image cuts them
    among = np.ones(count + 1, dtype=np.bool_) if seams is None else seams.whole
    several = keep_largest_pieces(labels, among, wraps)
    wanted = np.maximum(
        sum(np.bincount(plane.ravel(), minlength=count + 1) for plane in labels) * spacing.prod(), 1e-300
    )
    turn, endless = _unrolled(labels, count, wraps)
    tiles = tiles_of(labels, count, wraps, endless)
    net = net_of(labels, tiles)
    split = split_of(net, count)
    del labels
    held = ((net.at == 0) | (net.at == shape)) & ~wraps
    moved = np.zeros((len(net.at), 3), dtype=np.float32)
    crossed = np.zeros(len(net.quad), dtype=np.bool_)
    if smoothing > 0:
        factors = np.array(STEPS * max(1, round(PAIRS * smoothing**2)), dtype=np.float32)
        moved = _smoothed(net.near, net.triple, held, factors, np.float32(BOX))
    # these are not needed any more
    net = net._replace(near=np.zeros((0, 6), dtype=np.int32), triple=np.zeros(0, dtype=np.uint8))
    if smoothing > 0:
        crossed = _is_second_shorter(net.quad, net.axis, moved, spacing)
        if seams is not None:
            seams.put(net, moved, held, crossed)
    corner = np.zeros(3, dtype=np.int64) if seams is None else seams.corner
    made = LabelSurfaces(net, split, moved, turn, tiles, shape, crossed, corner, several)
    if smoothing > 0:
        _restore_volumes(made, held, wanted, spacing, seams)
    return made


def _unrolled(labels: NDArray[np.int32], count: int, wraps: Booleans) -> tuple[Integers, list[int]]:
    """Return where each label begins along periodic axes, as `LabelSurfaces.turn`, and which ones fill every plane of
    an axis, so that they begin nowhere.
    """
    turn, endless = np.zeros((count + 1, 3), dtype=np.int64), np.zeros(count + 1, dtype=np.bool_)
    for axis in np.flatnonzero(wraps).tolist():
        planes = np.moveaxis(labels, axis, 0)
        full = np.zeros((len(planes), count + 1), dtype=np.bool_)
        for plane, row in zip(planes, full, strict=True):
            row[plane.ravel()] = True
        turn[:, axis] = np.where(full[0], full.argmin(axis=0) + 1, 0)
        endless |= full.all(axis=0)
    endless[0] = False
    turn[endless], turn[0] = 0, 0
    return turn, np.flatnonzero(endless).tolist()


def _restore_volumes(made: LabelSurfaces, held: Booleans, wanted: Floats, spacing: Floats, seams: Seams | None) -> None:
    """Move the points so that each label has the volume of its voxels, (n + 1,), and no triangles cross.

    What is left of labels that a window cuts may have any volume: just its own ones, of `seams`, must be right.
    """
    net, crossed, moved, count, repairs = made.net, made.crossed, made.moved, len(wanted), 0
    own = np.ones(count, dtype=np.bool_) if seams is None else seams.own
    mine = np.ones(len(moved), dtype=np.bool_) if seams is None else seams.touched(net, own)
    # a later label gets points from this window: they must leave it its volume
    due = own if seams is None else seams.due & seams.beside(net, mine, count)
    for attempt in range(MOST_SOLUTIONS):
        found = examine(net, crossed, moved, held, spacing=spacing, labels=count - 1)
        missing = -found.change
        error, least = np.abs(missing), ACCURACY * wanted + ROUNDED * spacing.prod()
        # where all is held nothing can be done any more
        wrong = np.flatnonzero(found.wrong & ~held.all(axis=1))
        wrong = wrong if mine[wrong].any() else wrong[:0]
        if (error <= least)[due].all() and not len(wrong):
            return
        lost = (error > LOST * wanted) | ((error > least) & (found.diagonal <= 0))
        if (lost & due).any():
            # labels of few voxels, which the filter all but ends, or whose points all lie at the ends of their boxes
            some = np.unique(net.quad[(lost & due)[np.maximum(net.side, 0)].any(axis=1)])
            some = some[~held[some].all(axis=1) & moved[some].any(axis=1)]
            if len(some):
                _take_back(moved, some, attempt < MOST_SOLUTIONS // 3)
                continue
        # labels whose points a seam holds stay as they are
        missing[lost | (found.diagonal == 0)] = 0.0
        pressure = _pressures(found, missing)
        push(net, crossed, moved, held, spacing=spacing, pressure=pressure, ease=found.ease)
        if len(wrong):
            _take_back(moved, wrong, repairs < MOST_REPAIRS)
            # in the end such points stay at their corners of voxels, where nothing crosses
            held[wrong] |= repairs >= MOST_REPAIRS
            repairs += 1


def _take_back(moved: NDArray[np.float32], some: Integers, halved: bool) -> None:
    """Halve how far some points are moved, in whole steps, or put them back where they were."""
    moved[some] = np.rint(moved[some] * (PARTS / 2)) / PARTS if halved else 0.0


def _pressures(found: Findings, missing: Floats) -> Floats:
    """Return the pressures that bring the missing volumes back, both (n + 1,)."""
    sparse, size = load("scipy.sparse"), len(missing)
    half = sparse.coo_array((found.shared, np.divmod(found.pairs, size)), shape=(size, size)).tocsr()
    # labels that fill what is left between points which are held have a sum of volumes that no pressures change: a
    # little more than the coupling on the diagonal leaves them the pressure that is equal, and moves nothing
    diagonal = np.maximum(found.diagonal, 1e-30) * (1 + SLACK)
    system = half + half.T + sparse.diags_array(diagonal)
    # pressures that are all equal move nothing: what rounding leaves of the volumes cannot be solved for
    rounding = ROUNDING * float(np.abs(missing).max())
    return linear.conjugate_gradient(system, missing, relative=1e-6, absolute=rounding)


@kernel
def _smoothed(near, triple, held, factors, box):  # type: ignore[no-untyped-def]
    """Return the displacements after steps towards the mean of the neighbours, each by one of the factors; in `near`
    what is not followed becomes n.

    A point on a line where three labels meet, which has two or more of its edges, follows its neighbours on them only.
    """
    n, size = len(near), np.float32(PARTS)
    # for each set of half edges a third of the sum of the steps along them ... and how much each of them counts
    table = np.zeros((64, 4), dtype=np.float32)
    for some in range(1, 64):
        count = np.float32(0.0)
        for half in range(6):
            if some >> half & 1:
                count += np.float32(1.0)
                table[some, half >> 1] += np.float32(2 * (half & 1) - 1)
        for axis in range(3):
            table[some, axis] /= count
        table[some, 3] = np.float32(1.0) / count
    uses, stuck, many = np.zeros(n, dtype=np.uint8), np.empty(n, dtype=np.int32), 0
    for v in range(n):
        line = triple[v] & (triple[v] - 1) != 0
        for half in range(6):
            if near[v, half] >= 0 and (not line or triple[v] >> half & 1):
                uses[v] |= 1 << half
            else:
                near[v, half] = n
        if held[v, 0] or held[v, 1] or held[v, 2]:
            stuck[many] = v
            many += 1
    # row n stays 0
    now, new = np.zeros((n + 1, 3), dtype=np.float32), np.zeros((n + 1, 3), dtype=np.float32)
    for factor in factors:
        for v in range(n):
            some = uses[v]
            # numbers without a sign are not tested for it
            a, b, c = np.uint32(near[v, 0]), np.uint32(near[v, 1]), np.uint32(near[v, 2])
            d, e, f = np.uint32(near[v, 3]), np.uint32(near[v, 4]), np.uint32(near[v, 5])
            share = table[some, 3]
            for axis in range(3):
                total = (now[a, axis] + now[b, axis]) + (now[c, axis] + now[d, axis]) + (now[e, axis] + now[f, axis])
                step = factor * (total * share + table[some, axis] - now[v, axis])
                new[v, axis] = min(max(now[v, axis] + step, -box), box)
        for k in range(many):
            v = stuck[k]
            for axis in range(3):
                if held[v, axis]:
                    new[v, axis] = np.float32(0.0)
        now, new = new, now
    moved = np.empty((n, 3), dtype=np.float32)
    for v in range(n):
        for axis in range(3):
            moved[v, axis] = np.floor(now[v, axis] * size + np.float32(0.5)) / size
    return moved


@kernel
def _is_second_shorter(quad, axis, moved, spacing):  # type: ignore[no-untyped-def]
    """Return whether the diagonal from point 1 to 3 of each quadrangle is shorter than that from 0 to 2."""
    shorter = np.empty(len(quad), dtype=np.bool_)
    for q in range(len(quad)):
        first = second = 0.0
        for a in range(3):
            one = spacing[a] if a == (axis[q] + 1) % 3 else 0.0
            two = spacing[a] if a == (axis[q] + 2) % 3 else 0.0
            first += ((moved[quad[q, 2], a] - moved[quad[q, 0], a]) * spacing[a] + one + two) ** 2
            second += ((moved[quad[q, 3], a] - moved[quad[q, 1], a]) * spacing[a] - one + two) ** 2
        shorter[q] = second < first
    return shorter
