"""Command that writes a picture of a packing."""

import argparse
from pathlib import Path

import voxgran
from voxgran.cli.terminal import loaded
from voxgran.report.stage import as_window, check_picture_path


def picture(options: argparse.Namespace) -> None:
    """Write a picture of a packing, which is loaded once it is known where the picture may be written."""
    target = Path(options.output or Path(options.file).with_suffix(".png"))
    check_picture_path(target, overwrite=options.overwrite)
    given = {name: getattr(options, name) for name in ("color_by", "cut", "legend", "overwrite")}
    voxgran.save_picture(loaded(options), target, window=as_window(options.window), **given)
    print(target)
