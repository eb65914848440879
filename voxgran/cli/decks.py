"""Commands that write input for engines, relax a packing in one, and list them."""

import argparse
import json
from pathlib import Path
from typing import Any

import voxgran
from voxgran._base.config import parameters_of
from voxgran._base.errors import InputError
from voxgran._base.files import as_path, refuse_links, refuse_to_replace
from voxgran.cli.terminal import entry_line, progress, show
from voxgran.decks.engine import Engine, engine_registry
from voxgran.decks.relax import remove_state, save_history
from voxgran.io.files import known_suffix
from voxgran.packing.model import Packing
from voxgran.settling.material import Material


def checkpoint_of(options: argparse.Namespace) -> Path:
    """Return the file for the last state of an interrupted run, beside the output."""
    return as_path(options.output).with_suffix(".checkpoint.vtp")


def _asked(options: argparse.Namespace) -> dict[str, Any]:
    """Return the material, the number of spheres, the time step and the stress that flags give."""
    given = {item.name: getattr(options, item.name) for item in parameters_of(Material)}
    material = {name: value for name, value in given.items() if value is not None}
    return {"material": material, "clump": options.clump, "time_step": options.time_step, "stress": options.stress}


def export(options: argparse.Namespace, packing: Packing) -> None:
    """Write the input of an engine for a packing."""
    deck = voxgran.write_deck(
        packing, options.output, options.engine, grains=options.grains, overwrite=options.overwrite, **_asked(options)
    )
    simulation = deck.simulation
    numbers: dict[str, Any] = {
        "engine": deck.engine,
        "grains": packing.count,
        "total_mass_kg": float(simulation.bodies.mass.sum()),
        "time_step_s": simulation.time_step,
        "approximated": "; ".join(one.approximated for one in simulation.bodies.templates if one.approximated) or "no",
        "files": [str(path) for path in deck.files] if options.json else len(deck.files),
    }
    run = f"; run '{deck.command}' there" if deck.command else ""
    show(numbers, options, f"input in {deck.folder}{run}")


def relax(options: argparse.Namespace, packing: Packing) -> int:
    """Relax a packing in an engine, and write it; return exit status 1 where it does not come to rest.

    Raises
    ------
    InputError
        If the output or the history has another suffix than .vtp and .nc.
    OutputError
        If the checkpoint beside the output is a link to another place.
    """
    if known_suffix(options.output) != ".vtp":
        raise InputError(f"output is {options.output!r}: relaxed packings are kept as .vtp; change the suffix")
    if options.history and as_path(options.history).suffix.lower() != ".nc":
        raise InputError(f"history is {options.history!r}: the course of a run is kept as .nc; change the suffix")
    if not options.overwrite:
        refuse_to_replace(*(path for path in (options.output, options.history) if path))
    checkpoint = checkpoint_of(options)
    refuse_links(checkpoint.parent, checkpoint)
    with progress(options) as on_step:
        rested, history = voxgran.relax(
            packing,
            options.engine,
            until=options.until,
            longest=options.longest,
            folder=options.folder,
            overwrite=options.overwrite,
            checkpoint=checkpoint,
            on_step=on_step,
            **_asked(options),
        )
    voxgran.save(rested, options.output, overwrite=options.overwrite)
    if options.history:
        save_history(history, options.history, overwrite=options.overwrite)
    remove_state(checkpoint)
    last = {str(name): float(values[-1]) for name, values in history.data_vars.items()}
    told = {name: history.attrs[name] for name in ("sinking", "change_of_coordination", "touching_gap")}
    rests = bool(history.attrs["rests"])
    show({"rests": rests, "grains": rested.count, **told, **last}, options, str(options.output))
    return 0 if rests else 1


def engines(options: argparse.Namespace) -> None:
    """List the engines that input can be written for."""
    registry = engine_registry()
    found = {name: registry.get(name) for name in registry.names()}
    if options.json:
        print(json.dumps({name: _told(engine) for name, engine in found.items()}, indent=2))
        return
    for name, engine in found.items():
        entry_line(name, f"{engine.title}: {engine.summary}")
        for what, text in _told(engine).items():
            if what not in ("title", "summary") and text:
                entry_line(f"    {what.replace('_', ' ')}", text if isinstance(text, str) else ", ".join(text))


def _told(engine: Engine) -> dict[str, Any]:
    """Return what is said of an engine."""
    has = {
        "periodic": engine.periodic,
        "tilted periodic cells": engine.tilted,
        "two dimensions": engine.planar,
        "cohesion": engine.cohesion,
        "bonds": engine.bonds,
        "rolling friction": bool(engine.rolling),
        "several materials": engine.materials,
        "fixed grains": engine.fixed,
        "stress of periodic cells": engine.servo,
        "stress of walls": engine.platens,
        "relax": engine.run is not None,
    }
    return {
        "title": engine.title,
        "summary": engine.summary,
        "grains": [kind.replace("_", " ") for kind in engine.kinds],
        "laws": list(engine.laws),
        "also": [name for name, there in has.items() if there],
        "files_are": engine.verified,
        "install": engine.install,
        "run": engine.command,
        "source": engine.source,
    }
