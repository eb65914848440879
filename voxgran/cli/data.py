"""Command that copies a file that comes with the package."""

import argparse

import voxgran
from voxgran._base.files import written_whole
from voxgran.cli.terminal import show


def data(options: argparse.Namespace) -> None:
    """Copy a file that comes with voxgran, and say where the copy is."""
    source, target = voxgran.data_file(options.name), options.output or options.name
    with written_whole(target, overwrite=options.overwrite) as draft:
        draft.write_bytes(source.read_bytes())
    show({"file": str(target), "bytes": source.stat().st_size}, options)
