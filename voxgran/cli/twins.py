"""Command that makes a twin of a sample."""

import argparse
from pathlib import Path

import voxgran
from voxgran._base.files import refuse_to_replace
from voxgran.cli.terminal import show
from voxgran.packing.model import Packing
from voxgran.scene.twins.page import written

#: files of the directory, beside one packing more for each further seed
FILES = ("twin.vtp", "shapes.nc", "comparison.nc", "twin.html", "twin.json")


def twin(options: argparse.Namespace, sample: Packing) -> None:
    """Make a twin of a sample, and write its packings, the learnt shapes, the comparison and the page.

    Raises
    ------
    OutputExistsError
        If a file is there and is not to be replaced.
    """
    out, several = Path(options.output), range(1, options.seeds or 1)
    further = [f"twin_{options.seed + k}.vtp" for k in several]
    if not options.overwrite:
        refuse_to_replace(*(out / name for name in (*FILES, *further)))
    names = ("count", "solid_fraction", "protocol", "faces", "forms", "voxel_size", "seed", "seeds")
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    found = voxgran.twin(sample, **given)
    out.mkdir(parents=True, exist_ok=True)
    for name, packing in zip(("twin.vtp", *further), found.packings, strict=True):
        voxgran.save(packing, out / name, overwrite=True)
    numbers = written(found, out)
    told = f"the largest difference is that of: {numbers.pop('largest_difference')}; open {out / 'twin.html'}"
    show(numbers, options, told)
