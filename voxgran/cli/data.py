"""Command that lists the files that come with the package, or copies one."""

import argparse

import voxgran
from voxgran._base.errors import InputError, shown
from voxgran._base.files import written_whole
from voxgran.cli.terminal import entry_line, show
from voxgran.io.data_files import installed_data_files


def data(options: argparse.Namespace) -> None:
    """Copy a file that comes with voxgran, and say where the copy is; without a name, list the files.

    Raises
    ------
    InputError
        If an output is given without a name.
    """
    if options.name is None:
        if options.output:
            names = ", ".join(installed_data_files())
            where = shown(options.output)
            raise InputError(f"-o {where} is given without a name: name the file to copy; one of {names}")
        if options.json:
            show(installed_data_files(), options)
        else:
            for name, about in installed_data_files().items():
                entry_line(name, about)
        return
    source, target = voxgran.data_file(options.name), options.output or options.name
    with written_whole(target, overwrite=options.overwrite) as draft:
        draft.write_bytes(source.read_bytes())
    show({"file": str(target), "bytes": source.stat().st_size}, options)
