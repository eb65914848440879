"""Smooth surfaces of all labels of an image at once: neighbours share their triangles, and each label keeps its volume.

The points of the net of voxel faces (:mod:`voxgran.lattice.label_net`) are smoothed within boxes of a voxel by a filter
that does not shrink (Taubin 1995, doi:10.1145/218380.218473). Points of lines where three labels meet move along these
lines only, and those at the border of the image in its plane, so that neither is rounded. Then each label gets a
pressure, and its points move along the gradient of its volume: the least motion that restores all volumes is a linear
system of one equation for each label. Sharing does not prevent that triangles cross, above all near lines where three
labels meet: there the smoothing is taken back until none do.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.lazy import load
from voxgran.geometry.crossing import is_crossing
from voxgran.geometry.vectors import add, corner_of, cross, dot, row_of, sub, times
from voxgran.lattice.label_net import Net, Split, net_of, split_of
from voxgran.lattice.label_pieces import keep_largest_pieces
from voxgran.lattice.label_seams import Seams

#: share of the mean of its neighbours that a point takes in each of the two steps of the filter
STEPS = 0.63, -0.67
#: pairs of steps for a smoothing of one voxel; how far they round a step of voxels grows with the root of their number
PAIRS = 20
#: farthest that a point moves along an axis, in voxels
BOX = 0.5
#: relative errors of the volumes: what is left, after which a single solution is enough, and from which on a label is
#: smoothed less
ACCURACY, ALMOST, LOST = 1e-12, 1e-5, 0.2
#: relative rounding of the volume of a label
ROUNDING = 1e-15
#: overlap from which on two triangles count as crossing, in voxels
DEPTH = 1e-9
#: solutions for the volumes, and times that smoothing is taken back where triangles cross
MOST_SOLUTIONS, MOST_ROUNDS = 12, 12


@dataclass(frozen=True, slots=True)
class LabelSurfaces:
    """Closed surfaces of the labels 1 ... n of an image."""

    net: Net
    split: Split
    moved: Floats  # (points, 3) displacement of each point of the net, in voxels
    turn: Integers  # (n + parts + 1, 3) corners before this one follow after the end of a periodic axis
    shape: Integers  # (3,) of the image
    crossed: Booleans  # (quadrangles,) which are cut from point 1 to 3
    corner: Integers  # (3,) where the image begins, in voxels
    several: list[int]  # labels of several pieces, of which the largest is left
    parts: dict[int, list[int]]  # numbers of the parts of labels that fill every plane of a periodic axis

    def of(self, label: int) -> list[tuple[Floats, NDArray[np.int32]]]:
        """Return the vertices (v, 3) in voxels, and the outward triangles (m, 3), of a label, or of each of its parts.

        Voxel (i, j, k) is the cube from (i, j, k) to (i + 1, j + 1, k + 1). Across a periodic face a label goes on
        beyond the end of the image. Parts share the triangles between them.
        """
        return [self._of(part) for part in self.parts.get(label, [label])]

    def _of(self, label: int) -> tuple[Floats, NDArray[np.int32]]:
        """Return vertices and triangles of a label or part."""
        rows = slice(self.split.first_vertex[label], self.split.first_vertex[label + 1])
        point = self.split.point[rows]
        at = self.net.at[point]
        if self.turn[label].any():
            at = at + self.shape * (at < self.turn[label])
        if self.corner.any():
            at = at + self.corner
        rows = slice(self.split.first_triangle[label], self.split.first_triangle[label + 1])
        return at + self.moved[point], self.split.triangles[rows]


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
    turn, parts = _unrolled(labels, count, wraps)
    net = net_of(labels, wraps)
    held = ((net.at == 0) | (net.at == shape)) & ~wraps
    moved: Floats = np.zeros((len(net.at), 3))
    crossed = np.zeros(len(net.quad), dtype=np.bool_)
    if smoothing > 0:
        factors = np.array(STEPS * max(1, round(PAIRS * smoothing**2)), dtype=np.float32)
        moved = _smoothed(net.near, net.triple, held, factors, np.float32(BOX)).astype(np.float64)
        crossed = _is_second_shorter(net.quad, net.axis, moved * spacing, spacing)
        if seams is not None:
            seams.put(net, moved, held, crossed)
    split = split_of(net, len(turn) - 1, crossed)
    corner = np.zeros(3, dtype=np.int64) if seams is None else seams.corner
    made = LabelSurfaces(net, split, moved, turn, shape, crossed, corner, several, parts)
    if smoothing > 0:
        wanted = np.asarray(np.bincount(labels.ravel(), minlength=len(turn))[1:] * spacing.prod(), dtype=np.float64)
        for attempt in range(MOST_ROUNDS):
            _restore_volumes(made, held, wanted, spacing)
            wrong = _crossing_points(net, crossed, moved)
            if not wrong.any():
                break
            moved[wrong & ~held.all(axis=1)] *= 0.5 if attempt < MOST_ROUNDS // 3 else 0.0
            # in the end such points stay at their corners of voxels, where nothing crosses
            held[wrong] |= attempt >= MOST_ROUNDS // 3
    return made


def _unrolled(labels: NDArray[np.int32], count: int, wraps: Booleans) -> tuple[Integers, dict[int, list[int]]]:
    """Return where each label begins along periodic axes, as `LabelSurfaces.turn`, and divide those without an end.

    Those that fill every plane of an axis are cut in the first plane of corners and in a middle one: the upper half
    becomes a part of its own, and begins at the cut in the middle.
    """
    turn = np.zeros((count + 1, 3), dtype=np.int64)
    parts: dict[int, list[int]] = {}
    filled = []
    for axis in np.flatnonzero(wraps).tolist():
        planes = np.moveaxis(labels, axis, 0)
        full = np.zeros((len(planes), count + 1), dtype=np.bool_)
        for plane, row in zip(planes, full, strict=True):
            row[plane.ravel()] = True
        turn[:, axis] = np.where(full[0] & ~full.all(axis=0), full.argmin(axis=0) + 1, 0)
        turn[0] = 0
        filled += [(axis, label) for label in np.flatnonzero(full.all(axis=0)).tolist() if label]
    for axis, label in filled:
        half = labels.shape[axis] // 2
        lower, upper = np.split(np.moveaxis(labels, axis, 0), [half])
        for part in list(parts.setdefault(label, [label])):
            taken = upper == part
            if not (lower == part).any():
                continue
            if taken.any():
                upper[taken] = len(turn)
                parts[label].append(len(turn))
                turn = np.concatenate([turn, turn[part : part + 1]])
            turn[part, axis] = half + 1
    return turn, parts


def _restore_volumes(made: LabelSurfaces, held: Booleans, wanted: Floats, spacing: Floats) -> None:
    """Move the points so that each label has the wanted volume, (n,)."""
    sparse, moved, split = load("scipy.sparse"), made.moved, made.split
    count = len(wanted)
    owner = np.repeat(np.arange(count + 1), np.diff(split.first_vertex))
    for attempt in range(MOST_SOLUTIONS):
        volume, gradient, weight = _volumes(*split, made.net.at, moved, spacing, made.turn, made.shape)
        missing = wanted - volume[1:]
        error = np.abs(missing) / wanted
        if error.max() <= ACCURACY:
            return
        ease = _ease(held, moved, weight, BOX)
        diagonal, *pairs = _coupling(split.point, owner, gradient, ease, count)
        lost = (error > LOST) | ((error > ACCURACY) & (diagonal[1:] <= 0))
        # labels of few voxels, which the filter all but ends, or whose points all lie at the ends of their boxes
        some = np.unique(split.point[np.isin(owner, np.flatnonzero(lost) + 1)])
        some = some[~held[some].all(axis=1) & moved[some].any(axis=1)]
        if len(some):
            moved[some] *= 0.5 if attempt < MOST_SOLUTIONS // 3 else 0.0
            continue
        half = sparse.coo_array((pairs[2], (pairs[0] - 1, pairs[1] - 1)), shape=(count, count)).tocsr()
        system = half + half.T + sparse.diags_array(diagonal[1:])
        # labels whose points a seam holds stay as they are
        lost |= diagonal[1:] == 0
        missing[lost] = error[lost] = 0.0
        scale = sparse.diags_array(1 / np.maximum(diagonal[1:], 1e-30))
        # pressures that are all equal move nothing: what rounding leaves of the volumes cannot be solved for
        rounding = ROUNDING * float(wanted.max())
        solved = load("scipy.sparse.linalg").cg(system, missing, rtol=1e-8, atol=rounding, M=scale)[0]
        pressure = np.append(0.0, solved)
        farthest = _push(moved, *(split.point, owner, gradient, pressure, ease, spacing))
        if error.max() < ALMOST and farthest <= BOX:
            # the next error is about the square of this one
            return
        np.clip(moved, -BOX, BOX, out=moved)


@kernel
def _ease(held, moved, weight, box):  # type: ignore[no-untyped-def]
    """Return how easily each point moves along each axis, (n, 3): the less the more area is around it."""
    ease = np.empty(moved.shape)
    for v in range(len(moved)):
        for axis in range(3):
            ease[v, axis] = 0.0 if held[v, axis] or abs(moved[v, axis]) >= box else 1 / weight[v]
    return ease


@kernel
def _push(moved, point, owner, gradient, pressure, ease, spacing):  # type: ignore[no-untyped-def]
    """Move the points by the pressures of the labels; return the farthest that one of them is then from its corner."""
    push, farthest = np.zeros(moved.shape), 0.0
    for v in range(len(point)):
        for axis in range(3):
            push[point[v], axis] += gradient[v, axis] * pressure[owner[v]]
    for v in range(len(moved)):
        for axis in range(3):
            moved[v, axis] += push[v, axis] * ease[v, axis] / spacing[axis]
            farthest = max(farthest, abs(moved[v, axis]))
    return farthest


@kernel
def _coupling(point, owner, gradient, ease, labels):  # type: ignore[no-untyped-def]
    """Return how the pressure of each label changes its volume, and the same of pairs of labels that share points.

    The pairs are rows, columns and values of half of a matrix, with as many entries as there are shared points.
    """
    last, before = np.full(len(ease), -1, dtype=np.int32), np.empty(len(point), dtype=np.int32)
    pairs = 0
    for v in range(len(point)):
        before[v], last[point[v]] = last[point[v]], v
        w = before[v]
        while w >= 0:
            pairs += owner[w] != owner[v]
            w = before[w]
    diagonal, k = np.zeros(labels + 1), 0
    rows, columns, values = np.empty(pairs, np.int32), np.empty(pairs, np.int32), np.empty(pairs)
    for v in range(len(point)):
        w, free = v, row_of(ease, point[v])
        push = (gradient[v, 0] * free[0], gradient[v, 1] * free[1], gradient[v, 2] * free[2])
        while w >= 0:
            value = dot(push, row_of(gradient, w))
            if owner[w] == owner[v]:
                diagonal[owner[v]] += value if w == v else 2.0 * value
            else:
                rows[k], columns[k], values[k] = owner[v], owner[w], value
                k += 1
            w = before[w]
    return diagonal, rows, columns, values


@kernel
def _crossing_points(net, crossed, moved):  # type: ignore[no-untyped-def]
    """Return which points belong to triangles that cross others.

    A quadrangle lies within the boxes of its points. Those of two quadrangles overlap in common points only, so that
    triangles that cross have a point in common.
    """
    points = len(net.at)
    wrong, first = np.zeros(points, dtype=np.bool_), np.zeros(points + 2, dtype=np.int64)
    for q in range(len(net.quad)):
        for p in range(4):
            first[net.quad[q, p] + 2] += 1
    for v in range(points):
        first[v + 2] += first[v + 1]
    around = np.empty(first[points + 1], dtype=np.int64)
    # at most twelve faces meet in a corner of voxels
    triangles, corner, normals = np.empty((12, 2, 3, 3)), np.empty((4, 3)), np.empty((len(net.quad), 2, 3))
    for q in range(len(net.quad)):
        for p in range(4):
            v = net.quad[q, p]
            around[first[v + 1]] = 4 * q + p
            first[v + 1] += 1
        one, two = (net.axis[q] + 1) % 3, (net.axis[q] + 2) % 3
        for p in range(4):
            corner[p, 0], corner[p, 1], corner[p, 2] = row_of(moved, net.quad[q, p])
            corner[p, one] += 1.0 if p == 1 or p == 2 else 0.0
            corner[p, two] += 1.0 if p > 1 else 0.0
        first_corner = int(crossed[q])
        o, along = row_of(corner, first_corner), row_of(corner, first_corner + 2)
        normals[q, 0] = cross(sub(row_of(corner, first_corner + 1), o), sub(along, o))
        normals[q, 1] = cross(sub(along, o), sub(row_of(corner, (first_corner + 3) % 4), o))
    for v in range(points):
        here = around[first[v] : first[v + 1]]
        if net.special[v] < 0 and _are_graphs(net.side, normals, here):
            continue
        for m in range(len(here)):
            _place(net, crossed, moved, here[m], triangles[m])
        for m in range(len(here)):
            for n in range(m):
                q, r = here[m] >> 2, here[n] >> 2
                for s in range(4):
                    one, two = s >> 1, s & 1
                    if _common(net.quad, q, crossed[q], one, r, crossed[r], two) > 1:
                        continue
                    if is_crossing(triangles[m, one], triangles[n, two], DEPTH):
                        for p in range(4):
                            wrong[net.quad[q, p]] = wrong[net.quad[r, p]] = True
    return wrong


@bare_kernel
def _are_graphs(side, normals, here):  # type: ignore[no-untyped-def]
    """Return whether all triangles around a point, seen from each label there, face to the side of their mean normal.

    Of at most three labels any two triangles bound a common one, so that none of them cross.
    """
    one, two, three = side[here[0] >> 2, 0], side[here[0] >> 2, 1], side[here[0] >> 2, 0]
    for m in here:
        for s in range(2):
            label = side[m >> 2, s]
            if label not in (one, two, three):
                if three != one:
                    return False
                three = label
    for which in range(1 if three == one else 3):
        # seen from the other one of two labels, all normals are reversed
        label, mean = (one, two, three)[which], (0.0, 0.0, 0.0)
        for again in range(2):
            for m in here:
                if side[m >> 2, 0] != label and side[m >> 2, 1] != label:
                    continue
                sign = 1.0 if side[m >> 2, 0] == label else -1.0
                for s in range(2):
                    normal = times(corner_of(normals, m >> 2, s), sign)
                    if again and dot(normal, mean) <= 0.0:
                        return False
                    if not again:
                        mean = add(mean, normal)
    return True


@bare_kernel
def _corner(crossed, s, c):  # type: ignore[no-untyped-def]
    """Return which point of a quadrangle is corner c of its triangle s."""
    return (crossed + c + s * (c > 0)) % 4


@bare_kernel
def _place(net, crossed, moved, here, triangles):  # type: ignore[no-untyped-def]
    """Write the two triangles of a quadrangle, seen from one of its points: `here` is 4 q + p for point p."""
    q, p = here >> 2, here & 3
    one, two = (net.axis[q] + 1) % 3, (net.axis[q] + 2) % 3
    for s in range(2):
        for c in range(3):
            d = _corner(crossed[q], s, c)
            for a in range(3):
                triangles[s, c, a] = moved[net.quad[q, d], a]
            triangles[s, c, one] += (0, 1, 1, 0)[d] - (0, 1, 1, 0)[p]
            triangles[s, c, two] += (0, 0, 1, 1)[d] - (0, 0, 1, 1)[p]


@bare_kernel
def _common(quad, q, crossed, s, r, other, t):  # type: ignore[no-untyped-def]
    """Return how many points triangle s of quadrangle q and triangle t of quadrangle r share."""
    count = 0
    for c in range(3):
        for d in range(3):
            count += quad[q, _corner(crossed, s, c)] == quad[r, _corner(other, t, d)]
    return count


@kernel
def _smoothed(near, triple, held, factors, box):  # type: ignore[no-untyped-def]
    """Return the displacements after steps towards the mean of the neighbours, each by one of the factors.

    A point on a line where three labels meet, which has two or more of its edges, follows its neighbours on them only.
    """
    n = len(near)
    # what is no neighbour is row n, which stays 0; way: the sum of the steps to the neighbours
    use, share, way = near.copy(), np.empty(n, dtype=np.float32), np.zeros((n, 3), dtype=np.float32)
    free = np.empty((n, 3), dtype=np.float32)
    for v in range(n):
        line, count = triple[v] & (triple[v] - 1) != 0, 0
        for half in range(6):
            if near[v, half] < 0 or (line and not triple[v] >> half & 1):
                use[v, half] = n
            else:
                count += 1
                way[v, half >> 1] += 2 * (half & 1) - 1
        share[v] = 1 / max(count, 1)
        for axis in range(3):
            free[v, axis] = not held[v, axis]
    now, new = np.zeros((n + 1, 3), dtype=np.float32), np.zeros((n + 1, 3), dtype=np.float32)
    for factor in factors:
        for v in range(n):
            a, b, c, d, e, f = use[v, 0], use[v, 1], use[v, 2], use[v, 3], use[v, 4], use[v, 5]
            for axis in range(3):
                total = (now[a, axis] + now[b, axis]) + (now[c, axis] + now[d, axis]) + (now[e, axis] + now[f, axis])
                step = factor * ((total + way[v, axis]) * share[v] - now[v, axis])
                new[v, axis] = min(max(now[v, axis] + step, -box), box) * free[v, axis]
        now, new = new, now
    return now[:n]


@kernel
def _is_second_shorter(quad, axis, moved, spacing):  # type: ignore[no-untyped-def]
    """Return whether the diagonal from point 1 to 3 of each quadrangle is shorter than that from 0 to 2."""
    shorter = np.empty(len(quad), dtype=np.bool_)
    for q in range(len(quad)):
        first = second = 0.0
        for a in range(3):
            one = spacing[a] if a == (axis[q] + 1) % 3 else 0.0
            two = spacing[a] if a == (axis[q] + 2) % 3 else 0.0
            first += (moved[quad[q, 2], a] - moved[quad[q, 0], a] + one + two) ** 2
            second += (moved[quad[q, 3], a] - moved[quad[q, 1], a] - one + two) ** 2
        shorter[q] = second < first
    return shorter


@kernel
def _volumes(triangles, first_triangle, point, first_vertex, at, moved, spacing, turn, shape):  # type: ignore[no-untyped-def]
    """Return the volumes of the labels, their gradients by the vertices, and the area around each point of the net."""
    labels = len(turn) - 1
    volume, gradient, weight = np.zeros(labels + 1), np.zeros((len(point), 3)), np.full(len(at), 1e-30)
    most = 1
    for label in range(1, labels + 1):
        most = max(most, first_vertex[label + 1] - first_vertex[label])
    x = np.empty((most, 3))
    for label in range(1, labels + 1):
        v = first_vertex[label]
        for w in range(first_vertex[label + 1] - v):
            for a in range(3):
                # from a point of the label, which keeps the digits
                c, o = at[point[v + w], a], at[point[v], a]
                turned = shape[a] * (int(c < turn[label, a]) - int(o < turn[label, a]))
                x[w, a] = (c - o + turned + moved[point[v + w], a]) * spacing[a]
        for t in range(first_triangle[label], first_triangle[label + 1]):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            o = row_of(x, i)
            g = cross(sub(row_of(x, j), o), sub(row_of(x, k), o))
            volume[label] += dot(o, g) / 6
            area = math.sqrt(dot(g, g)) / 6
            for w in (i, j, k):
                for a in range(3):
                    gradient[v + w, a] += g[a] / 6
                weight[point[v + w]] += area
    return volume, gradient, weight
