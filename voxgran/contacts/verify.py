"""Verification of a packing by the true geometry of its grains.

The check is independent of the packing method: it uses the poses, the shapes and the container only, and finds every
pair of overlapping grains (periodic images included) and every grain that protrudes from the container, with depths.
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, as_number, check_type
from voxgran._base.calls import explained
from voxgran._base.compiling.threads import using_threads
from voxgran._base.progress import OnStep, reported, silent
from voxgran.contacts.assembly import Assembly, checked_arrays
from voxgran.contacts.broad import grain_pairs
from voxgran.contacts.find import contacts_of_pairs
from voxgran.contacts.walls import escape_depths
from voxgran.containers.model import periods_of

#: number of the worst pairs and escapes that are listed
LISTED = 20
#: largest depth and protrusion that are ignored where no other is given, in mean diameters
TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Overlap:
    """Overlap of two grains.

    Attributes
    ----------
    i, j : int
        The grains, i <= j; i == j denotes a grain and its own periodic image.
    image : tuple of int
        The partner is grain j shifted by `image` times the periods of the container.
    depth : float
        Largest distance, to the surface of one grain, of a point of the other inside it, in mean diameters; for two
        crossing open surfaces, the shortest separating translation found, an upper bound of the minimum.
    """

    i: int
    j: int
    image: tuple[int, int, int]
    depth: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Escape:
    """Grain that protrudes beyond a wall.

    Attributes
    ----------
    grain : int
        Index of the grain.
    depth : float
        Distance that the grain protrudes beyond the wall, in mean diameters.
    """

    grain: int
    depth: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification(ExplainedAttributes):
    """Result of the verification; lengths are in mean equivalent diameters of the grains.

    Attributes
    ----------
    ok : bool
        Whether no pair overlaps and no grain escapes beyond the tolerance.
    overlapping_pairs : int
        Number of pairs that overlap deeper than the tolerance; each periodic image counts.
    deepest : float
        Largest depth of these pairs; 0 if there are none.
    escaped : int
        Number of grains that protrude beyond a wall by more than the tolerance.
    largest_escape : float
        Largest protrusion of these grains; 0 if there are none.
    pairs : tuple of Overlap
        The deepest pairs, at most 20, the worst first.
    escapes : tuple of Escape
        The grains that protrude farthest beyond a wall, at most 20, the worst first.
    tolerance : float
        Largest depth that is ignored.
    count : int
        Number of grains.
    pair_tests : int
        Number of pairs that were close enough for an exact test.
    mean_diameter : float
        Unit of all depths, in the unit of lengths.
    touching_at : float
        Factor on the sizes of all grains, in place, at which none of these pairs and grains overlap or protrude any
        more; 1 if there are none. It is exact for spheres, and an estimate from the depths for other grains.
    """

    ok: bool
    overlapping_pairs: int
    deepest: float
    escaped: int
    largest_escape: float
    pairs: tuple[Overlap, ...]
    escapes: tuple[Escape, ...]
    tolerance: float
    count: int
    pair_tests: int
    mean_diameter: float
    touching_at: float

    def summary(self) -> str:
        """Return the findings as a few lines of text."""
        head = f"{self.count} grains, {self.pair_tests} pairs tested, tolerance {self.tolerance:g} mean diameters"
        if self.ok:
            return f"ok: no overlap, no escape ({head})"
        pairs = f"{self.overlapping_pairs} overlapping pairs (deepest {self.deepest:.3g})"
        smaller = f"touching at 1 - {1.0 - self.touching_at:.2g}"
        farthest = f"(farthest {self.largest_escape:.3g})"
        lines = [f"not ok: {pairs}, {self.escaped} escaped grains {farthest}, {smaller} ({head})"]
        for pair in self.pairs:
            image = f" (image {pair.image})" if any(pair.image) else ""
            lines.append(f"  grains {pair.i} and {pair.j}{image}: {pair.depth:.3g} deep")
        lines += [f"  grain {item.grain}: {item.depth:.3g} beyond a wall" for item in self.escapes]
        return "\n".join(lines)

    __str__ = summary


@explained(hint="verify(packing, tolerance=1e-9)")
def verify(
    packing: Assembly, *, tolerance: float = TOLERANCE, threads: int | None = None, on_step: OnStep | None = None
) -> Verification:
    """Check a packing against the true geometry of its grains.

    Parameters
    ----------
    packing : Packing or Assembly
        The grains. Overlaps of two fixed grains, and fixed grains beyond walls, are left out.
    tolerance : float
        Largest depth and protrusion that are ignored, in mean equivalent diameters.
    threads : int, optional
        Number of threads, by default that of the processors or of ``OMP_NUM_THREADS``; the result is the same.
    on_step : callable, optional
        Told of each pair of surfaces that is compared; default: at a terminal and in a notebook, a line on the error
        stream every ten seconds.

    Returns
    -------
    Verification
        Overlaps and escapes.

    Raises
    ------
    InputError
        If a position, scale or orientation is not finite or out of range, the tolerance is negative, `threads` is no
        whole number above 0, or `on_step` is no function.

    Notes
    -----
    Meshes that are not proven to be separate are intersected by manifold3d in double precision; all other geometries
    are compared in closed form or by their support functions, without tessellation. Open surfaces overlap if their
    triangles cross; the depth is the shortest separating translation found, an upper bound of the minimum that is
    nearly independent of the triangulation. An open surface overlaps a solid if it has a point inside.

    Examples
    --------
    >>> import voxgran as vg
    >>> spheres = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 2, 2)), position=[(1, 1, 1), (1.95, 1, 1)])
    >>> found = vg.verify(spheres)
    >>> found.ok, found.overlapping_pairs, round(found.deepest, 3)
    (False, 1, 0.05)
    """
    check_type(packing, Assembly, "packing", "a Packing; load or pack one")
    limit, told = as_number(tolerance, "tolerance", at_least=0.0), reported(on_step) or silent
    checked_arrays(
        packing.shapes, packing.container, packing.position, packing.scale, packing.shape_id, packing.orientation
    )
    mean = float(packing.diameters.mean()) if packing.count else 1.0
    with using_threads(threads):
        near = grain_pairs(packing, -limit * mean)
        if packing.fixed is not None:
            near = near.where(~(packing.fixed[near.i] & packing.fixed[near.j]))
        contacts = contacts_of_pairs(packing, near, -limit * mean, on_step=told)
    depth = -contacts.gap / mean
    bad = depth > limit
    escape = np.where(packing.movable, escape_depths(packing) / mean, -np.inf)
    out = np.flatnonzero(escape > limit)
    deep = contacts.where(bad)
    offset = packing.position[deep.j] - packing.position[deep.i]
    offset += linear.matmul(deep.image, periods_of(packing.container))
    to_partner = linear.einsum("ki,ki->k", offset, deep.normal)
    to_wall = -packing.container.signed_distance(packing.position[out])
    worst = np.flatnonzero(bad)[np.argsort(-depth[bad], kind="stable")][:LISTED]
    farthest = out[np.argsort(-escape[out], kind="stable")][:LISTED]
    return Verification(
        ok=not bad.any() and not len(out),
        overlapping_pairs=int(bad.sum()),
        deepest=float(depth[bad].max(initial=0.0)),
        escaped=len(out),
        largest_escape=float(escape[out].max(initial=0.0)),
        pairs=tuple(
            Overlap(
                i=int(contacts.i[k]),
                j=int(contacts.j[k]),
                image=(int(contacts.image[k, 0]), int(contacts.image[k, 1]), int(contacts.image[k, 2])),
                depth=float(depth[k]),
            )
            for k in worst
        ),
        escapes=tuple(Escape(grain=int(grain), depth=float(escape[grain])) for grain in farthest),
        tolerance=limit,
        count=packing.count,
        pair_tests=near.count,
        mean_diameter=mean,
        touching_at=min(_factor(to_partner, -deep.gap), _factor(to_wall, mean * escape[out])),
    )


def _factor(reach: Floats, depth: Floats) -> float:
    """Return the factor on the sizes of grains at which none has a depth, by their distances to partners or walls."""
    inward = np.maximum(reach, 0.0)
    return float((inward / (inward + depth)).min(initial=1.0))
