"""Commands on images: what they hold, and packings of their labels."""

import argparse
from typing import Any

import numpy as np

import voxgran
from voxgran._base.errors import InputError
from voxgran.cli.terminal import progress, show
from voxgran.io.files import check_output
from voxgran.lattice.image import Image
from voxgran.measures.registered.density import main_numbers
from voxgran.shapes.images.labels import image_of, is_grey

#: most voxels that are read to say what values an image has
MOST_READ = 2**28


def opened(options: argparse.Namespace) -> Image:
    """Return the image in a file; where there is a cluster, in blocks that it computes."""
    header = {"shape": options.shape, "dtype": options.dtype}
    if getattr(options, "dask", None) is None:
        return image_of(options.file, options.key, **header)
    return voxgran.open_image(options.file, key=options.key, dask=options.dask, **header)


def labels(options: argparse.Namespace) -> None:
    """Make a packing of a label image and write it."""
    if options.output:
        check_output(options.output, overwrite=options.overwrite)
    given = {
        name: getattr(options, name)
        for name in ("voxel_size", "border", "surface", "smoothing", "periodic", "gravity", "unit")
    }
    smallest: dict[str, Any] = {} if options.min_size is None else {"min_size": options.min_size}
    source: Any = opened(options)
    if options.segment:
        source = voxgran.segment(source, voxel_size=options.voxel_size, **smallest)
    with progress(options) as on_step:
        packing = voxgran.packing_of_labels(source, on_step=on_step, **given, **smallest)
    if options.output:
        voxgran.save(packing, options.output, overwrite=options.overwrite)
    numbers = {"grains": packing.count, **main_numbers(packing)}
    show({**numbers, "largest_volume_error": packing.provenance["largest_volume_error"]}, options)


def info(options: argparse.Namespace) -> None:
    """Say what an image holds: voxels, lengths, values, and labels where it has them.

    Raises
    ------
    InputError
        If the image has not three axes.
    """
    image = opened(options)
    values: Any = image.values
    if values.ndim != 3 or not values.size:
        raise InputError(
            f"{options.file} has the shape {values.shape}: three axes with voxels are needed; stack slices"
        )
    size = image.voxel_size
    numbers: dict[str, Any] = {
        "voxels": " x ".join(map(str, values.shape)),
        "type": str(values.dtype),
        "voxel_size": "not in the file: give --voxel-size" if size is None else list(size),
        "unit": image.unit or "not in the file",
        "lengths": None if size is None else [n * edge for n, edge in zip(values.shape, size, strict=True)],
    }
    if values.size > MOST_READ:
        numbers["values"] = f"not read, since they are more than {MOST_READ}"
        show({name: value for name, value in numbers.items() if value is not None}, options)
        return
    numbers |= {"least": np.asarray(values.min()).item(), "greatest": np.asarray(values.max()).item()}
    if values.dtype.kind not in "bui" or numbers["least"] < 0 or is_grey(values):
        numbers["values"] = "grey values: make labels of them with voxgran segment"
    else:
        table = voxgran.label_table(image, voxel_size=1.0 if size is None else None)
        share = float(table.voxels.sum()) / values.size
        numbers |= {"values": "labels", "labels": table.sizes["label"], "share_of_labels": share}
        numbers["cut_by_border"] = int(table.touches_border.sum())
    show({name: value for name, value in numbers.items() if value is not None}, options)
