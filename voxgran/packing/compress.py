"""`compress`: from a packing to a specimen under a mean stress, without gravity.

The work is that of :mod:`voxgran.settling.compression`; here it becomes a run like that of a packing method.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.calls import explained
from voxgran._base.config import from_mapping, to_mapping
from voxgran._base.errors import InputError, PackingWarning, warn
from voxgran._base.progress import OnStep
from voxgran.contacts.verify import verify
from voxgran.packing.beds.search import ENOUGH, REGIONS, WHOLE, SoughtBed, sentence_of
from voxgran.packing.driver import Drive, check_drive
from voxgran.packing.model import Packing, check_packing
from voxgran.packing.settling_run import (
    Moving,
    SettleState,
    moved_alone,
    no_forces,
    normalized_assembly,
    problem_alone,
    refuse_deep,
    with_known_forces,
)
from voxgran.packing.start import around_fixed, free_volume
from voxgran.settling.compression import TOUCHING, Compressor
from voxgran.settling.materials import Materials
from voxgran.settling.parameters import Compression, with_friction
from voxgran.settling.stress_balance import stress_of

#: largest shear stress, in the mean axial one, of which nothing is said
MOST_SHEAR = 0.05
#: largest share of grains that bear no forces in a specimen, and least width of one that changes its form, in mean
#: diameters
MOST_RATTLERS, LEAST_WIDTH = 0.5, 3.0


@explained(hint="compress(packing, friction=0.5)")
def compress(
    packing: Packing,
    *,
    stress: float | Sequence[float] = 1.0,
    axes: str = "xyz",
    shear: Literal["held", "free"] | None = None,
    friction: float | Materials | None = None,
    solid_fraction: float | None = None,
    porosity: float | None = None,
    void_ratio: float | None = None,
    region: Literal["specimen", "bulk"] = "specimen",
    height: float | None = None,
    rate: float | None = None,
    rest: float = 0.98,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    threads: int | None = None,
    on_step: OnStep | None = None,
) -> Packing:
    """Compress the grains of a packing, without gravity, until their mean stress is the one that is asked for.

    The periodic sides or the opposite walls of the container move towards each other, until forces at the contacts,
    within the cones of friction, balance each grain and give the stress. Grains are rigid and do not overlap at the
    end. The friction decides how dense they become. A packing whose contacts bear the stress already stays as it is.

    Parameters
    ----------
    packing : Packing
        The grains, made by any method, loaded or put together by hand, loose or dense. They may overlap a little. Its
        container is a box, a rectangle, an upright cylinder, a disk or a sphere, periodic or not. Fixed grains move as
        points of the container, within its walls, and do not turn; solid fractions leave them out.
    stress : float or sequence of float
        Mean stress along all axes, or one along each axis, above 0, in any unit; only the ratios decide how the grains
        lie. Along axes that do not move it is not prescribed.
    axes : str
        Axes along which the container is compressed: ``"z"`` is an oedometric path, in which the others stay as they
        are; default: all. A cylinder is compressed along ``"xy"`` by its radius.
    shear : str, optional
        ``"held"``: the angles of the container stay as they are, and its shear stresses are a result, the larger the
        fewer grains there are. ``"free"``: the cell tilts along each two periodic axes that move, until it has no shear
        stress there. Default: held, with a warning where a cell that might tilt has more than 0.05 of the mean axial
        stress.
    friction : float or Materials, optional
        Coulomb coefficient of friction between grains and at walls, from 0 to 2, or a table of materials, whose pairs
        have one each. A coefficient above 0.7 is that between grains only: at walls it is 0.7, since in corners of
        walls grains would wedge. Default: 0.5, or the friction that gives `solid_fraction` or `height`.
    solid_fraction : float, optional
        Solid fraction of the result, met to 0.002: the friction from 0 to 1 is found that gives it, and none may
        be given. Default: as the friction gives it.
    porosity, void_ratio : float, optional
        In place of the solid fraction: 1 minus it, or the volume of the voids over that of the grains.
    region : str
        Where the solid fraction is measured: ``"specimen"``, from wall to wall, as a laboratory does, or ``"bulk"``,
        away from the walls, near which grains are looser (``bulk_solid_fraction`` of :func:`voxgran.measure`, in
        specimens of at least 75 grains there).
    height : float, optional
        Height of the container at the end, along its last axis, in the unit of lengths, in place of a solid fraction,
        with ``axes="z"`` (in 2D ``"y"``): the friction is found that gives it; default: as the friction gives it.
    rate : float, optional
        Viscous number of the compression, from 1e-6 to 0.1: strain rate times the drag of a grain of the median
        diameter d, over stress times d (in 2D over the stress). Grains that are compressed slower become a little
        denser; default: 3e-3, and 3e-5 with a friction below 0.05.
    rest : float
        Share of the grains that bear forces which must be in balance so that the packing counts as compressed.
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
        The same grains, in the same order, in the container as it is at the end, without gravity and lid. Its stop
        reason is ``"compressed"`` where at least the share `rest` of the grains that bear forces is in balance and the
        stress is met to 1 %, ``"yielded"`` where they go on shearing, since they bear no such ratio of stresses, else
        ``"steps"``. Its `forces` are in the unit of stress times the square of the median diameter (in 2D times the
        diameter), their `stress` is the mean stress tensor, and their residuals are in mean normal forces. The measure
        ``compression`` has the path: solid fraction, void ratio and stresses by step.

    Raises
    ------
    InputError
        If a value breaks a rule, no wall of the container moves along the axes, stresses differ along axes that
        stretch together or by more than ten times what the densest grains bear with that friction, grains overlap so
        deep that they cannot be parted, a shape is an open surface, all grains are fixed, or the container would become
        shorter than a fixed grain is long.
    VoxgranError
        If grains overlap at the end, where they bear no such stress, although the container has been widened.
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
        If fewer grains than asked for are in balance, the stress is missed, fixed grains overlap, more than half of the
        grains bear no forces, the container has changed its form and is narrower than 3 mean diameters, or the
        solid fraction is beyond what the grains are compressed to; the nearest packing is returned then.

    See Also
    --------
    voxgran.equilibrium : proves that forces balance the grains and a stress.
    voxgran.settle : lets grains come to rest under gravity.

    Notes
    -----
    Walls move with the mean strain of the grains, so that friction at a wall hinders motion relative to the strain
    only: a container wall that stands still while grains move along it holds nothing. Equal spheres that are compressed
    isotropically have a solid fraction of 0.635 and 6.0 contacts without friction (published: 0.639 and 6.0) and of
    0.577 and 4.67 contacts with a friction of 0.3 (published: 0.593 and 4.5; Agnolin & Roux 2007,
    doi:10.1103/PhysRevE.76.061302).

    Examples
    --------
    >>> import voxgran as vg
    >>> loose = vg.pack(vg.shapes.sphere(), vg.Box((5, 5, 5), periodic="xyz"), "rsa", count=60)
    >>> specimen = vg.compress(loose, friction=0.3)
    >>> specimen.stop_reason, specimen.solid_fraction > 0.5
    ('compressed', True)
    """
    check_packing(packing, "packing")
    given = {
        "stress": stress, "axes": axes, "shear": shear, "friction": friction, "solid_fraction": solid_fraction,
        "porosity": porosity, "void_ratio": void_ratio, "region": region, "height": height, "rate": rate, "rest": rest,
    }  # fmt: skip
    how = with_friction(from_mapping(Compression, given, "compress"))
    how.refuse_known_friction()
    how.modes_of(packing.container)
    check_drive(checkpoint, resume, on_step, None)
    packing = replace(packing, gravity=None, lid=None)
    if packing.count and not packing.movable.any():
        raise InputError(
            f"all {packing.count} grains are fixed: none bears a stress by itself; free some of them with "
            "dataclasses.replace(packing, fixed=...)"
        )
    if not packing.count:
        return replace(packing, stop_reason="compressed", forces=no_forces(how.friction))
    run = Drive(checkpoint, resume, on_step, threads=threads)
    compressed = moved_alone(
        "compress", packing, problem_alone(packing, how), lambda given: begun_compression(given, how),
        finished_compression, run,
    )  # fmt: skip
    warn_of_imbalance(compressed)
    return compressed


def begun_compression(packing: Packing, how: Compression) -> SettleState:
    """Return the first state of a compression."""
    assembly, unit = normalized_assembly(packing)
    forces = packing.forces
    start = None if forces is None or forces.stress is None else forces.scaled(1.0 / unit)
    how, whole = with_friction(how), how.region == "specimen" or how.height is not None
    if how.height is not None:
        how = replace(how, solid_fraction=_fraction_at(packing, how.height), height=None)
    settler: Moving = Compressor(assembly, how, start)
    if how.solid_fraction is not None:
        settler = SoughtBed(
            how, lambda tried: Compressor(assembly, tried), lambda ended: _moved(packing, ended),
            shakes=False, whole=whole,
        )  # fmt: skip
    refuse_deep(settler)
    return SettleState(settler, total=settler.most_steps * packing.count, stage="compressing")


def _fraction_at(packing: Packing, height: float) -> float:
    """Return the solid fraction of a container of another height along its last axis.

    Raises
    ------
    InputError
        If it is above 1.
    """
    bare = around_fixed(packing)
    volume, fixed = float(bare.volumes.sum()), packing.container.volume - free_volume(packing)
    fraction = volume / max(packing.container.volume * height / _height_of(packing) - fixed, 1e-300)
    if fraction > 1.0:
        raise InputError(
            f"height is {height:g}: the grains have {fraction:.3g} times the volume of a container of that height; "
            "give a larger height or fewer grains"
        )
    return fraction


def _widths(packing: Packing) -> Floats:
    """Return the lengths (d,) of the bounds of the container."""
    return np.asarray(np.ptp(packing.container.bounds, axis=0)[: packing.dimension])


def _moving_axes(packing: Packing, asked: Mapping[str, Any]) -> list[int]:
    """Return the axes along which a container is compressed."""
    return [axis for axis in range(packing.dimension) if "xyz"[axis] in asked["axes"]]


def _thin_axes(packing: Packing, asked: Mapping[str, Any]) -> Integers:
    """Return the axes along which a specimen is too narrow, of those that move.

    A cell that is compressed by one factor along all axes is as wide as its grains, of which the caller knows.
    """
    moves = _moving_axes(packing, asked)
    if len(moves) == packing.dimension and np.ptp(asked["stress"]) == 0.0:
        return np.zeros(0, dtype=np.int64)
    narrow = _widths(packing)[moves] < LEAST_WIDTH * float(packing.diameters[packing.movable].mean())
    return np.array(moves, dtype=np.int64)[narrow]


def _axial_stresses(packing: Packing) -> str:
    """Return the axial stresses of the forces in words."""
    if packing.forces is None or packing.forces.stress is None:
        return "unknown"
    return " : ".join(f"{value:.3g}" for value in np.diag(packing.forces.stress)[: packing.dimension])


def _height_of(packing: Packing) -> float:
    """Return the length of the container along its last axis."""
    return float(_widths(packing)[-1])


def _moved(packing: Packing, settler: Any) -> Packing:
    """Return a packing with its grains and its container where they are now, without forces."""
    unit = packing.median_diameter
    if settler.ended and settler.progress.step == 1:
        # it bore the stress already: not even the last bits change
        return replace(packing, contact_gap=TOUCHING * unit, forces=None)
    position, orientation = settler.bed.poses()
    return replace(
        packing,
        position=position * unit,
        orientation=orientation,
        container=settler.bed.assembly.container.scaled(unit),
        contact_gap=TOUCHING * unit,
        forces=None,
    )


def finished_compression(packing: Packing, state: SettleState) -> Packing:
    """Return the packing as it was compressed, with its forces."""
    settler: Any = state.settler
    record = {**packing.provenance, "compression": {"parameters": to_mapping(settler.how), **settler.report}}
    moved = replace(_moved(packing, settler), stop_reason=state.stop_reason or "interrupted", provenance=record)
    if not settler.ended:
        return moved
    bed, forces = settler.bed, settler.bed.forces()
    return with_known_forces(
        moved,
        settler,
        forces * settler.unit,
        packing.median_diameter,
        residual=bed.in_order(settler.progress.residual),
        rattler=(bed.in_order(settler.progress.bearing) == 0.0) & packing.movable,
        stress=stress_of(bed, forces) * settler.unit,
    )


def warn_of_imbalance(packing: Packing) -> None:
    """Warn where fewer grains than asked for are in balance, some overlap, or a stress or solid fraction is missed."""
    record = packing.provenance.get("compression", {})
    if packing.stop_reason == "interrupted" or "balanced" not in record:
        return
    if packing.fixed is not None and not (proof := verify(replace(packing[packing.fixed], fixed=None))).ok:
        depth = max(proof.deepest, proof.largest_escape)
        warn(
            f"fixed grains overlap each other or the walls by up to {depth:.2g} mean diameters of theirs, since they "
            "move with the walls: let them stand farther apart, or leave them free",
            PackingWarning,
        )
    if packing.stop_reason == "yielded":
        axes = _moving_axes(packing, record["parameters"])
        asked = np.broadcast_to(record["parameters"]["stress"], packing.dimension)[axes]
        warn(
            f"the least axial stress that is asked for is {asked.min() / asked.max():.3g} of the largest one, and the "
            f"least that these grains bear is about {record['stress_ratio']:.2g} of it: they go on shearing at a "
            f"constant volume, with axial stresses of {_axial_stresses(packing)} at the end; ask for more equal "
            "stresses, or give more friction",
            PackingWarning,
        )
    elif packing.stop_reason != "compressed":
        warn(
            f"{record['balanced']:.1%} of the grains that bear forces are in balance, and the axial stresses are "
            f"{_axial_stresses(packing)}, up to {record['stress_error']:.2g} of the least one from those asked for: "
            "compress them once more, or with more friction or more equal stresses",
            PackingWarning,
        )
    elif packing.forces is not None and packing.forces.share_of_rattlers > MOST_RATTLERS:
        wide = float(_widths(packing).min())
        warn(
            f"{packing.forces.share_of_rattlers:.1%} of the grains bear no forces, since a few grains span the "
            f"container, which is {wide / packing.median_diameter:.2g} median diameters wide now: take more "
            "grains, or a wider container",
            PackingWarning,
        )
    elif len(thin := _thin_axes(packing, record["parameters"])):
        axis = thin[int(_widths(packing)[thin].argmin())]
        wide = float(_widths(packing)[axis] / packing.diameters[packing.movable].mean())
        warn(
            f"the container is {wide:.2g} mean diameters wide along {'xyz'[axis]} now, and a specimen of less than "
            f"{LEAST_WIDTH:g} has the stress of a few layers of grains: begin with a container that is longer along "
            f"{'xyz'[axis]}, with more grains, or ask for more equal stresses",
            PackingWarning,
        )
    _warn_of_shear_and_density(packing, record)


def _warn_of_shear_and_density(packing: Packing, record: Mapping[str, Any]) -> None:
    """Warn where a cell that is held has much shear stress, or a solid fraction is missed or that of no bulk."""
    wrap = sum(packing.container.periodic[axis] for axis in _moving_axes(packing, record["parameters"]))
    told = record["parameters"]["shear"] is None and packing.stop_reason == "compressed"
    if told and wrap > 1 and record["shear_ratio"] > MOST_SHEAR:
        warn(
            f"the largest shear stress is {record['shear_ratio']:.2g} of the mean axial stress, since the angles of "
            "the cell are held: let it tilt with shear='free', take more grains, or accept it with shear='held'",
            PackingWarning,
        )
    sought = record.get("sought", {"met": True})
    if not sought["met"]:
        what = "the packing"
        if sought["measure"] == REGIONS[WHOLE] and record["parameters"]["axes"] == "xyz"[packing.dimension - 1]:
            height = _height_of(packing)
            asked = height * sought["reached"] / sought["solid_fraction"]
            what += f", whose height is {height:.4g} instead of {asked:.4g},"
        warn(sentence_of(sought, what, "are compressed to"), PackingWarning)
    if record["parameters"]["region"] == "bulk" and sought.get("measure") == REGIONS[WHOLE]:
        warn(
            f"region is 'bulk', which holds fewer than {ENOUGH} grains: the solid fraction is that of the specimen; "
            "take more grains, or leave region out",
            PackingWarning,
        )
