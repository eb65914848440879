"""`settle`: from a packing to a bed at rest, as a step of its own or after a packing method.

The work is that of :mod:`voxgran.settling`; here it becomes a run like that of a packing method, with checkpoints,
signals and progress.
"""

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import as_count, as_share
from voxgran._base.calls import explained
from voxgran._base.config import from_mapping
from voxgran._base.errors import InputError, PackingWarning, numbered, shown, warn
from voxgran._base.progress import OnStep
from voxgran._base.seeds import MOST_SEED
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.verify import TOLERANCE, verify
from voxgran.containers.gravity import as_down, gravity_vector, proposed_axis
from voxgran.containers.model import UNKNOWN, Container, boundary_of, check_container
from voxgran.containers.one_unit import in_one_unit
from voxgran.containers.size_limits import poses_between_walls
from voxgran.packing.beds.expected import tell_of_bed
from voxgran.packing.beds.search import sentence_of
from voxgran.packing.draw import DENSEST
from voxgran.packing.driver import Drive, check_drive
from voxgran.packing.method import PackingMethod, State
from voxgran.packing.model import Packing, check_packing
from voxgran.packing.problem import Problem
from voxgran.packing.settling_run import begun, finished, moved_alone, no_forces, problem_alone
from voxgran.packing.start import around_fixed, free_volume
from voxgran.settling.materials import Materials
from voxgran.settling.parameters import Compression, Lid, Settling, Shaking, with_friction

#: share of the volume of a container from which on one grain fills it
FILLED = 1.0 - 1e-9


@explained(hint="settle(packing, friction=0.5)")
def settle(
    packing: Packing,
    *,
    friction: float | Materials | None = None,
    restitution: float = 0.0,
    shaking: Shaking | Mapping[str, Any] | None = None,
    lid: Lid | Mapping[str, Any] | None = None,
    container: Container | None = None,
    gravity: "ArrayLike | None" = None,
    seed: int = 0,
    fall_time: float | None = None,
    solid_fraction: float | None = None,
    porosity: float | None = None,
    void_ratio: float | None = None,
    rest: float = 0.95,
    parts: Literal["exact", "hulls"] = "exact",
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    threads: int | None = None,
    on_step: OnStep | None = None,
) -> Packing:
    """Let the grains of a packing come to rest under gravity, by their true shapes.

    Grains fall with inertia and friction until they hardly sink, then move in quasi-static steps until forces at their
    contacts balance their weights. No grains overlap at the end. A bed that rests already stays as it is.

    Parameters
    ----------
    packing : Packing
        The grains, made by any method, loaded or put together by hand. They may overlap. Fixed grains do not move.
    friction : float or Materials, optional
        Coulomb coefficient of friction between grains and at walls, from 0 to 2; what rests with 2 rests with more. A
        table of materials has one for each pair; the masses of the grains follow from the density of the packing.
        Default: 0.5, or the friction that gives `solid_fraction`.
    restitution : float
        Ratio of the velocities after and before an impact, along the normal, from 0 to 1.
    shaking : Shaking or mapping, optional
        Random accelerations after the fall, which make the bed denser; default: none.
    lid : Lid or mapping, optional
        Plate that lies on the bed; default: none.
    container : Container, optional
        Container in which the grains settle, if it is not that of the packing; all centroids lie in it.
    gravity : str or (3,) array_like of float, optional
        Direction in which gravity acts, an axis such as ``"-z"`` or any vector; default: that of the packing.
    seed : int
        Seed of the random accelerations of shaking.
    fall_time : float, optional
        Longest time of the fall with inertia, in sqrt(d / g) with the median diameter d; default: until the mean grain
        sinks by less than 0.05 d in that time unit. Beds that move for longer become denser.
    solid_fraction : float, optional
        Solid fraction of the bed at rest, met to 0.002: the friction from 0 (0.05 for grains that are not round, and
        for more than 3,000) to 1 is found that gives it and, where the bed without friction is looser, the shaking with
        up to twice gravity. Where `friction` is given, only the shaking is found. It is that of the bulk
        (``bulk_solid_fraction`` of :func:`voxgran.measure`) where the first bed has at least 75 grains there, else that
        of the container below the height that holds 85 % of the volume of the grains (``bed_solid_fraction``). The
        provenance says under ``["settling"]["sought"]`` what was found, and in how many tries; default: as friction and
        shaking give it.
    porosity, void_ratio : float, optional
        In place of the solid fraction: 1 minus it, or the volume of the voids over that of the grains.
    rest : float
        Share of the grains that must be proven to rest so that the bed counts as settled.
    parts : {"exact", "hulls"}
        Shapes that settle: the true ones, or the convex hulls of meshes that are not convex, which is faster.
    checkpoint : path-like, optional
        File for checkpoints, written every ten seconds, when the run is asked to stop, and at the end.
    resume : bool
        Whether to go on from that file where it is there.
    threads : int, optional
        Number of threads, by default that of the processors or of ``OMP_NUM_THREADS``; the result is the same.
    on_step : callable, optional
        Called with each :class:`Step` of the work; default: at a terminal and in a notebook, a line on the error stream
        every ten seconds.

    Returns
    -------
    Packing
        The same grains, in the same order. Its stop reason is ``"settled"`` where at least the share `rest` of the
        grains is proven to rest, else ``"steps"``; ``"full"`` and ``"saturated"`` stay. Its `forces` are those that
        balance the grains.

    Raises
    ------
    InputError
        If a value breaks a rule, there is no gravity, grains are outside of the container, fill more of it than they
        can or overlap so deep that they cannot be parted, a shape is an open surface, or `threads` is no whole number
        above 0.
    CheckpointError
        If the checkpoint is damaged, belongs to another run, or is another file, which is not replaced.
    OutputError
        If the checkpoint cannot be written.
    InUseError
        If another process writes that checkpoint.
    Interrupted
        On SIGINT, SIGTERM or SIGHUP, after a checkpoint was written; on a second signal, at once.

    Warns
    -----
    PackingWarning
        If fewer grains than asked for are proven to rest, some could not be parted, or the solid fraction is beyond
        what the grains come to rest at; the nearest bed is returned then. If a bed of which a solid fraction is asked
        is expected to have no bulk.

    See Also
    --------
    voxgran.equilibrium : proves that a bed rests.
    voxgran.verify : proves that nothing overlaps.

    Notes
    -----
    The fall is contact dynamics with small substeps (Moreau 1988, doi:10.1007/978-3-7091-2624-0_1; Macklin et al.
    2019, doi:10.1145/3309486.3340247); grains fall no faster than sqrt(g d). The quasi-static steps solve for contact
    forces with Coulomb friction by Gauss-Seidel sweeps with momentum. A solid fraction is found by the Illinois
    algorithm (Dowell & Jarratt 1971, doi:10.1007/BF01934364); all tries begin with the grains as they are given.

    Examples
    --------
    >>> import voxgran as vg
    >>> box = vg.Box((4, 4, 8), periodic="xy")
    >>> loose = vg.pack(vg.make_shape("sphere"), box, method="rsa", count=50)
    >>> vg.settle(loose, gravity="-z").stop_reason
    'settled'
    """
    check_packing(packing, "packing")
    given = {
        "friction": friction,
        "restitution": restitution,
        "shaking": shaking,
        "lid": lid,
        "fall_time": fall_time,
        "solid_fraction": solid_fraction,
        "porosity": porosity,
        "void_ratio": void_ratio,
        "rest": rest,
        "parts": parts,
    }
    how = with_friction(from_mapping(Settling, given, "settle"))
    packing = _prepared(packing, container, gravity)
    check_drive(checkpoint, resume, on_step, None)
    seed = as_count(seed, "seed", at_most=MOST_SEED)
    if not packing.movable.any():
        forces = None if packing.count else no_forces(how.friction)
        return replace(packing, stop_reason="settled", forces=forces)
    problem = problem_alone(packing, how, seed)
    if how.solid_fraction is not None:
        units = tuple(shape.scaled(1 / shape.diameter) for shape in problem.shapes)
        tell_of_bed(replace(problem, shapes=units), on_step, np.array(packing.gravity))
    run = Drive(checkpoint, resume, on_step, threads=threads)
    settled = moved_alone("settle", packing, problem, lambda given: begun(given, how, seed), finished, run)
    warn_of_unrest(settled)
    return settled


def _prepared(packing: Packing, container: Container | None, gravity: "ArrayLike | None") -> Packing:
    """Return the packing in another container and under another gravity, where they are given.

    Raises
    ------
    InputError
        If there is no gravity, the centroid of a grain is outside of the container, or grains fill more than they can.
    """
    if container is not None:
        check_container(container)
        shapes, container, _ = in_one_unit(packing.shapes, container, packing.unit)
        packing = replace(packing, container=container, shapes=shapes)
    if gravity is not None:
        packing = replace(packing, gravity=as_down(gravity, packing.container))
    if packing.gravity is None:
        raise InputError(
            "packing.gravity is None: grains settle under gravity only; give "
            f"gravity={proposed_axis(packing.container)!r} along an axis that has walls"
        )
    if packing.movable.any():
        _refuse_too_full(packing)
        beyond = packing.container.signed_distance(packing.position)
        outside = np.flatnonzero(beyond > 0.0)
        if len(outside):
            raise InputError(
                f"{numbered('grain', outside)} of the packing: centroids must lie in the container; move them, or give "
                "a larger container"
            )
    return packing


def _refuse_too_full(packing: Packing) -> None:
    """Refuse grains that fill more of their container than grains can without overlap.

    Raises
    ------
    InputError
        If they have more volume than it, or are equal spheres in a box and denser than the densest lattice.
    """
    packing = around_fixed(packing)
    sizes = packing.diameters
    equal = all(shape.is_sphere for shape in packing.shapes) and np.ptp(sizes) <= 1e-9 * sizes.max()
    lattice = equal and boundary_of(packing.container).is_flat
    most = DENSEST[packing.dimension] if lattice else 1.0
    filled = float(packing.volumes.sum()) / free_volume(packing)
    if filled > most * (1.0 + 1e-9):
        raise InputError(
            f"the solid fraction is {filled:.4g}: without overlap these grains fill at most {most:.4g} "
            "of the container; give a larger container or fewer grains"
        )


def warn_of_unrest(packing: Packing) -> None:
    """Warn where fewer grains than asked for are proven to rest, some still overlap, or a solid fraction is missed."""
    record = packing.provenance.get("settling")
    if record is None or packing.stop_reason == "interrupted":
        return
    asked = record["parameters"]["rest"]
    if record["smallest_gap"] < -TOLERANCE:
        text = (
            f"grains still overlap by up to {-record['smallest_gap']:.2g} median diameters: settle them once more or, "
            "where that does not help, give a larger container or fewer grains"
        )
        warn(text, PackingWarning)
    elif record["resting"] < asked:
        lighter = ", a lighter lid" if packing.lid is not None else ""
        text = (
            f"{record['resting']:.1%} of the grains are proven to rest, where {asked:.1%} are asked for: settle them "
            f"once more, or take a larger friction{lighter}"
        )
        warn(text, PackingWarning)
    if not (sought := record.get("sought", {"met": True}))["met"]:
        warn(sentence_of(sought), PackingWarning)


def with_target(parameters: Any, solid_fraction: Any) -> tuple[Any, Any]:
    """Return the parameters of a method, and the solid fraction that decides how many grains are drawn.

    A method whose grains settle or are compressed as they are packed gets the solid fraction as that of its bed: then
    it decides nothing about their number.

    Raises
    ------
    InputError
        If it is no number in (0, 1], or the parameters hold another one.
    """
    if solid_fraction is None or not isinstance(parameters, Settling | Compression):
        return parameters, solid_fraction
    held = parameters.solid_fraction
    if held is not None and held != solid_fraction:
        raise InputError(
            f"solid_fraction is {shown(solid_fraction)}, and that of the parameters of the method is {held:g}: both "
            "are that of the grains at the end; leave one of them out"
        )
    return replace(parameters, solid_fraction=as_share(solid_fraction, "solid_fraction")), None


def settling_after(method: PackingMethod, problem: Problem, asked: Any) -> Settling | None:
    """Return how the grains settle after the method, or None if they do not.

    Raises
    ------
    InputError
        If they are to settle although there is no gravity, or a value breaks a rule.
    UnknownNameError
        If a parameter is unknown.
    """
    if asked is None and not (method.builds_bed and _can_settle(problem)):
        return None
    pulled = hasattr(problem.parameters, "gravity") and bool(gravity_vector(problem).any())
    settling = as_settling(pulled if asked is None else asked, problem.parameters)
    if settling is not None and not pulled:
        raise InputError(
            f"settle is {shown(asked)}: method {method.name!r} packs without gravity here; leave settle out, or call "
            f"settle(packing, gravity={proposed_axis(problem.container)!r})"
        )
    return settling


def with_grain_as_container(method: PackingMethod, problem: Problem) -> PackingMethod:
    """Return a method that places the first grain where it is as large as the container, and nothing else is asked for
    or has room: no place that is drawn, and no lattice, has it; else the method itself.
    """
    container, shape = problem.container, problem.shapes[problem.shape_id[0]] if problem.count else None
    if shape is None or shape.is_open or problem.start is not None or method.sizing != "drawn":
        return method
    if problem.orientation is not None or _keeps_apart(problem):
        return method
    if problem.count > 1 and problem.volumes[0] < container.volume * FILLED:
        return method
    for position, turn in zip(*poses_between_walls(shape.scaled(problem.diameter[0]), container), strict=True):
        grain = {"position": position[None], "orientation": turn[None]}
        scale, shape_id = problem.diameter[:1], problem.shape_id[:1]
        if verify(Assembly.of(problem.shapes, container, scale=scale, shape_id=shape_id, **grain)).ok:
            break
    else:
        return method
    pulled = hasattr(problem.parameters, "gravity") and bool(gravity_vector(problem).any())
    gravity = gravity_vector(problem) if pulled else None
    # it cannot move
    reason = "settled" if pulled else "count" if problem.count == 1 else "full"
    return replace(
        method,
        prepare=lambda _: State({}, {}, 1, 1, reason),
        advance=lambda _, state, attempts: state,
        finish=lambda task, _: task.packing(np.arange(1), stop_reason=reason, gravity=gravity, **grain),
    )


def _keeps_apart(problem: Problem) -> bool:
    """Return whether grains are to keep a distance, or to overlap."""
    return any(getattr(problem.parameters, name, 0.0) for name in ("distance", "overlap"))


def _can_settle(problem: Problem) -> bool:
    """Return whether grains settle unasked: closed ones, not to keep a distance or to overlap, within known walls."""
    known = boundary_of(problem.container) is not UNKNOWN
    return known and not _keeps_apart(problem) and not any(shape.is_open for shape in problem.shapes)


def as_settling(asked: Any, parameters: Any = None) -> Settling | None:
    """Return the parameters of settling that True, False, a mapping or an object of them stand for; None for none.

    parameters: those of the method after which grains settle.

    Raises
    ------
    InputError
        If it is something else, a value breaks a rule, or the method has parameters of settling itself.
    UnknownNameError
        If a key is unknown.
    """
    if isinstance(parameters, Settling) and isinstance(asked, Settling | Mapping):
        raise InputError(
            f"settle is {shown(asked)}: grains of this method settle as they are packed; leave settle out, and give "
            "these values as parameters of the method, such as friction=0.3"
        )
    if isinstance(asked, Settling):
        return with_friction(asked)
    if isinstance(asked, Mapping):
        return with_friction(from_mapping(Settling, asked, "settle"))
    if isinstance(asked, bool | np.bool_):
        return with_friction(Settling()) if asked else None
    raise InputError(f"settle is {shown(asked)}: it must be True, False or parameters such as dict(friction=0.5)")
