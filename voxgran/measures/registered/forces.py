"""Forces at the contacts of a packing at rest: their distribution, sliding contacts, rattlers and what is at rest.

Beads under pressure bear forces whose distribution is flat near and below the mean and falls off exponentially above
it, as exp(-b f) with b near 1.5 for the force f over its mean: Mueth, Jaeger & Nagel 1998,
doi:10.1103/PhysRevE.57.3164; for disks Radjai et al. 1996, doi:10.1103/PhysRevLett.77.274. These laws are of one
pressure: in a bed that carries its own weight forces grow with depth, so that the distribution over the whole bed is
wider.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran.contacts.forces import AT_REST, ContactForces, partner_images
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.measures.registered.coordination import rattler_variables
from voxgran.packing.model import Packing

#: largest force over the mean in the histogram, and width of its bins
FAR, STEP = 8.0, 0.25
#: relative distance from the friction limit within which a contact is at it
SLIDES = 1e-3
#: smallest number of forces above the mean for the decay of the tail
FEWEST = 20


@dataclass(frozen=True, eq=False)
class ForceStatistics:
    """Numbers of the forces between grains; forces are in the unit of the packing, NaN is not known."""

    edges: Floats  # (k + 1,) edges of the bins, as normal force over the mean
    density: Floats  # (k,) probability density; its integral is the share of the pairs with forces up to the last edge
    mean: float  # mean normal force of the pairs of grains that carry one
    pairs: int  # number of these pairs
    decay: float  # b of the tail exp(-b f) above the mean, f being the force over its mean
    participation: float  # mean force squared over the mean of the squared forces: 1 for equal ones, 0.5 exponential
    sliding: float  # share of the contacts that carry a force, walls included, at the limit of friction
    coordination: float  # mean number of partners, by forces, of the grains that are no rattlers


def force_statistics(packing: Packing) -> ForceStatistics:
    """Return the statistics of the forces between grains.

    A pair of grains (of a periodic image) that touches in several points counts once, with the sum of its normal
    forces; pairs without a normal force above 1e-4 of the mean of all contacts are no partners. Walls and the lid count
    for the share of contacts that slide only. The decay is that of largest likelihood, one over the mean excess of the
    forces above the mean, and NaN for fewer than 20 of them. The participation is that of Makse, Johnson & Schwartz
    2000, doi:10.1103/PhysRevLett.84.4160.

    Raises
    ------
    InputError
        If the forces of the packing are not known.
    """
    forces = known_forces(packing)
    pair = pair_forces(packing, forces)
    edges = np.linspace(0.0, FAR, round(FAR / STEP) + 1)
    mean = float(pair.mean()) if len(pair) else math.nan
    relative = pair / mean
    inside = np.histogram(relative, edges)[0]
    above = relative[relative > 1.0] - 1.0
    bearing = int((~forces.rattler).sum())
    return ForceStatistics(
        edges,
        inside / (STEP * len(pair)) if len(pair) else np.full(len(edges) - 1, math.nan),
        mean,
        len(pair),
        float(1.0 / above.mean()) if len(above) >= FEWEST else math.nan,
        float(1.0 / np.square(relative).mean()) if len(pair) else math.nan,
        sliding_share(forces),
        2.0 * len(pair_forces(packing, forces, without_rattlers=True)) / bearing if bearing else math.nan,
    )


def known_forces(packing: Packing) -> ContactForces:
    """Return the forces of a packing.

    Raises
    ------
    InputError
        If they are not known.
    """
    if packing.forces is None:
        raise InputError(
            "forces of the packing are None: they are known of a packing that was settled; settle it or give it forces"
        )
    return packing.forces


def pair_forces(packing: Packing, forces: ContactForces, *, without_rattlers: bool = False) -> Floats:
    """Return the normal force of each pair of grains that carries one, summed over its contacts, (p,); on request
    without pairs of which one is a rattler.
    """
    kept = forces.carries & (forces.j >= 0)
    if without_rattlers:
        kept &= ~(forces.rattler[forces.i] | forces.rattler[forces.j])
    i, j = forces.i[kept], forces.j[kept]
    image = partner_images(packing, forces)[kept]
    # a pair may be listed from either side; of a grain and its own image either way is the same
    turned = (i > j) | ((i == j) & (linear.matmul(image, np.array([9, 3, 1])) < 0))
    first, second = np.where(turned, j, i), np.where(turned, i, j)
    rows = np.column_stack([first, second, np.where(turned[:, None], -image, image)])
    pair = np.unique(rows, axis=0, return_inverse=True)[1].ravel()
    return np.bincount(pair, weights=forces.normal_force[kept]).astype(np.float64)


def sliding_share(forces: ContactForces) -> float:
    """Return the share of the contacts that carry a force whose tangential force is at the limit of friction, within
    1e-3 of it; NaN where the friction is not known, 0, or nothing carries a force.
    """
    if forces.friction is None or not np.any(forces.friction) or not forces.carries.any():
        return math.nan
    limit = (forces.friction * forces.normal_force)[forces.carries]
    return float((forces.tangential_force[forces.carries] >= (1.0 - SLIDES) * limit).mean())


def _compute(packing: Packing) -> Groups:
    """Return the numbers, the histogram, the contacts with their forces, and the residuals of the grains."""
    found, forces = force_statistics(packing), known_forces(packing)
    unit, row = length_unit(packing), ("force_contact",)
    of_root, of_grains = rattler_variables(packing)
    root = {
        "share_at_rest": variable(
            (), forces.share_at_rest, "1", f"share of the grains with a residual below {AT_REST:g}"
        ),
        **of_root,
        "coordination_by_forces": variable(
            (), found.coordination, "1", "mean number of partners by forces, of grains that are no rattlers"
        ),
        "mean_normal_force": variable((), found.mean, "1", f"mean normal force between grains, in {forces.unit}"),
        "share_sliding": variable((), found.sliding, "1", "share of the contacts at the limit of friction"),
        "force_participation": variable((), found.participation, "1", "squared mean force over mean squared force"),
        "force_decay": variable((), found.decay, "1", "decay of the distribution of forces above their mean"),
    }
    middle = (found.edges[1:] + found.edges[:-1]) / 2
    values: dict[str, Any] = {
        "density": variable(
            ("relative_force",), found.density, "1", "probability density of the normal force over its mean"
        ),
        "i": variable(row, forces.i, "1", "index of the first grain"),
        "j": variable(row, forces.j, "1", "index of the partner, -1 for a wall, -2 for the lid"),
        "point": variable((*row, "axis"), forces.point, unit, "contact point"),
        "normal": variable((*row, "axis"), forces.normal, "1", "unit vector from the first grain to the partner"),
        "force": variable((*row, "axis"), forces.force, "1", f"force on the partner, in {forces.unit}"),
        "gap": variable(row, forces.gap, unit, "distance of the surfaces, negative where they overlap"),
    }
    grains = {
        "residual": variable(
            ("grain",), forces.residual, "1", f"unbalanced force and torque, in {forces.unit_of_residual}"
        ),
        **of_grains,
        "largest_force": variable(("grain",), forces.largest_force(), "1", f"largest contact force, in {forces.unit}"),
    }
    along = variable(("relative_force",), middle, "1", "normal force over its mean, middle of the bin")
    return {"/": dataset(root), "/forces": dataset(values, {"relative_force": along}), "/grains": dataset(grains)}


def _known(packing: Packing) -> bool:
    """Return whether the forces of a packing are known."""
    return packing.forces is not None


registration = Measure(
    summary="distribution of contact forces, sliding contacts, rattlers, and the share of grains at rest",
    groups=("/", "/forces", "/grains"),
    compute=_compute,
    tilted=True,
    applies=_known,
)
