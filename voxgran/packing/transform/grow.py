"""Growth of the grains of a packing about their centroids until each touches a neighbour or a wall.

Shapes inscribed in the spheres of a sphere packing touch at corners at most. Here all grains grow at once. How far two
grains may grow follows from their true gap and from the speed at which it closes at their nearest points. Gaps of
convex grains close ever more slowly, so that these grains never overlap. Other grains that overlap are reset and then
grown at the rate of their bounding sphere, an upper bound for every surface point. Grains that touch stop growing.
"""

from dataclasses import replace

import numpy as np

from voxgran._base.arrays import Booleans, Floats, as_number
from voxgran._base.calls import explained
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.broad import grain_pairs
from voxgran.contacts.find import gaps_of_pairs
from voxgran.contacts.walls import escape_depths, grain_bounds
from voxgran.containers.model import boundary_of
from voxgran.packing.model import Packing, check_packing
from voxgran.shapes.sizes import size_distance

#: largest gap of grains that touch, and gap that is kept between them, in mean diameters
TOUCH, CLEAR = 1e-8, 1e-10
#: search distance of neighbours, in mean diameters, and largest number of rounds
REACH, ROUNDS = 0.2, 400
#: lower bound of the speed of a surface, in bounding radii
SLOW = 0.05


@explained(hint="grow(packing)")
def grow(packing: Packing, *, max_factor: float = 2.0) -> Packing:
    """Grow the grains of a packing about their centroids until each touches a neighbour or a wall.

    Parameters
    ----------
    packing : Packing
        Grains that do not overlap, such as shapes in the spheres of an advancing front.
    max_factor : float
        Largest factor on the size of a grain, at least 1.

    Returns
    -------
    Packing
        The same grains at the same positions, enlarged; ``provenance["growth"]`` has the solid fraction before and
        after, the mean and the largest factor, the share of the grains that touch, and the Kolmogorov-Smirnov distance
        of the sizes before and after.

    Raises
    ------
    InputError
        If the packing is of another type or has fixed grains, or the factor is below 1 or not finite.

    Notes
    -----
    In each round a grain grows by the least factor that its neighbours and walls permit; two growing grains share their
    gap by the same factor. The result is deterministic. Grains touch when their gap is at most 1e-8 mean diameters;
    none overlaps. Grains that overlap before do not grow.

    Examples
    --------
    >>> import voxgran as vg
    >>> dice = vg.make_shape("box", lengths=(1, 1, 1))
    >>> pair = vg.Packing.of([dice], vg.Box((4, 4, 4)), position=[(1, 2, 2), (2.5, 2, 2)])
    >>> vg.grow(pair).scale.round(6).tolist()
    [1.5, 1.5]
    """
    check_packing(packing, "packing")
    packing.refuse_fixed("growth")
    limit = as_number(max_factor, "max_factor", at_least=1.0)
    factor, touches = _factors(packing, limit)
    grown = replace(packing, scale=packing.scale * factor, forces=None)
    report = {
        "max_factor": limit,
        "solid_fraction_before": packing.solid_fraction,
        "solid_fraction": grown.solid_fraction,
        "mean_factor": float(factor.mean()) if packing.count else 1.0,
        "largest_factor": float(factor.max(initial=1.0)),
        "touching": float(touches.mean()) if packing.count else 0.0,
        "gradation_distance": size_distance(packing.diameters, grown.diameters),
    }
    return replace(grown, provenance={**packing.provenance, "growth": report})


def _factors(packing: Packing, most: float) -> tuple[Floats, Booleans]:
    """Return by which factor each grain grows, and which then touch."""
    n, before = packing.count, packing.scale
    factor, step = np.ones(n), np.zeros(n)
    touches, wary = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    mean = float(packing.diameters.mean()) if n else 1.0
    for _ in range(ROUNDS):
        grains = replace(packing, scale=before * factor)
        room, near, wrong = _room(grains, ~touches & (factor < most), wary, REACH * mean, CLEAR * mean)
        back = wrong & (step > 0.0)
        if back.any():
            # they had grown too far: from where they were they grow as fast as no surface can
            factor[back] /= 1.0 + step[back]
            wary |= back
            step = np.zeros(n)
            continue
        touches |= near <= TOUCH * mean
        step = np.where(touches, 0.0, np.clip(room, 0.0, most / factor - 1.0))
        if not (step > 0.0).any():
            break
        factor *= 1.0 + step
    return factor, touches


def _room(
    grains: Packing, grows: Booleans, wary: Booleans, reach: float, clear: float
) -> tuple[Floats, Floats, Booleans]:
    """Return by which share each grain may grow, how far the nearest neighbour or wall is, and which overlap."""
    radius = grains.bounding_radii
    pairs = grain_pairs(grains, reach)
    pairs = pairs.where(grows[pairs.i] | grows[pairs.j])
    gap, normal, point = gaps_of_pairs(grains, pairs, reach, deepest=False)
    seen = gap <= reach
    i, j, gap, normal, point = pairs.i[seen], pairs.j[seen], gap[seen], normal[seen], point[seen]
    middle = (point * normal).sum(axis=1)
    fast_i = _speed(middle - 0.5 * gap, radius[i], wary[i])
    fast_j = _speed((pairs.offset[seen] * normal).sum(axis=1) - middle - 0.5 * gap, radius[j], wary[j])
    share = (gap - clear) / (grows[i] * fast_i + grows[j] * fast_j)
    walls, near = _room_at_walls(grains, reach, clear)
    room, wrong = np.minimum(walls, 0.5 * reach / radius), near < 0.0
    for grain in (i, j):
        np.minimum.at(room, grain, share)
        np.minimum.at(near, grain, gap)
        wrong[grain[gap < 0.0]] = True
    return room, near, wrong


def _speed(along: Floats, radius: Floats, wary: Booleans) -> Floats:
    """Return the speed at which a surface approaches per relative growth of the grain."""
    return np.where(wary, radius, np.clip(along, SLOW * radius, radius))


def _room_at_walls(grains: Assembly, reach: float, clear: float) -> tuple[Floats, Floats]:
    """Return the relative growth of each grain up to contact with a wall, and the gap to the nearest wall."""
    container, radius = grains.container, grains.bounding_radii
    room, gap = np.full(grains.count, np.inf), np.full(grains.count, np.inf)
    if boundary_of(container).is_flat:
        (lower, upper), (low, high) = container.bounds, grain_bounds(grains)
        for axis in range(grains.dimension):
            if not container.periodic[axis]:
                x = grains.position[:, axis]
                for space, extent in ((x - lower[axis], -low[:, axis]), (upper[axis] - x, high[:, axis])):
                    # a flat sheet through the center does not approach the wall as it grows
                    nears = extent > 0.0
                    share = np.divide(space - clear, extent, out=np.full(grains.count, np.inf), where=nears)
                    room = np.minimum(room, share - 1.0)
                    gap = np.minimum(gap, space - extent)
        return room, gap
    near = np.flatnonzero(-container.signed_distance(grains.position) - radius <= reach)
    some = Assembly(
        grains.shapes,
        grains.shape_id[near],
        grains.scale[near],
        grains.position[near],
        grains.orientation[near],
        container,
    )
    gap[near] = -escape_depths(some)
    room[near] = (gap[near] - clear) / radius[near]
    return room, gap
