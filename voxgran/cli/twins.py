"""Command that makes a twin of a sample."""

import argparse

import voxgran
from voxgran._base.arrays import as_count
from voxgran._base.checkpoint import remove_checkpoint
from voxgran._base.files import as_path, refuse_links
from voxgran.cli.settling import begin
from voxgran.cli.terminal import progress, show
from voxgran.packing.model import Packing
from voxgran.scene.run import CHECKPOINT
from voxgran.scene.twins.page import written
from voxgran.scene.twins.twin import MOST_SEEDS, checkpoints_of

#: files of the directory, beside one packing more for each further seed
FILES = ("twin.vtp", "shapes.nc", "comparison.nc", "twin.html", "twin.json")


def twin(options: argparse.Namespace, sample: Packing) -> None:
    """Make a twin of a sample in a run with checkpoints, and write its packings, the learned shapes, the comparison and
    the page.

    Raises
    ------
    OutputExistsError
        If a file, or the checkpoint of an interrupted run, is there and is not to be replaced.
    OutputError
        If a link in the folder leads to another place.
    """
    out, seeds = as_path(options.output), 1 if options.seeds is None else options.seeds
    refuse_links(out, *out.glob("*"))
    many = as_count(seeds, "seeds", at_least=1, at_most=MOST_SEEDS)
    further = [f"twin_{options.seed + k}.vtp" for k in range(1, many)]
    checkpoints = checkpoints_of(out / CHECKPOINT, many)
    begin(options, [out / name for name in (*FILES, *further)], checkpoints)
    names = ("count", "solid_fraction", "protocol", "faces", "forms", "voxel_size", "seed", "seeds")
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    with progress(options) as on_step:
        found = voxgran.twin(sample, checkpoint=checkpoints[0], resume=options.resume, on_step=on_step, **given)
        for name, packing in zip(("twin.vtp", *further), found.packings, strict=True):
            voxgran.save(packing, out / name, overwrite=True)
        numbers = written(found, out, on_step=on_step)
    for path in checkpoints:
        remove_checkpoint(path)
    told = f"the largest difference is that of: {numbers.pop('largest_difference')}; open {out / 'twin.html'}"
    show(numbers, options, told)
