"""Commands from scans to grains: a grey image is segmented into labels, and a distribution of shapes is learned."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import voxgran
from voxgran._base.errors import InputError
from voxgran._base.files import existing_file, output_suffix, written_whole
from voxgran.cli.images import opened
from voxgran.cli.terminal import show
from voxgran.io.vtk_files import is_own
from voxgran.report.stage import check_picture_path
from voxgran.shapes.files import shape_of_file
from voxgran.shapes.repairing.diagnose import Remedies

#: suspects that are named
NAMED = 10


def learn(options: argparse.Namespace) -> None:
    """Learn the distribution of the shapes of a packing, or of mesh files, and write it.

    Raises
    ------
    InputError
        If there is a packing among several files.
    """
    output_suffix(options.output, [".nc"], "distributions of shapes are kept", overwrite=options.overwrite)
    if options.picture:
        check_picture_path(options.picture, overwrite=options.overwrite)
    first, *others = options.files
    packings = [path for path in options.files if Path(path).suffix.lower() == ".vtp" and is_own(existing_file(path))]
    if others and packings:
        raise InputError(
            f"{packings[0]} is a packing, one of {len(options.files)} files: shapes are learned from one packing, or "
            "from mesh files alone; give it alone"
        )
    remedies = Remedies(mend="run voxgran repair on it", keep_open="", choose="run voxgran repair on it")
    shapes = [shape_of_file(path, remedies=remedies) for path in options.files] if others else voxgran.load(first)
    model = voxgran.learn_shapes(shapes, method=options.method, strength=options.strength, seed=options.seed)
    report = model.report(descriptors=options.descriptors, seed=options.seed)
    if options.picture:
        voxgran.save_gallery(report.pairs, options.picture, columns=4, overwrite=options.overwrite)
    model.save(options.output, overwrite=options.overwrite)
    numbers = {str(name): float(value) for name, value in report.table.data_vars.items() if not value.dims}
    written = ", ".join(str(path) for path in (options.output, options.picture) if path)
    show({"grains": len(model.shapes), "method": model.method, "strength": model.strength, **numbers}, options, written)


def segment(options: argparse.Namespace) -> None:
    """Segment a grey image, write its labels and a picture, and say how many grains it has and which are in doubt.

    Raises
    ------
    InputError
        If the labels are to be kept with a voxel size that is unknown.
    """
    from voxgran.io.image import SUFFIXES

    if options.output:
        output_suffix(options.output, (*SUFFIXES, ".npy"), "labels are kept", overwrite=options.overwrite)
    if options.picture:
        check_picture_path(options.picture, overwrite=options.overwrite)
    source = opened(options)
    lattice = options.voxel_size is not None or source.voxel_size is not None
    if options.output and Path(options.output).suffix.lower() != ".npy" and not lattice:
        raise InputError(
            f"voxel_size is None: {options.file} does not tell it, and {options.output} keeps it; give the edge of a "
            "voxel, or write .npy"
        )
    names = ("voxel_size", "threshold", "dark_grains", "min_size", "separation")
    found = voxgran.segment(source, **{name: getattr(options, name) for name in names})
    if options.output:
        _write(found, options)
    if options.picture:
        voxgran.save_slices(found, options.picture, image=source, overwrite=options.overwrite)
    suspects = found.suspects
    pairs = np.column_stack([suspects["grain"], suspects["other"]])
    numbers = {
        "grains": found.grains,
        "separation": found.separation,
        "threshold": found.threshold,
        "suspects": len(pairs),
        "perhaps_one": [f"{a} and {b}" for a, b in pairs if a != b][:NAMED],
        "perhaps_several": [str(a) for a, b in pairs if a == b][:NAMED],
    }
    show(numbers, options, ", ".join(str(path) for path in (options.output, options.picture) if path))


def _write(found: Any, options: argparse.Namespace) -> None:
    """Write the labels."""
    if Path(options.output).suffix.lower() == ".npy":
        with written_whole(options.output, overwrite=options.overwrite) as draft, draft.open("wb") as file:
            np.save(file, found.labels)
        return
    lattice: dict[str, Any] = {"origin": found.origin, "unit": found.unit, "overwrite": options.overwrite}
    voxgran.save_image(found.labels, options.output, voxel_size=found.voxel_size, **lattice)
