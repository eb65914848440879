"""The one broad phase: pairs of grains whose bounding spheres are near, periodic images included."""

from dataclasses import dataclass

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.cells import near_pairs
from voxgran.contacts.assembly import Assembly


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of grains that may touch.

    Attributes
    ----------
    i, j : (m,) ndarray of int
        Grains in lexical order, i <= j; i == j stands for a grain and its own image.
    image : (m, 3) ndarray of int
        The partner is grain j shifted by `image` times the lengths of the container.
    offset : (m, 3) ndarray of float
        From the centroid of grain i to that of its partner.
    """

    i: Integers
    j: Integers
    image: Integers
    offset: Floats

    @property
    def count(self) -> int:
        """Number of pairs."""
        return len(self.i)

    def where(self, mask: Booleans | Integers) -> "Pairs":
        """Return some of the pairs, by a mask or by their numbers."""
        return Pairs(self.i[mask], self.j[mask], self.image[mask], self.offset[mask])


def grain_pairs(assembly: Assembly, gap: float) -> Pairs:
    """Find the pairs of grains whose bounding spheres are within a gap, each once per periodic image.

    Parameters
    ----------
    assembly : Assembly
        The grains.
    gap : float
        Largest distance of the bounding spheres, in the unit of lengths; negative: they overlap by so much.

    Returns
    -------
    Pairs
    """
    lower, upper = assembly.container.bounds
    lengths = upper - lower
    # where rounding decides, a pair is kept: the exact test comes later
    radii = assembly.bounding_radii * (1 + 1e-14)
    i, j, image = near_pairs(
        assembly.position,
        radii,
        gap,
        lower=lower,
        lengths=lengths,
        periodic=assembly.container.periodic,
    )
    offset = assembly.position[j] - assembly.position[i] + image * lengths
    return Pairs(i, j, image, offset)
