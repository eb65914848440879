"""Removal of grains at random, for samples that are looser than a method gives."""

from dataclasses import replace

import numpy as np

from voxgran._base.arrays import Integers, as_number
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, PackingWarning, warn
from voxgran._base.seeds import stream
from voxgran.packing.model import Packing, check_packing
from voxgran.shapes.sizes import size_distance

#: step of ranks, which spreads any number of them evenly: the golden section
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@explained(hint="remove_grains(packing, solid_fraction=0.4)")
def remove_grains(packing: Packing, *, solid_fraction: float, seed: int = 0) -> Packing:
    """Remove grains at random until a packing has a lower solid fraction, with the same gradation.

    Parameters
    ----------
    packing : Packing
        The grains.
    solid_fraction : float
        True volume of the grains that stay, over that of the container; in two dimensions areas. It is met as nearly as
        whole grains can, to half the volume of one.
    seed : int
        Seed of the choice.

    Returns
    -------
    Packing
        The grains that stay, in their order and at their places; ``provenance["removal"]`` has the number of removed
        grains, the solid fraction before, and the Kolmogorov-Smirnov distance of the sizes before and after.

    Raises
    ------
    InputError
        If the packing is of another type, grains are fixed, or the solid fraction is negative, not finite or above that
        of the packing.

    Warns
    -----
    PackingWarning
        If grains carried each other before and cannot any more: they have fewer than d + 1 contacts on average, with
        which no packing with friction rests.

    Notes
    -----
    The choice is even over all sizes: grains are ranked by diameter, and any share of them is taken from each part of
    the ranks. Grains that stay do not move; :func:`voxgran.settle` lets them come to rest.

    Examples
    --------
    >>> import voxgran as vg
    >>> dense = vg.pack(vg.make_shape("sphere"), vg.Box((8, 8, 8)), method="rsa", solid_fraction=0.3)
    >>> round(vg.remove_grains(dense, solid_fraction=0.2).solid_fraction, 2)
    0.2
    """
    check_packing(packing, "packing")
    packing.refuse_fixed("removal")
    wanted = as_number(solid_fraction, "solid_fraction", at_least=0.0)
    before = packing.solid_fraction
    if wanted > before * (1.0 + 1e-12):
        raise InputError(
            f"solid_fraction is {wanted:.6g} and the packing has {before:.6g}: grains are only removed here; for more "
            "give method='expand' or 'jam'"
        )
    order = _order(packing, seed)
    volume = np.cumsum(packing.volumes[order]) / packing.container.volume
    # the last grain is removed where the solid fraction is then nearer
    many = int(np.searchsorted(volume, before - wanted))
    if many < len(volume):
        lower = volume[many - 1] if many else 0.0
        many += int(volume[many] - (before - wanted) < (before - wanted) - lower)
    kept = packing[np.sort(order[many:])]
    report = {
        "removed": many,
        "solid_fraction_before": before,
        "gradation_distance": size_distance(packing.diameters, kept.diameters) if kept.count else 0.0,
        "seed": int(seed),
    }
    _warn_of_loss(packing, kept)
    # what was missed was said of all grains
    record = {key: value for key, value in packing.provenance.items() if key != "missed"} | {"removal": report}
    return replace(kept, provenance=record, stop_reason="solid_fraction", asked_sizes=packing.asked_sizes)


def _order(packing: Packing, seed: int) -> Integers:
    """Return the grains in the order in which they are removed: a random one, even over all sizes."""
    generator = stream(seed, "removal")
    shuffled = generator.permutation(packing.count)
    ranked = shuffled[np.argsort(packing.diameters[shuffled], kind="stable")]
    place = (np.arange(packing.count) * GOLDEN + generator.random()) % 1.0
    return np.asarray(ranked[np.argsort(place, kind="stable")])


def _warn_of_loss(packing: Packing, kept: Packing) -> None:
    """Warn where grains that carried each other have too few contacts left."""
    least = packing.dimension + 1
    before, after = _contacts_per_grain(packing), _contacts_per_grain(kept)
    if before >= least > after:
        warn(
            f"the grains have {after:.3g} contacts each on average, and had {before:.3g}: below {least} no packing "
            "rests; settle it, or remove fewer",
            PackingWarning,
        )


def _contacts_per_grain(packing: Packing) -> float:
    """Return the mean number of contacts of a grain, without walls."""
    return 2.0 * packing.contacts().count / packing.count if packing.count else 0.0
