"""Command that fits a clump of spheres to a shape."""

import argparse

import voxgran
from voxgran._base.config import parameters_of
from voxgran._base.files import refuse_to_replace
from voxgran.cli.terminal import show
from voxgran.clumps.method import clump_registry
from voxgran.report.stage import check_picture_path
from voxgran.shapes.formats.sphere_files import clump_suffix

#: what the errors of a clump are relative to
UNITS = {
    **dict.fromkeys(("volume", "inertia"), "of that of the solid"),
    **dict.fromkeys(("centroid", "surface_mean", "surface_max"), "of the equivalent diameter"),
}


def clump(options: argparse.Namespace) -> None:
    """Fit a clump of spheres to a mesh file, and write its spheres and a picture."""
    from voxgran.shapes.files import shape_of_file
    from voxgran.shapes.repairing.diagnose import Remedies

    remedies = Remedies(
        mend="use 'voxgran repair'", keep_open="", choose="choose with 'voxgran repair --bodies largest'"
    )
    body = shape_of_file(options.file, remedies=remedies)
    if options.picture:
        check_picture_path(options.picture, overwrite=options.overwrite)
    if options.output:
        clump_suffix(options.output)
    if options.output and not options.overwrite:
        refuse_to_replace(options.output)
    settings = clump_registry().get(options.method).parameters
    given = {item.name: getattr(options, item.name) for item in parameters_of(settings)}
    made = voxgran.fit_clump(
        body,
        method=options.method,
        max_spheres=options.max_spheres,
        target=options.target,
        value=options.value,
        seed=options.seed,
        **{name: value for name, value in given.items() if value is not None},
    )
    if options.output:
        made.save(options.output, overwrite=options.overwrite)
    if options.picture:
        voxgran.save_clump_picture(made, options.picture, overwrite=options.overwrite)
    written = ", ".join(str(path) for path in (options.output, options.picture) if path)
    why = {"reason": made.reason} if made.reason else {}
    show({"spheres": made.count, **made.errors.to_mapping(), **why}, options, written, UNITS)
