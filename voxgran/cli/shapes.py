"""Commands that make shapes of a family, one into a file or many into a folder with a table, and that simplify one."""

import argparse
import csv
import io
from pathlib import Path
from typing import Any

import voxgran
from voxgran._base.config import parameters_of
from voxgran._base.errors import InputError, OutputExistsError
from voxgran._base.files import made_folder, refuse_links, write_text
from voxgran._base.progress import Step
from voxgran.cli.terminal import progress, show, warn
from voxgran.report.stage import check_picture_path
from voxgran.shapes.files import check_surface_output
from voxgran.shapes.formats.mesh_files import WRITERS

#: name of the table in a folder of shapes
TABLE = "shapes.csv"


def shape(options: argparse.Namespace) -> None:
    """Make one shape of a family, or many, and write them.

    Raises
    ------
    InputError
        If a kind of files is given for one shape.
    """
    from voxgran.shapes.family import families

    names = [item.name for item in parameters_of(families().get(options.family).parameters)]
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    if options.gallery:
        check_picture_path(options.gallery, overwrite=options.overwrite)
    if options.count is not None:
        _many(options, given)
        return
    if options.format:
        raise InputError(f"--format is {options.format} without --count: one file is of the kind that --output names")
    made = voxgran.make_shape(options.family, seed=options.seed, **given)
    if options.output:
        voxgran.save_shape(made, options.output, overwrite=options.overwrite)
    if options.gallery:
        voxgran.save_gallery([made], options.gallery, overwrite=options.overwrite)
    numbers = {name: getattr(made, name) for name in ("name", "volume", "surface_area", "diameter")}
    show({**numbers, "faces": len(made.faces)}, options)


def simplify(options: argparse.Namespace) -> None:
    """Reduce a mesh file to fewer triangles and tell what that changed."""
    if options.output:
        check_surface_output(options.output, overwrite=options.overwrite)
    made = voxgran.simplify(voxgran.load_shape(options.file, repair=options.repair), faces=options.faces)
    if options.output:
        voxgran.save_shape(made.shape, options.output, overwrite=options.overwrite)
    names = ("faces_before", "faces", "volume_change", "area_change", "mean_distance", "largest_distance")
    numbers = {name: getattr(made, name) for name in names}
    show({**numbers, "diameter": made.shape.diameter, "mended": list(made.sentences)}, options)


def _many(options: argparse.Namespace, given: dict[str, Any]) -> None:
    """Make many shapes; write each to a file of the folder, and the table of all."""
    folder = None if options.output is None else _folder(options)
    seeds = voxgran.seeds_of_shapes(options.seed, options.count)
    shapes = []
    with progress(options) as on_step:
        for k, seed in enumerate(seeds):
            if on_step is not None:
                on_step(Step(stage="shapes", done=k, total=len(seeds), text=""))
            shapes.append(voxgran.make_shape(options.family, seed=seed, **given))
    form = voxgran.describe(shapes)
    written = []
    if folder is not None:
        refuse_links(made_folder(folder), *folder.glob("*"))
        digits = len(str(options.count - 1))
        files = [f"{options.family}_{k:0{digits}}.{options.format or 'stl'}" for k in range(len(shapes))]
        for made, file in zip(shapes, files, strict=True):
            voxgran.save_shape(made, folder / file, overwrite=options.overwrite)
        columns = {"file": files, "seed": seeds, **{str(name): values.values for name, values in form.items()}}
        write_text(folder / TABLE, _csv(columns), overwrite=options.overwrite)
        written = [str(folder)]
        _tell_of_others(folder, files)
    if options.gallery and shapes:
        voxgran.save_gallery(shapes, options.gallery, overwrite=options.overwrite)
        written.append(str(options.gallery))
    means = {f"mean_{name}": float(values.mean()) for name, values in form.items() if len(shapes)}
    show({"shapes": len(shapes), **means}, options, ", ".join(written))


def _folder(options: argparse.Namespace) -> Path:
    """Return the folder for many shapes.

    Raises
    ------
    InputError
        If a file is named in its place.
    OutputExistsError
        If it holds something that is not to be replaced.
    """
    folder = Path(options.output)
    if folder.suffix.lower() in WRITERS or folder.is_file():
        raise InputError(
            f"--output is {folder} and --count is {options.count}: many shapes are written to a folder; name one, and "
            "the kind of files with --format"
        )
    if not options.overwrite and folder.is_dir() and any(folder.iterdir()):
        raise OutputExistsError(f"{folder} is not empty: name another folder, or ask with --overwrite")
    return folder


def _tell_of_others(folder: Path, files: list[str]) -> None:
    """Warn of other shapes in a folder, which may be those of an earlier call."""
    others = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in WRITERS and path.name not in files)
    if others:
        warn(f"{folder} holds {len(others)} other shapes, such as {others[0]}, which {TABLE} does not list: they stay")


def _csv(columns: dict[str, Any]) -> str:
    """Return a table as text; numbers keep all digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(map(str, values) for values in columns.values()), strict=True))
    return text.getvalue()
