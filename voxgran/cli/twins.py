"""Command that makes a twin of a sample."""

import argparse
from pathlib import Path

import numpy as np

import voxgran
from voxgran._base.files import refuse_to_replace
from voxgran._base.lazy import load
from voxgran.cli.terminal import show
from voxgran.packing.model import Packing

#: files of the directory
FILES = ("twin.vtp", "shapes.nc", "comparison.nc", "twin.html", "twin.json")


def twin(options: argparse.Namespace, sample: Packing) -> None:
    """Make a twin of a sample, and write its packing, the learnt shapes, the comparison and the page.

    Raises
    ------
    OutputExistsError
        If a file is there and is not to be replaced.
    """
    out = Path(options.output)
    if not options.overwrite:
        refuse_to_replace(*(out / name for name in FILES))
    names = ("count", "solid_fraction", "protocol", "faces", "forms", "voxel_size", "seed", "seeds")
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    found = voxgran.twin(sample, **given)
    data = found.comparison
    out.mkdir(parents=True, exist_ok=True)
    voxgran.save(found.packing, out / "twin.vtp", overwrite=True)
    if found.model is not None:
        found.model.save(out / "shapes.nc", overwrite=True)
    voxgran.save_statistics(load("xarray").DataTree(dataset=data), out / "comparison.nc", overwrite=True)
    found.report(out / "twin.html", overwrite=True)
    ratios = np.nan_to_num(np.abs(data["ratio"].values))
    numbers = {"grains": found.packing.count, "sample_solid_fraction": found.sample.solid_fraction}
    numbers |= {
        "solid_fraction": float(data["twin"].sel(measure="solid_fraction")),
        "largest_ratio": float(ratios.max()),
    }
    name = str(data["text"].values[int(ratios.argmax())])
    show(numbers, options, f"the largest difference is that of: {name}; open {out / 'twin.html'}")
