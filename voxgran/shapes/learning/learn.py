"""`learn_shapes`: the distribution of shapes and sizes of a sample of grains."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, as_choice, as_number
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.shapes.learning.files import METHODS
from voxgran.shapes.learning.likeness import (
    LEAST_SPREAD,
    QUICK,
    distances,
    energy_distance,
    quick_descriptors,
    signatures,
    spacing,
    spread_of,
)
from voxgran.shapes.learning.model import ShapeModel
from voxgran.shapes.learning.sample import checked_sample
from voxgran.shapes.learning.warp import WIDE
from voxgran.shapes.model import Shape

#: strengths that are tried, that of small samples, and the number of grains that is not small
STRENGTHS, SMALL, LARGE = (0.005, 0.01, 0.02, 0.03, 0.04, 0.05, 0.065, 0.08, 0.12), 0.05, 40
#: difference of descriptors up to which grains are one shape, turned, mirrored or scaled: rounding gives 1e-14, after
#: a reduction of triangles 2e-8
SAME = 1e-6
#: grains that are drawn to find the mean change of descriptors, and what holds the weights of donors near the others
BALANCED, RIDGE, STEEPEST = 100, 0.02, 1.0
#: novelty that is enough, growth of the error in that of random halves of the sample that is too much, and pairs of
#: such halves
ENOUGH, WORSE, FOLDS = 0.95, 0.25, 10
#: halvings of the last step where the error is what ends the search
FINER = 2
#: column of the roundness
ROUNDNESS = QUICK.index("roundness")
#: grains that are drawn to see whether bars stay round, and standard deviations by which they may not become oval
FEW, OVAL = 40, 1.0


@explained(hint="learn_shapes(shapes)")
def learn_shapes(
    shapes: Sequence[Shape] | Any,
    sizes: "ArrayLike | None" = None,
    *,
    method: str | None = None,
    strength: float | None = None,
    weights: "ArrayLike | None" = None,
    seed: int = 0,
) -> ShapeModel:
    """Learn the distribution of shapes and sizes of a sample of grains, such as those of a scan.

    A grain that is drawn is made of one grain of the sample, its donor, mirrored at random, and of a size that a kernel
    density of the sample gives. By "warp" it is mapped by a small shear and taper, by which planes stay planes and
    convex solids convex, and stretched to principal ratios that the kernel density gives too. By "bend" it is bent so
    that it is strained, and its surface is curved, as little as possible: bars stay as round as they are, which a
    stretch makes oval, and less where its surface would cross itself. So texture, edges and holes stay those of real
    grains, and shape and size as correlated as they are.

    Parameters
    ----------
    shapes : sequence of Shape or Packing
        At least 10 solids, of any topology; 40 or more are better. Their true sizes count. Of a packing of labels the
        grains that the border of the image cuts are left out, and the others have weights by which large grains, cut
        more often, are as frequent as they are.
    sizes : (n,) array_like of float, optional
        Equivalent diameters in place of those of the shapes.
    method : {"warp", "bend"}, optional
        How grains are made. Default: "warp", or "bend" where grains are of round bars, which "warp" would make oval.
    strength : float, optional
        Standard deviation of the shears and of the taper, or root mean square of the displacement by bending, in
        equivalent diameters; at most 0.3. The kernel density is narrower in proportion below 0.02, and wider above
        0.08. Default: chosen between 0.005 and 0.12, so that drawn grains are new and the
        descriptors are those of the sample; 0.05 where there are fewer than 40 grains.
    weights : (n,) array_like of float, optional
        How often each grain is the donor, relative to the others; default: equally often, and of a packing of labels as
        said above.
    seed : int
        Seed of the grains that are drawn to choose the method and the strength, and to balance the donors.

    Returns
    -------
    ShapeModel
        Its `sample` draws grains, `report` compares them with others, `save` writes it.

    Raises
    ------
    InputError
        If there are fewer than 10 whole grains, all are one shape but for size, rotation and mirroring, one is open or
        plane, their units differ, or a number is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> scanned = [vg.make_shape("solid_union", seed=k, diameter=1 + k / 20) for k in range(12)]
    >>> model = vg.learn_shapes(scanned)
    >>> model
    ShapeModel('warp', grains=12, strength=0.05)
    >>> len(model.sample(30, seed=1))
    30
    """
    if method is not None:
        as_choice(method, "method", METHODS)
    sample = checked_sample(shapes, sizes, weights)
    strength = None if strength is None else as_number(strength, "strength", at_least=0.0, at_most=0.3)
    start = SMALL if strength is None else strength
    w = sample.weights
    even = ShapeModel(shapes=tuple(sample.shapes), weights=w, donors=w, strength=start, method=method or METHODS[0])
    rows = quick_descriptors(even.shapes)
    if np.isclose(rows, rows[0], rtol=0.0, atol=SAME, equal_nan=True).all():
        raise InputError(
            f"shapes is {len(rows)} times one shape, of whatever size, turned or mirrored: there is no distribution; "
            "pack that shape itself with sizes="
        )
    if method is None:
        oval, bending = _made_oval(even, seed), replace(even, method=METHODS[1])
        if oval > OVAL and _made_oval(bending, seed) < oval / 2:
            even = bending
    rows = _described(even, even.shapes)
    if strength is None and len(rows) >= LARGE:
        even = replace(even, strength=_chosen(even, rows, seed))
    return replace(even, donors=_balancing(even, rows, seed)[0])


def _made_oval(even: ShapeModel, seed: int) -> float:
    """Return by how many standard deviations the roundness of bars falls, on the average over a few drawn grains."""
    drawn = even.sample(min(len(even.shapes), FEW), seed=seed)
    donors = [even.shapes[shape.record["donor"]] for shape in drawn]
    before, after = (quick_descriptors(grains, bars=True)[:, ROUNDNESS] for grains in (donors, drawn))
    return float((before - after).mean() / max(before.std(), LEAST_SPREAD))


def _described(even: ShapeModel, shapes: Sequence[Shape]) -> Floats:
    """Return the descriptors (n, k) by which a model is chosen; where grains bend, with the roundness of bars."""
    return quick_descriptors(shapes, bars=even.method == "bend")


def _balancing(even: ShapeModel, rows: Floats, seed: int) -> tuple[Floats, list[Shape], float]:
    """Return balanced weights of donors, the grains by which they were found, and how far these are from the sample
    with the descriptors (n, k) then.
    """
    drawn = even.sample(min(len(rows), BALANCED), seed=seed)
    made, donors = _described(even, drawn), np.array([shape.record["donor"] for shape in drawn])
    found = balanced(rows, even.weights, made, donors)
    again = found[donors] / even.weights[donors]
    return found, drawn, energy_distance(rows, made, spread_of(rows), even.weights, again)


def _chosen(even: ShapeModel, rows: Floats, seed: int) -> float:
    """Return the smallest strength, not below that of a narrower kernel, with which drawn grains are as far from the
    nearest one of the sample as those are from each other, or the largest one with which their descriptors are those of
    the sample.
    """
    generator, marks = stream(seed, "strength of learned grains"), signatures(even.shapes)
    # halves of as many grains as are drawn, since the error of a sample falls with its number of grains
    mixed = [np.array_split(generator.permutation(len(rows))[:BALANCED], 2) for _ in range(FOLDS)]
    w, spread = even.weights, spread_of(rows)
    own = np.mean([energy_distance(rows[a], rows[b], spread, w[a], w[b]) for a, b in mixed])
    enough = ENOUGH * spacing(marks)

    @cache
    def tried(strength: float) -> tuple[float, float]:
        _, drawn, error = _balancing(replace(even, strength=strength), rows, seed)
        return error, float(np.median(distances(signatures(drawn), marks).min(axis=1)))

    # fewer grains than the sample has differ from it anyway, as those of the least strength do
    worst = tried(STRENGTHS[0])[0] + WORSE * own

    def is_end(strength: float) -> bool:
        error, new = tried(strength)
        return bool(error > worst or new >= enough)

    # novelty and error both grow with the strength; the kernel is narrow only where a wide one errs
    end = min(bisect_left(STRENGTHS, True, lo=STRENGTHS.index(WIDE[0]), key=is_end), len(STRENGTHS) - 1)
    while tried(STRENGTHS[end])[0] > worst:
        end -= 1
    chosen, next_one = STRENGTHS[end], STRENGTHS[min(end + 1, len(STRENGTHS) - 1)]
    for _ in range(FINER):
        if tried(chosen)[1] >= enough:
            break
        middle = (chosen + next_one) / 2
        if tried(middle)[0] > worst:
            next_one = middle
        else:
            chosen = middle
    return chosen


def balanced(given: Floats, weights: Floats, drawn: Floats, donors: Integers) -> Floats:
    """Return weights (n,) of donors, of sum 1, with which the mean descriptors of drawn grains are those of the sample.

    Maps change descriptors on the average: whatever bulges becomes sharper. With the mean change between the rows
    (m, k) of drawn grains and those of their donors among the given ones (n, k), the weights are those nearest to the
    given ones by relative entropy which make up for it, as exponential functions of the rows. These are not steeper
    than one per standard deviation, so that no grain is the donor of most.

    References
    ----------
    .. [1] Jaynes 1957, doi:10.1103/PhysRev.106.620: weights of largest entropy with given means
    """
    changed = given + (drawn - given[donors]).mean(axis=0)
    rows = (changed - linear.matmul(weights, given)) / spread_of(given)

    def tilted(slope: Floats) -> Floats:
        made = weights * libm.exp(linear.matmul(rows, slope))
        return np.asarray(made / made.sum())

    def missed(slope: Floats) -> tuple[float, Floats]:
        level = libm.log((weights * libm.exp(linear.matmul(rows, slope))).sum()) + RIDGE / 2 * (slope**2).sum()
        return float(level), np.asarray(linear.matmul(tilted(slope), rows) + RIDGE * slope)

    bounds = [(-STEEPEST, STEEPEST)] * rows.shape[1]
    # of SciPy's methods with bounds the one that does without BLAS
    search: Any = load("scipy.optimize").minimize
    return tilted(search(missed, np.zeros(rows.shape[1]), jac=True, bounds=bounds, method="TNC", tol=1e-12).x)
