"""How alike two samples of grains are: distances of shapes, the energy distance, and a test by nearest neighbours."""

from collections.abc import Sequence
from itertools import permutations, product

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats
from voxgran._base.lazy import load
from voxgran.geometry.tree import grow_tree
from voxgran.shapes.describing.curvature import Bends, bends_of_mesh, mean_of_corners
from voxgran.shapes.describing.ratios import DESCRIPTORS, Form, corners_of_hull
from voxgran.shapes.learning.warp import frame_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape

#: distance of signatures up to which one grain is a copy of another: rounding gives less than 1e-6
COPY = 1e-4
#: points along each axis of the grid of signed distances, half of its length in radii, and the largest distance
FINE, HALF, FAR = 8, 1.4, 0.3
#: descriptors that are compared
COMPARED = ("sphericity", "elongation", "flatness", "convexity", "roundness")
#: descriptors that are found at once, by which strengths are chosen and donors balanced
QUICK = ("sphericity", "second_ratio", "third_ratio", "convexity", "roundness", "farthest_corner", "largest_distance")
#: share of grains that may lack a descriptor which is compared
LACKING = 0.1
#: least standard deviation by which a descriptor is divided, so that rounding is no difference
LEAST_SPREAD = 0.02
#: permutations of the test by nearest neighbours
PERMUTED = 999


def signature(mesh: Mesh) -> Floats:
    """Return signed distances from a grain at the points of a grid in the frame in which its second moments are those
    of the unit sphere, then the logarithms of its principal lengths in equivalent radii.
    """
    radius, center, roots, axes = frame_of(mesh)
    ticks = (np.arange(FINE) + 0.5) * (2 * HALF / FINE) - HALF
    grid = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    points = linear.matmul(mesh.vertices - center, axes) / (np.sqrt(5) * roots)
    faces = mesh.corners[:, ::-1] if linear.determinant(axes) < 0 else mesh.corners
    distance = grow_tree(points, faces.astype(np.int64)).signed_distance(grid)
    return np.concatenate([np.clip(distance, -FAR, FAR), libm.log(np.sqrt(5) * roots / radius)])


def signatures(shapes: Sequence[Shape]) -> Floats:
    """Return the signatures (n, k) of grains that are meshes."""
    return np.array([signature(shape.geometry) for shape in shapes])  # type: ignore[arg-type]


def distances(one: Floats, two: Floats) -> Floats:
    """Return the distances (n, m) of signatures, least over the 48 symmetries of a cube: turned and mirrored copies of
    a grain have the distance 0.
    """
    number = FINE**3
    index = np.arange(number).reshape(FINE, FINE, FINE)
    field, own = one[:, :number], one[:, number:]
    least = np.full((len(one), len(two)), np.inf)
    for order in permutations(range(3)):
        lengths = ((own[:, None] - two[:, number:][:, order]) ** 2).mean(axis=2)
        for sides in product((1, -1), repeat=3):
            turned = two[:, index.transpose(order)[:: sides[0], :: sides[1], :: sides[2]].ravel()]
            squares = (field**2).sum(axis=1)[:, None] + (turned**2).sum(axis=1) - linear.matmul(2 * field, turned.T)
            least = np.minimum(least, np.maximum(squares, 0.0) / number + lengths)
    return np.asarray(np.sqrt(least))


def spacing(given: Floats) -> float:
    """Return the median distance of signatures to the nearest other one of the same grains; copies of a grain, of which
    a packing of few shapes has many, are not others.
    """
    far = distances(given, given)
    far[far < COPY] = np.inf
    return float(np.median(far.min(axis=1)))


def descriptors(shapes: Sequence[Shape]) -> Floats:
    """Return the descriptors (n, 5) that are compared, NaN for a roundness that a coarse mesh does not have."""
    rows = [[DESCRIPTORS[name].compute(form) for name in COMPARED] for form in map(Form, shapes)]
    return np.array(rows, dtype=np.float64).reshape(-1, len(COMPARED))


def comparable(*groups: Floats) -> tuple[list[Floats], Booleans]:
    """Return groups of descriptors (n, k) without those that more than a few grains of one of them lack, and which (k,)
    are kept; where a few lack one, they have the median of all.
    """
    kept = np.all([np.isnan(rows).mean(axis=0) <= LACKING for rows in groups], axis=0)
    middle = np.nanmedian(np.concatenate(groups)[:, kept], axis=0)
    return [np.where(np.isnan(rows[:, kept]), middle, rows[:, kept]) for rows in groups], kept


def quick_descriptors(shapes: Sequence[Shape], *, bars: bool = False) -> Floats:
    """Return the descriptors QUICK of meshes (n, 7), which take thousandths of a second a grain.

    The ratios are those of the second moments, and the roundness is relative to the shortest axis of the ellipsoid that
    has them: the smallest box and the largest sphere inside take ten times as long. The farthest corner from the
    centroid and the largest distance of two corners are in equivalent diameters. With `bars` the roundness
    is relative to the radius of a bar of the same volume and surface, without sharp edges such as those of cut ends:
    bars, straight or in rings, have 1 if they are round, and less the more oval they are.
    """
    rows = []
    for shape in shapes:
        assert isinstance(shape.geometry, Mesh)
        form, roots = Form(shape), frame_of(shape.geometry)[2]
        ratios = [roots[1] / roots[0], roots[2] / roots[1]]
        inside = 2 * shape.volume / shape.surface_area if bars else float(np.sqrt(5) * roots[2])
        bends = bends_of_mesh(shape.vertices, shape.faces)
        if bars:
            bends = Bends(*(part[np.isfinite(bends.curvature)] for part in bends))
        round_ = mean_of_corners(bends, inside)
        corners = corners_of_hull(shape.vertices)
        lengths = [shape.bounding_radius, load("scipy.spatial.distance").pdist(corners).max()]
        known = [DESCRIPTORS["sphericity"].compute(form), *ratios, DESCRIPTORS["convexity"].compute(form), round_]
        rows.append([*known, *(float(length) / shape.diameter for length in lengths)])
    return np.array(rows)


def energy_distance(
    one: Floats, two: Floats, spread: Floats, weights: Floats | None = None, others: Floats | None = None
) -> float:
    """Return the energy distance of samples (n, k) and (m, k), columns divided by a spread (k,), with the weights (n,)
    of the first and those (m,) of the second.

    References
    ----------
    .. [1] Szekely & Rizzo 2013, doi:10.1016/j.jspi.2013.03.018
    """
    w = np.full(len(one), 1 / len(one)) if weights is None else weights / weights.sum()
    v = np.full(len(two), 1 / len(two)) if others is None else others / others.sum()

    def mean(a: Floats, b: Floats, p: Floats, q: Floats) -> float:
        return float(linear.matmul(linear.matmul(p, np.sqrt((((a[:, None] - b) / spread) ** 2).sum(axis=2))), q))

    return 2 * mean(one, two, w, v) - mean(one, one, w, w) - mean(two, two, v, v)


def spread_of(rows: Floats) -> Floats:
    """Return the standard deviations of descriptors (n, k), not below the least one."""
    return np.asarray(np.maximum(rows.std(axis=0), LEAST_SPREAD))


def nearest_neighbour_test(one: Floats, two: Floats, generator: np.random.Generator) -> tuple[float, float]:
    """Return the share of grains whose nearest neighbour is of their own sample, and the p-value by permutations.

    Both samples of signatures, (n, k) and (n, k), are of one size, so that the share of samples that are alike is 1/2
    or a little less; the p-value is that of a larger share.

    References
    ----------
    .. [1] Henze 1988, doi:10.1214/aos/1176350835
    """
    every = np.concatenate([one, two])
    far = distances(every, every)
    np.fill_diagonal(far, np.inf)
    nearest, group = far.argmin(axis=1), np.repeat([0, 1], [len(one), len(two)])
    share = float((group[nearest] == group).mean())
    mixed = [generator.permutation(group) for _ in range(PERMUTED)]
    above = sum(float((labels[nearest] == labels).mean()) >= share for labels in mixed)
    return share, (above + 1) / (PERMUTED + 1)
