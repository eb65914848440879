"""Verify: does a packing hold what a packing promises, by the true geometry of its grains?

It knows nothing of the method that made the packing: it looks at the poses, the shapes and the container only, finds
every pair of grains that overlap (periodic images included) and every grain that reaches beyond a wall, and how far.
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import as_number, check_type
from voxgran.contacts.assembly import Assembly, checked_arrays
from voxgran.contacts.broad import grain_pairs
from voxgran.contacts.find import contacts_of_pairs
from voxgran.contacts.walls import escape_depths

#: how many of the worst pairs and escapes are listed
LISTED = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Overlap:
    """Two grains that overlap.

    Attributes
    ----------
    i, j : int
        The grains, i <= j; i == j stands for a grain and its own image.
    image : tuple of int
        The partner is grain j shifted by `image` times the lengths of the container.
    depth : float
        Largest distance to the surface of one of any point of the other inside it, in mean diameters; of two open
        surfaces that cross, the shortest straight move found that parts them, an upper bound of the least one.
    """

    i: int
    j: int
    image: tuple[int, int, int]
    depth: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Escape:
    """A grain that reaches beyond a wall.

    Attributes
    ----------
    grain : int
        Which grain.
    depth : float
        How far it reaches beyond the wall, in mean diameters.
    """

    grain: int
    depth: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """What was found; lengths are in mean equivalent diameters of the grains.

    Attributes
    ----------
    ok : bool
        Whether no pair overlaps and no grain escapes beyond the tolerance.
    overlapping_pairs : int
        How many pairs overlap deeper than the tolerance; each periodic image counts.
    deepest : float
        Depth of the deepest of them; 0 where there are none.
    escaped : int
        How many grains reach beyond a wall by more than the tolerance.
    largest_escape : float
        How far the worst of them does; 0 where there are none.
    pairs : tuple of Overlap
        The deepest pairs, at most 20, the worst first.
    escapes : tuple of Escape
        The grains that reach farthest beyond a wall, at most 20, the worst first.
    tolerance : float
        Depths up to here do not count.
    count : int
        Number of grains.
    pair_tests : int
        How many pairs were near enough for an exact test.
    mean_diameter : float
        The unit of all depths, in the unit of lengths.
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

    def summary(self) -> str:
        """Return the findings as a few lines of text."""
        head = f"{self.count} grains, {self.pair_tests} pairs tested, tolerance {self.tolerance:g} mean diameters"
        if self.ok:
            return f"ok: no overlap, no escape ({head})"
        pairs = f"{self.overlapping_pairs} overlapping pairs (deepest {self.deepest:.3g})"
        lines = [f"not ok: {pairs}, {self.escaped} escaped grains (farthest {self.largest_escape:.3g}) ({head})"]
        for pair in self.pairs:
            image = f" (image {pair.image})" if any(pair.image) else ""
            lines.append(f"  grains {pair.i} and {pair.j}{image}: {pair.depth:.3g} deep")
        lines += [f"  grain {item.grain}: {item.depth:.3g} beyond a wall" for item in self.escapes]
        return "\n".join(lines)

    __str__ = summary


def verify(packing: Assembly, *, tolerance: float = 1e-9) -> Verification:
    """Check a packing against the true geometry of its grains.

    Parameters
    ----------
    packing : Packing or Assembly
        The grains.
    tolerance : float
        Depths and escapes up to here do not count, in mean equivalent diameters.

    Returns
    -------
    Verification
        The same measures, in the same unit, whatever made the packing.

    Raises
    ------
    InputError
        If a position, scale or orientation is not finite or out of range, or the tolerance is negative.

    Notes
    -----
    Meshes are compared by manifold3d in double precision wherever they are not proven to be apart; all other
    geometries are compared in closed form or by their support functions. Nothing is tessellated. Open surfaces overlap
    where their triangles cross, by the shortest straight move found that parts them, which hardly depends on how they
    are cut into triangles and is an upper bound of the least one; and solids where they reach inside.
    """
    check_type(packing, Assembly, "packing", "a Packing; load or pack one")
    limit = as_number(tolerance, "tolerance", at_least=0.0)
    checked_arrays(
        *(packing.shapes, packing.container, packing.position),
        *(packing.scale, packing.shape_id, packing.orientation),
    )
    mean = float(packing.diameters.mean()) if packing.count else 1.0
    near = grain_pairs(packing, -limit * mean)
    contacts = contacts_of_pairs(packing, near, -limit * mean)
    depth = -contacts.gap / mean
    bad = depth > limit
    escape = escape_depths(packing) / mean
    out = np.flatnonzero(escape > limit)
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
    )
