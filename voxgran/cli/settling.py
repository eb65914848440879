"""Commands that let the grains of a packing settle or compress them, and that prove that they rest."""

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import voxgran
from voxgran._base.arrays import as_share
from voxgran._base.checkpoint import remove_checkpoint
from voxgran._base.config import parameters_of
from voxgran._base.errors import InputError, OutputExistsError
from voxgran._base.files import as_path, refuse_links, refuse_to_replace
from voxgran.cli.parameters import nested_class
from voxgran.cli.terminal import progress, show
from voxgran.containers.gravity import as_down, proposed_axis
from voxgran.io.files import check_savable
from voxgran.measures.registered.compression import wall_stresses
from voxgran.measures.registered.density import main_fraction
from voxgran.packing.model import Packing
from voxgran.settling.parameters import Compression, Settling

#: shares of the grains that `equilibrium` tells
SHARES = ("share_at_rest", "share_at_rest_without_rattlers", "share_of_rattlers")
#: largest number of grains that a message lists
LISTED = 10


def checkpoint_of(options: argparse.Namespace) -> Path:
    """Return the checkpoint of a run that moves grains: the one that is named, or one beside the output."""
    return as_path(options.checkpoint or Path(options.output).with_suffix(".checkpoint.voxgran"))


def settle(options: argparse.Namespace, packing: Packing) -> int:
    """Let the grains of a packing settle, and write them; return exit status 1 where some still overlap.

    Raises
    ------
    OutputExistsError
        If the output, or the checkpoint of an interrupted run, is there and neither is to be replaced.
    FileFormatError
        If packings are not written with the suffix of the output.
    InputError
        If a file with that suffix cannot hold the grains.
    """
    how = {**parameters_given(options, Settling), "gravity": options.gravity, "seed": options.seed}
    return _moved(options, packing, partial(voxgran.settle, packing, **how), _summary)


def compress(options: argparse.Namespace, packing: Packing) -> int:
    """Compress the grains of a packing to a stress, and write them; return exit status 1 where some overlap.

    Raises
    ------
    OutputExistsError
        If the output, or the checkpoint of an interrupted run, is there and neither is to be replaced.
    FileFormatError
        If packings are not written with the suffix of the output.
    InputError
        If a file with that suffix cannot hold the grains.
    """
    how = parameters_given(options, Compression)
    return _moved(options, packing, partial(voxgran.compress, packing, **how), _compressed_summary)


def tile(options: argparse.Namespace, packing: Packing) -> None:
    """Repeat a packing beside itself, and write all copies.

    Raises
    ------
    FileFormatError
        If packings are not written with the suffix of the output.
    InputError
        If a file with that suffix cannot hold the grains, or the packing is not repeated so.
    OutputExistsError
        If the output is there and is not to be replaced.
    """
    check_savable(packing, options.output)
    if not options.overwrite:
        refuse_to_replace(options.output)
    large = packing.tiled(options.repeats)
    voxgran.save(large, options.output, overwrite=options.overwrite)
    rest = {} if large.forces is None else {"share_at_rest": large.forces.share_at_rest}
    show({**large.provenance["tiled"], "grains": large.count, **rest}, options, str(options.output))


def _moved(
    options: argparse.Namespace,
    packing: Packing,
    move: Callable[..., Packing],
    summary: Callable[[Packing, Packing], dict[str, Any]],
) -> int:
    """Move the grains of a packing in a run with checkpoints, write and verify them, and show the main numbers.

    Raises
    ------
    OutputError
        If the checkpoint beside the output is a link to another place.
    """
    check_savable(packing, options.output)
    checkpoint = checkpoint_of(options)
    if not options.checkpoint:
        refuse_links(checkpoint.parent, checkpoint)
    begin(options, [as_path(options.output)], [checkpoint])
    with progress(options) as on_step:
        after = move(checkpoint=checkpoint, resume=options.resume, on_step=on_step)
    # what is there was to be replaced when the run began
    voxgran.save(after, options.output, overwrite=options.overwrite or options.resume)
    remove_checkpoint(checkpoint)
    with progress(options) as on_step:
        proof = voxgran.verify(after, on_step=on_step)
    numbers = summary(packing, after)
    numbers["verify"] = {name: getattr(proof, name) for name in ("ok", "overlapping_pairs", "deepest", "escaped")}
    show(numbers, options, str(options.output))
    return 0 if proof.ok else 1


def begin(options: argparse.Namespace, files: Sequence[Path], checkpoints: Sequence[Path]) -> None:
    """Refuse to replace files and the checkpoints of an interrupted run unasked; where a run does not go on from these,
    remove them.

    Raises
    ------
    OutputExistsError
        If one of them is there and is not to be replaced.
    """
    left = next((path for path in checkpoints if path.exists()), None)
    if not (options.overwrite or (options.resume and left)):
        refuse_to_replace(*files)
        if left:
            raise OutputExistsError(
                f"{left} is the checkpoint of an interrupted run: go on with --resume, or start anew with --overwrite"
            )
    if not options.resume:
        for path in checkpoints:
            remove_checkpoint(path)


def parameters_given(options: argparse.Namespace, kind: type) -> dict[str, Any]:
    """Return the parameters of a class that flags give, a mapping for each group of them."""
    found: dict[str, Any] = {}
    for item in parameters_of(kind):
        group = nested_class(item)
        if group is None:
            value = getattr(options, item.name)
        else:
            given = {entry.name: getattr(options, f"{item.name}_{entry.name}") for entry in parameters_of(group)}
            value = {name: value for name, value in given.items() if value is not None} or None
        if value is not None:
            found[item.name] = value
    return found


def _compressed_summary(before: Packing, after: Packing) -> dict[str, Any]:
    """Return the main numbers of a compressed packing."""
    record = after.provenance.get("compression", {})
    numbers: dict[str, Any] = {
        "grains": after.count,
        "steps": record.get("steps", 0),
        "solid_fraction_before": before.solid_fraction,
        "solid_fraction": after.solid_fraction,
        "void_ratio": 1.0 / after.solid_fraction - 1.0 if after.count else None,
        "friction": record.get("parameters", {}).get("friction"),
    }
    if "sought" in record:
        numbers["tries"] = record["sought"]["tries"]
    if after.forces is not None and after.forces.stress is not None:
        found = after.measure("forces")
        axial = np.diag(after.forces.stress)[: after.dimension]
        numbers |= {f"stress_{axis}": float(value) for axis, value in zip("xyz", axial, strict=False)}
        numbers["shear_ratio"] = record.get("shear_ratio")
        numbers |= {f"stress_at_{name}": value for name, value in wall_stresses(after).items()}
        numbers["coordination_by_forces"] = float(found["coordination_by_forces"])
        numbers |= {name: getattr(after.forces, name) for name in ("share_at_rest", "share_of_rattlers")}
    return numbers | {"stop_reason": after.stop_reason}


def _summary(before: Packing, after: Packing) -> dict[str, Any]:
    """Return the main numbers of a settled packing."""
    record = after.provenance.get("settling", {})
    (region, fraction), was = main_fraction(after), main_fraction(before)
    numbers: dict[str, Any] = {
        "grains": after.count,
        **_fixed_count(after),
        "steps": record.get("steps", 0),
        **({"solid_fraction_before": was[1]} if was[0] == region else {}),
        "solid_fraction": fraction,
        "region": region,
        "container_solid_fraction": after.solid_fraction,
    }
    if (sought := record.get("sought")) is not None:
        shaking = sought["shaking"] or {}
        found = {"bed_solid_fraction": sought["reached"], "friction": sought["friction"], "tries": sought["tries"]}
        numbers |= found | {f"shaking_{name}": value for name, value in shaking.items()}
    if after.forces is not None:
        numbers |= {name: getattr(after.forces, name) for name in ("share_at_rest", "share_of_rattlers")}
    return numbers | {"stop_reason": after.stop_reason}


def equilibrium(options: argparse.Namespace, packing: Packing) -> int:
    """Say which grains of a packing rest; return exit status 1 where fewer than asked for do.

    Raises
    ------
    InputError
        If there is no gravity, a number is out of range, or the materials of the grains are not known.
    """
    least = as_share(options.rest, "rest", zero=True)
    if options.gravity is not None:
        packing = dataclasses.replace(packing, gravity=as_down(options.gravity, packing.container))
    held = None if packing.forces is None else packing.forces.stress
    if packing.gravity is None and options.stress is None and held is None:
        axis = proposed_axis(packing.container)
        raise InputError(
            f"packing.gravity is None: rest is a balance of weights; give its direction with --gravity {axis}, or a "
            "stress that is borne without gravity with --stress 1"
        )
    found = voxgran.equilibrium(
        packing, options.friction, options.gap, stress=options.stress, tolerance=options.tolerance
    )
    rattlers = np.flatnonzero(found["rattler"].values)
    residual = np.maximum(found["residual"].values, found["residual_torque"].values)
    worst = np.argsort(-residual, kind="stable")[:LISTED]
    # grains that bear nothing are in balance under any stress
    pressed = "stress_error" in found.attrs
    rests = found.attrs["share_at_rest"] >= least
    if pressed:
        rests &= found.attrs["stress_error"] <= options.tolerance
    show(
        {
            "rests": bool(rests),
            "grains": packing.count,
            **_fixed_count(packing),
            "contacts": found.sizes["contact"],
            "friction": found.attrs["friction"],
            **{name: found.attrs[name] for name in (*SHARES, "stress_error" if pressed else "share_undecided")},
            "rattlers": rattlers.tolist() if options.json else _listed(rattlers.tolist()),
            "largest_residuals": {f"grain_{grain}": float(residual[grain]) for grain in worst.tolist()},
        },
        options,
    )
    return 0 if rests else 1


def _fixed_count(packing: Packing) -> dict[str, int]:
    """Return the number of fixed grains, where there are some."""
    return {} if packing.fixed is None else {"fixed_grains": int(packing.fixed.sum())}


def _listed(grains: list[int]) -> str:
    """Return the numbers of some grains in words, those of the first ones where there are many."""
    first = ", ".join(str(grain) for grain in grains[:LISTED])
    return f"{first} and {len(grains) - LISTED} more" if len(grains) > LISTED else first or "none"
