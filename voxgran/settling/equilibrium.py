"""Proof of rest: forces at the contacts, within their friction cones, that balance every grain.

A packing in which nothing moves may still be out of balance, since motions that are damped are slow. Here no motion is
looked at: the grains rest if there are forces at their contact points that balance the weight and the torque of each,
that press, and that across the normal are at most `friction` times as large as along it. Such forces are the minimum,
0, of a convex problem; where there are none, the minimum is what is left over.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, as_number, as_positive, check_type
from voxgran._base.calls import explained
from voxgran._base.compiling.threads import using_threads
from voxgran._base.config import from_mapping
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.manifolds.rows import ARM_I, GAP, NORMAL
from voxgran.settling.balance import gauss_seidel_forces, net_accelerations
from voxgran.settling.bed import Bed, normalized_bed
from voxgran.settling.interior_point import frictionless_forces, is_direct
from voxgran.settling.materials import (
    USUAL_FRICTION,
    FrictionTable,
    Materials,
    as_friction,
    friction_of,
    friction_range,
)
from voxgran.settling.parameters import MOST_FRICTION
from voxgran.settling.projected_gradient import accelerated_projected_gradient
from voxgran.settling.stress_balance import Balanced, as_stress, balance_stress, keep_known_forces, shear_ratio
from voxgran.settling.undecided import decide_rest

if TYPE_CHECKING:
    from xarray import Dataset

#: most iterations of the projected gradient
ITERATIONS = 20_000
#: distance from the optimum, root mean square in tolerances, at which it ends; the distance is estimated from above
NEAR = 0.2
#: accuracy of the interior point, in tolerances
ACCURACY = 0.1
#: iterations of the first guess
GUESS = 300
#: number of the partner at a wall and at a lid
WALL, LID = -1, -2


@dataclass(frozen=True, slots=True)
class Balance:
    """Forces at contacts, and by how much they fail to balance the grains.

    Attributes
    ----------
    forces : (m, 3) ndarray of float
        On grain j of each contact, and with opposite sign on grain i, in weights of a median grain.
    residual : (n,) ndarray of float
        Net force on each grain, in its weight.
    residual_torque : (n,) ndarray of float
        Net torque on each grain, in its weight times its radius.
    rests : (n,) ndarray of bool
        Where both are within the tolerance.
    undecided : (n,) ndarray of bool
        Which of the other grains might rest under the best forces; none, where this was not asked.
    iterations : int
        Iterations that were made.
    distance : float
        About how far the residuals are from the least ones, root mean square, in weights.
    """

    forces: Floats
    residual: Floats
    residual_torque: Floats
    rests: Booleans
    undecided: Booleans
    iterations: int
    distance: float


@explained(hint="equilibrium(packing, friction=0.5)")
def equilibrium(
    packing: Assembly, friction: float | Materials | None = None, gap: float = 1e-3, *,
    stress: "ArrayLike | None" = None, tolerance: float = 0.01, threads: int | None = None,
) -> "Dataset":  # fmt: skip
    """Return whether grains rest: forces at their contacts that balance the weight and the torque of each.

    Without gravity they balance a mean stress of the packing instead.

    Contacts are all places where grains are within a gap of each other, of walls and of the lid. A lid is a fixed wall
    here, since its weight is not known. A contact presses, it does not pull, and its force across the normal is at most
    `friction` times that along it. Where no such forces balance all grains, those are returned for which the sum of
    squared residuals, weighted by mass, is least. Forces that balance are in general not unique; the least residuals
    are. A grain does not rest if its least residual is above the tolerance; no forces then balance all grains. The
    forces that are found are close to the best ones, or those that the packing keeps, where more grains are in balance
    under these: they are checked at the same contacts and within the same friction cones. Grains at rest are in balance
    under the forces that are found. A grain is undecided if its residual under these forces is above the tolerance by
    less than the estimated error.

    Parameters
    ----------
    packing : Packing
        Grains, which may come from anywhere. Fixed ones need no balance: their residuals are 0, and shares leave them
        out.
    friction : float or Materials, optional
        Coefficient of friction of Coulomb between grains and at walls, at least 0, or a table of materials, whose pairs
        have one each; default: that of the forces which the packing keeps, as it settled or was compressed, or 0.5.
    gap : float
        Distance of the surfaces, in median diameters, up to which grains touch; at least 0.
    stress : float or array_like of float, optional
        Mean stress tensor (Love & Weber) that the forces have up to a factor, without gravity: one number for all axes
        or a number along each axis, which say nothing of shear stresses, with NaN or None where it is not prescribed;
        or a symmetric tensor, whose shear stresses are prescribed too: ``numpy.eye(3)`` is isotropic. Principal
        stresses are above 0. Default: of a packing without gravity that was compressed, the stress of its forces.
    tolerance : float
        Net force, in weights of a grain, and net torque, in its weight times its radius, up to which it rests; above 0.
        Under a stress it is in mean normal forces, and also the largest difference of the stress over its least one.
    threads : int, optional
        Number of threads, by default that of the processors or of ``OMP_NUM_THREADS``; the result is the same.

    Returns
    -------
    Dataset
        By grain: ``residual``, the net force in weights of the grain; ``residual_torque``, the net torque in its weight
        times its radius; ``rests``, where both are within the tolerance; ``carried``, the downward forces of others
        on the grain in its weights; and ``rattler``: it rests, and what it carries is within the tolerance. A
        rattler carries its own weight, as each grain does that rests under gravity, and nothing else: the others rest
        without it too. Grains that nothing holds are not at rest, and no rattlers.

        By contact: ``contact_i`` and ``contact_j``, the grains, of which the second is -1 at a wall and -2 at the lid;
        ``point``, at grain i, in the unit of lengths; ``normal`` from grain i to grain j; ``force`` on grain j,
        and with opposite sign on grain i, in weights of a grain of the median diameter (of the mean density by volume,
        where densities differ); ``normal_force``, along the normal; and ``gap``, in the unit of lengths.

        Attributes: ``gap``, ``tolerance`` and ``friction`` as given, of a table the largest one; ``share_at_rest``, the
        share of all grains that rest, and ``share_at_rest_without_rattlers``, that of the grains that are no rattlers;
        ``share_of_rattlers``, of all grains; ``share_undecided``, the share of all grains that do not rest under the
        forces which were found, and might do so under the best ones; and ``distance``, about how far the residuals are
        from the least ones (root mean square, in weights).

        Under a stress residuals are in mean normal forces, forces in the unit of stress times the square of the median
        diameter (in 2D times the diameter), ``carried`` is half the sum of the normal forces on the grain in mean ones,
        a rattler bears no forces, and ``share_at_rest`` counts all grains. The variable ``stress`` is the mean stress
        tensor of the forces, and the attribute ``stress_error`` its largest difference from the one that was asked for,
        over the least axial number of that one; the attribute ``shear_ratio`` is its largest shear stress over the mean
        of the axial ones. A packing holds the stress where this and all residuals are within the
        tolerance, which the attribute ``balanced`` says with 1 or 0.

    Raises
    ------
    InputError
        If `packing` is no packing, has neither gravity nor a stress, the stress is no symmetric tensor with principal
        stresses above 0, or a number, also that of threads, is out of range. If no friction is given, and that of the
        packing is by contact without its materials in the provenance.

    References
    ----------
    Mazhar, Heyn, Negrut & Tasora 2015, doi:10.1145/2735627: the convex problem and its solution with friction
    Mehrotra 1992, doi:10.1137/0802028: the interior point, without friction

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((3, 3, 6)), "gravity", count=20)
    >>> found = vg.equilibrium(bed, friction=0.5)
    >>> float(found.rests.mean()), bool(found.residual.max() < 0.01)
    (1.0, True)
    """
    check_type(packing, Assembly, "packing", "a Packing; load or pack one")
    down, forces = getattr(packing, "gravity", None), getattr(packing, "forces", None)
    tensor = None if stress is None else as_stress(stress, packing.dimension)
    if down is None and stress is None and forces is not None and forces.stress is not None:
        # torques on fixed grains, which bear them, are not in the symmetric part; between them it may have tension
        tensor, d = np.full((3, 3), math.nan), packing.dimension
        tensor[:d, :d] = (forces.stress + forces.stress.T)[:d, :d] / 2.0
    if down is None and tensor is None:
        usual = (0, 0, -1) if packing.dimension == 3 else (0, -1, 0)
        raise InputError(
            "packing.gravity is None: rest is a balance of weights; give the direction of gravity with "
            f"dataclasses.replace(packing, gravity={usual}), or a stress to be borne without gravity, stress=1"
        )
    friction = _known_friction(packing) if friction is None else as_friction(friction)
    rub, gap = friction_of(friction, packing), as_number(gap, "gap", at_least=0.0)
    tolerance = as_positive(tolerance, "tolerance")
    given = {"friction": friction_range(rub)[1], "gap": gap, "tolerance": tolerance}
    if tensor is not None:
        bed = normalized_bed(packing, np.zeros(3))
        start = None
        if forces is not None and forces.stress is not None and packing.count:
            start = forces.scaled(1.0 / packing.median_diameter)
        with using_threads(threads):
            held = balance_stress(bed, tensor, rub, reach=gap, tolerance=tolerance, start=start)
        return _stress_dataset(packing, bed, held, given)
    bed = normalized_bed(packing, np.array(down, dtype=np.float64))
    with using_threads(threads):
        if given["friction"] > 0.0:
            _guess_forces(bed, rub, gap)
        elif forces is not None:
            bed.find(gap, 0.0)
            keep_known_forces(bed, forces.scaled(1.0 / packing.median_diameter), rub, 1.0)
        found = balance_bed(bed, rub, reach=gap, tolerance=tolerance, decide=True)
        if forces is not None and forces.stress is None and not found.rests.all():
            # the search converges slowly where grains are slender; any forces that balance them are a proof
            keep_known_forces(bed, forces.scaled(1.0 / packing.median_diameter), rub, 1.0)
            known = _balance_of(bed, bed.forces(), tolerance)
            if known.rests.sum() > found.rests.sum():
                found = replace(known, undecided=found.undecided & ~known.rests, iterations=found.iterations)
    return _dataset(packing, bed, found, given)


def _balance_of(bed: Bed, forces: Floats, tolerance: float) -> Balance:
    """Return by how much forces at the contacts of a bed, (m, 3), fail to balance its grains."""
    accelerations = net_accelerations(bed.contacts, forces)
    undecided = np.zeros(bed.count, dtype=np.bool_)
    return Balance(forces, *_rests(bed, accelerations, tolerance), undecided, 0, math.inf)


def _known_friction(packing: Assembly) -> float | Materials:
    """Return the friction with which a packing came to rest, or 0.5 where it is not known."""
    forces = getattr(packing, "forces", None)
    known = None if forces is None else forces.friction
    if not isinstance(known, np.ndarray):
        return USUAL_FRICTION if known is None else float(known)
    # contacts that are found now are others: their friction is that of the materials
    record: Mapping[str, Any] = getattr(packing, "provenance", {})
    table = record.get("compression", record.get("settling", {})).get("parameters", {}).get("friction")
    if not isinstance(table, Mapping):
        raise InputError(
            "friction of the packing is by contact, and its materials are not known: give friction=0.5, or "
            "--friction 0.5"
        )
    return from_mapping(Materials, table, "friction of the packing")


def _guess_forces(bed: Bed, friction: float | FrictionTable, reach: float) -> None:
    """Let the bed keep forces that nearly balance it, with which the search for the best ones begins.

    They lie within the cones of a friction with which sweeps converge, and so within those of more friction. Where they
    balance the grains no better than none do, the search begins with none.
    """
    bed.find(reach, 0.0)
    forces = np.zeros((bed.m, 3))
    accelerations, _ = gauss_seidel_forces(
        bed.contacts,
        forces,
        np.zeros(bed.m),
        skin=0.0,
        iterations=GUESS,
        friction=np.minimum(bed.friction_at(friction), MOST_FRICTION),
    )
    inverse = bed.bodies[:-1, 6:8][bed.movable]
    left = (accelerations[:-1][bed.movable].reshape(-1, 2, 3) ** 2).sum(axis=2) / inverse
    # without forces all grains fall with the acceleration 1
    bed.keep_forces(forces if left.sum() < (1.0 / inverse[:, 0]).sum() else np.zeros_like(forces))


def balance_bed(
    bed: Bed, friction: float | FrictionTable, *, reach: float, tolerance: float, iterations: int = ITERATIONS,
    decide: bool = False, sweeps: int = 0, hopeless: float = math.inf, patience: int | None = None,
) -> Balance:  # fmt: skip
    """Return the forces at the contacts of a bed within reach that balance its grains best; grains as the bed has them.

    The search begins with the forces that the bed keeps, and the bed keeps those that are found. With `decide` it goes
    on near the optimum while grains that do not rest may rest at the optimum. sweeps: iterations of Gauss-Seidel with
    which it begins, which spread forces fast; it ends with them where the median residual is still `hopeless`
    tolerances.  patience: iterations after which it ends where no more grains rest.
    """
    bed.find(reach, 0.0)
    contacts, forces, limit = bed.contacts, bed.forces(), _limits(bed, tolerance)
    row, undecided = contacts.row, np.zeros(bed.count, dtype=bool)
    if friction_range(friction)[1] > 0.0 or not is_direct(bed):
        rub = bed.friction_at(friction)
        if sweeps:
            accelerations, made = gauss_seidel_forces(
                contacts, forces, np.zeros(bed.m), friction=rub, skin=0.0, iterations=sweeps
            )
            residual, torque, _ = _rests(bed, accelerations, tolerance)
            if bed.count and float(np.median(np.maximum(residual, torque)[bed.movable])) > hopeless * tolerance:
                iterations = 0
        if decide:
            own = np.array(rub, dtype=np.float64, ndmin=1)
            undecided, made, distance = decide_rest(
                contacts, forces, own, limit=limit, near=NEAR * tolerance, iterations=iterations
            )
            accelerations = net_accelerations(contacts, forces)
        else:
            accelerations, made, distance = accelerated_projected_gradient(
                contacts, forces, friction=rub, iterations=iterations, tolerance=limit,
                near=NEAR * tolerance, patience=patience,
            )  # fmt: skip
    else:
        distance, height = ACCURACY * tolerance, -linear.matmul(bed.grains.position, bed.gravity)
        normal = row[:, NORMAL : NORMAL + 3]
        known = np.maximum((forces * normal).sum(axis=1), 0.0)[:, None] * normal
        push, accelerations, made = frictionless_forces(contacts, accuracy=distance, height=height)
        forces = push[:, None] * normal
        if not (found := _rests(bed, accelerations, tolerance)[2]).all():
            # the optimum is too coarse for grains that weigh far less than others: forces of springs may be a proof
            other = net_accelerations(contacts, known)
            if _rests(bed, other, tolerance)[2].sum() > found.sum():
                forces, accelerations, distance = known, other, math.inf
    bed.keep_forces(forces)
    return Balance(forces, *_rests(bed, accelerations, tolerance), undecided, made, distance)


def _limits(bed: Bed, tolerance: float) -> Floats:
    """Return the accelerations (n + 1, 2) up to which grains rest, and those of points at the radius of gyration."""
    inverse = bed.bodies[:, 6:8]
    gyration = np.sqrt(inverse[:-1, 0] / np.where(inverse[:-1, 1] > 0.0, inverse[:-1, 1], np.inf))
    lever = 0.5 * bed.diameter / np.where(gyration > 0.0, gyration, 1.0)
    return tolerance * np.stack([np.ones(bed.count + 1), np.append(lever, 1.0)], axis=1)


def _rests(bed: Bed, accelerations: Floats, tolerance: float) -> tuple[Floats, Floats, Booleans]:
    """Return the net force and torque of each grain, in its weight and radius, and whether they are small."""
    bodies = bed.bodies
    residual = linear.norm(accelerations[:-1, :3], axis=1)
    # moment of inertia over mass, beside the radius of a sphere or disk of the same volume
    moment = bodies[:-1, 6] / np.where(bodies[:-1, 7] > 0.0, bodies[:-1, 7], np.inf)
    torque = linear.norm(accelerations[:-1, 3:], axis=1) * moment / (0.5 * bed.diameter)
    return residual, torque, (residual <= tolerance) & (torque <= tolerance)


def carried_by(bed: Bed, forces: Floats) -> Floats:
    """Return the sum of the downward forces of others on each grain of a bed, (n,), in its own weights."""
    i, j, n = bed.rows.i[: bed.m], bed.rows.j[: bed.m], bed.count
    along = linear.matmul(forces, bed.gravity)
    carried = np.bincount(i, np.maximum(-along, 0.0), minlength=n)
    inner = (j >= 0) & (j < n)
    carried += np.bincount(j[inner], np.maximum(along[inner], 0.0), minlength=n)
    return np.asarray(carried * bed.bodies[:n, 6])


def _dataset(packing: Assembly, bed: Bed, found: Balance, parameters: dict[str, float]) -> "Dataset":
    """Return what was found under gravity, by the grains of the packing, with units and names."""
    carried = bed.in_order(carried_by(bed, found.forces))
    rests = bed.in_order(found.rests)
    made = _named(
        packing, bed, found.forces, weight="weight", of_forces="weight of a grain of the median diameter",
        residual=bed.in_order(found.residual), torque=bed.in_order(found.residual_torque), rests=rests,
        carried=(carried, "weight", "sum of the downward forces of others"),
        rattler=(
            rests & (carried <= parameters["tolerance"]) & packing.movable,
            "whether the grain rests and carries nothing else",
        ),
    )  # fmt: skip
    made.attrs.update(parameters)
    made.attrs.update(_shares(made, packing.movable))
    undecided = bed.in_order(found.undecided)[packing.movable]
    made.attrs["share_undecided"] = float(undecided.mean()) if len(undecided) else 0.0
    made.attrs["distance"] = found.distance if math.isfinite(found.distance) else -1.0
    return made


def _stress_dataset(packing: Assembly, bed: Bed, found: Balanced, parameters: dict[str, float]) -> "Dataset":
    """Return what was found under a stress, by the grains of the packing, with units and names."""
    residual, torque = bed.in_order(found.residual), bed.in_order(found.residual_torque)
    tolerance = parameters["tolerance"]
    push = (found.forces * bed.rows.row[: bed.m, NORMAL : NORMAL + 3]).sum(axis=1)
    i, j, n = bed.rows.i[: bed.m], bed.rows.j[: bed.m], bed.count
    inner, mean = (j >= 0) & (j < n), float(push[push > 0.0].mean()) if (push > 0.0).any() else 1.0
    total = np.bincount(i, push, minlength=n) + np.bincount(j[inner], push[inner], minlength=n)
    power = "median diameter squared" if packing.dimension == 3 else "median diameter"
    made = _named(
        packing, bed, found.forces, weight="mean normal force", of_forces=f"stress x {power}",
        residual=residual, torque=torque, rests=(residual <= tolerance) & (torque <= tolerance),
        carried=(bed.in_order(total / (2.0 * mean)), "mean normal force", "half the sum of the normal forces"),
        rattler=(~bed.in_order(found.bearing) & packing.movable, "whether the grain bears no forces"),
    )  # fmt: skip
    made["stress"] = (("axis", "axis_"), found.stress, {"units": "stress", "long_name": "mean stress tensor"})
    shares = _shares(made, packing.movable)
    held = found.missed <= tolerance and shares["share_at_rest"] == 1.0
    made.attrs.update({**parameters, **shares, "stress_error": found.missed, "balanced": int(held)})
    made.attrs["shear_ratio"] = shear_ratio(found.stress, packing.dimension)
    return made


def _shares(made: "Dataset", movable: Booleans) -> dict[str, float]:
    """Return the shares of grains that are not fixed: that rest, with and without rattlers, and of rattlers."""
    rests, rattler = made["rests"].values[movable], made["rattler"].values[movable]
    others = rests[~rattler]
    return {
        "share_at_rest": float(rests.mean()) if len(rests) else 1.0,
        "share_at_rest_without_rattlers": float(others.mean()) if len(others) else 1.0,
        "share_of_rattlers": float(rattler.mean()) if len(rests) else 0.0,
    }


def _named(
    packing: Assembly, bed: Bed, forces: Floats, *, weight: str, of_forces: str, residual: Floats, torque: Floats,
    rests: Booleans, carried: tuple[Floats, str, str], rattler: tuple[Booleans, str],
) -> "Dataset":  # fmt: skip
    """Return numbers of grains and contacts with units and names.

    weight, of_forces: units of residuals and of forces.  carried, rattler: numbers of the grains and what they mean.
    """
    length, unit = packing.median_diameter, getattr(packing, "unit", "1")
    row = bed.rows.row[: bed.m]
    i, partner = bed.contact_grains(wall=WALL, lid=LID)
    normal, point = row[:, NORMAL : NORMAL + 3], packing.position[i] + row[:, ARM_I : ARM_I + 3] * length
    grain, contact, vector = ("grain",), ("contact",), ("contact", "axis")
    values: dict[str, tuple[tuple[str, ...], Any, str, str]] = {
        "residual": (grain, residual, weight, "net force"),
        "residual_torque": (grain, torque, f"{weight} radius", "net torque"),
        "rests": (grain, rests, "1", "whether net force and torque are within the tolerance"),
        "carried": (grain, *carried),
        "rattler": (grain, rattler[0], "1", rattler[1]),
        "contact_i": (contact, i, "1", "index of the first grain"),
        "contact_j": (contact, partner, "1", "index of the second grain, -1 at a wall and -2 at a lid"),
        "point": (vector, point, unit, "point of contact on the first grain"),
        "normal": (vector, normal.copy(), "1", "unit vector from the first to the second grain"),
        "force": (vector, forces, of_forces, "force on the second grain"),
        "normal_force": (contact, (forces * normal).sum(axis=1), of_forces, "force along the normal"),
        "gap": (contact, row[:, GAP] * length, unit, "distance of the surfaces"),
    }
    made: Dataset = load("xarray").Dataset(
        {
            name: (dims, array, {"units": units, "long_name": long_name})
            for name, (dims, array, units, long_name) in values.items()
        }
    )
    return made
