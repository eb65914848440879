"""The commands: help and function of each, whose module is imported when the command is called."""

import argparse
from collections.abc import Callable
from importlib import import_module


def _late(module: str, name: str) -> Callable[[argparse.Namespace], int | None]:
    """Return a command of a module beside this one."""
    return lambda options: getattr(import_module(f"{__package__}.{module}"), name)(options)


def _of_packing(module: str, name: str) -> Callable[[argparse.Namespace], int | None]:
    """Return a command of a module beside this one that takes a packing, which is loaded for it."""

    def command(options: argparse.Namespace) -> int | None:
        packing = import_module(f"{__package__}.terminal").loaded(options)
        status: int | None = getattr(import_module(f"{__package__}.{module}"), name)(options, packing)
        return status

    return command


#: name: help, function
COMMANDS: dict[str, tuple[str, Callable[[argparse.Namespace], int | None]]] = {
    "init": ("write a scene file to start from", _late("actions", "init")),
    "plan": ("say what a run would compute, skip and cost", _late("actions", "plan")),
    "run": ("pack, check, measure and save a scene", _late("actions", "run")),
    "study": ("pack a scene with many values of its parameters and many seeds", _late("studies", "study")),
    "verify": ("check a packing against the true shapes", _late("actions", "verify")),
    "settle": ("let the grains of a packing come to rest under gravity", _of_packing("settling", "settle")),
    "compress": ("compress the grains of a packing to a mean stress", _of_packing("settling", "compress")),
    "tile": ("repeat a periodic packing beside itself, with its forces", _of_packing("settling", "tile")),
    "equilibrium": ("prove that the grains of a packing rest", _of_packing("settling", "equilibrium")),
    "measure": ("measure a packing", _late("actions", "measure")),
    "report": ("write a page with pictures about a packing", _late("actions", "report")),
    "picture": ("write a picture of a packing", _late("pictures", "picture")),
    "compare": ("write a page that compares packings", _late("actions", "compare")),
    "image": ("say what an image holds: its voxels, lengths, values and labels", _late("images", "info")),
    "segment": ("segment a grey image into labelled grains", _late("segmenting", "segment")),
    "labels": ("make a packing of a label image", _late("images", "labels")),
    "twin": ("make a packing of any number of grains that equals a sample", _of_packing("twins", "twin")),
    "learn": ("learn the distribution of the shapes of a sample", _late("segmenting", "learn")),
    "shape": ("make a shape of a family", _late("shapes", "shape")),
    "repair": ("mend a mesh file and say what was done", _late("actions", "repair")),
    "simplify": ("reduce a mesh file to fewer triangles and tell what that changed", _late("shapes", "simplify")),
    "cloud": ("make a closed surface of a scanned point cloud", _late("actions", "cloud")),
    "clump": ("fit a clump of spheres to a mesh file", _late("clumps", "clump")),
    "export": ("write the input of a DEM or DDA engine for a packing", _of_packing("decks", "export")),
    "relax": ("bring a packing to rest in an engine, and say how far from rest it was", _of_packing("decks", "relax")),
    "engines": ("list the engines that input can be written for", _late("decks", "engines")),
    "methods": (
        "list methods, families, sizes, orientations and measures with their parameters",
        _late("actions", "methods"),
    ),
    "doctor": ("say what this machine has and what is missing", _late("doctor", "doctor")),
    "data": ("copy a scan that comes with voxgran", _late("actions", "data")),
    "demo": ("pack scanned rocks and random solids in a box", _late("actions", "demo")),
    "app": ("put scenes together, run them and look at them in a browser", _late("actions", "app")),
}
