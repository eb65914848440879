"""Snapshots of a run as a series for ParaView: one packing file each, and a ``.pvd`` file that lists them by time.

Time is the number of attempts. How many a run makes is not known before; therefore it starts with close snapshots, and
whenever there are too many every second one is removed and the distance doubled, so that a run of any length leaves
between half the number asked for and that number, evenly spaced, and never more files.
"""

import contextlib
import os
import re
import xml.etree.ElementTree as ET
from pathlib import Path

from voxgran._base.arrays import as_count
from voxgran._base.calls import explained, explained_methods
from voxgran._base.errors import FileFormatError, OutputError
from voxgran._base.files import as_path, output_suffix, refuse_links, refuse_to_replace, remove_drafts_in, write_text
from voxgran.io.vtk_files import has_seal, save_packing
from voxgran.packing.model import Packing, check_packing


@explained_methods
class Series:
    """Snapshots in a folder, and their list beside it.

    Parameters
    ----------
    path : path-like
        The ``.pvd`` file; snapshots stand in the folder of the same name without the suffix.
    max_snapshots : int
        How many snapshots are kept, at least 2.
    every : int
        Attempts between the first snapshots.
    resume : bool
        Whether to go on with what the file lists; else the series is started anew.
    overwrite : bool
        Whether a series that is there may be replaced by a new one: its list and its snapshots.

    Raises
    ------
    InputError
        If `max_snapshots` is below 2 or `every` below 1.
    FileFormatError
        If the suffix is not ``.pvd``, or the file that is to be continued is damaged.
    OutputExistsError
        If the file or snapshots of it are there and neither `resume` nor `overwrite` is set.
    OutputError
        If the folder of the snapshots is a link to another place, or holds one.

    Examples
    --------
    >>> import voxgran as vg
    >>> series = vg.Series("run.pvd", every=100)
    >>> series.record(vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5), 100)
    >>> series.times, series.due(100)
    ([100], 200)
    """

    @explained(hint='Series("run.pvd")')
    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        max_snapshots: int = 20,
        every: int = 1000,
        resume: bool = False,
        overwrite: bool = False,
    ) -> None:
        output_suffix(path, [".pvd"], "series are kept")
        self.path = as_path(path)
        self.folder = self.path.with_suffix("")
        self.max_snapshots = as_count(max_snapshots, "max_snapshots", at_least=2)
        self.every = as_count(every, "every", at_least=1)
        self.times: list[int] = []
        refuse_links(self.path.parent, self.folder)
        refuse_links(self.folder, *self.folder.glob("*"))
        if resume or overwrite:
            remove_drafts_in(self.folder)
        if resume and self.path.is_file():
            self.times = listed_times(self.path)
            self.every = self.times[0] if self.times else self.every
            return
        snapshots = sorted(self.folder.glob("snapshot_*.vtp"))
        if not (resume or overwrite):
            refuse_to_replace(self.path, *snapshots)
        for left in snapshots:
            _remove(left)

    def due(self, done: int) -> int:
        """Return after how many attempts the next snapshot is due.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Series("run.pvd", every=100).due(150)
        200
        """
        return (as_count(done, "done") // self.every + 1) * self.every

    def record(self, packing: Packing, done: int) -> None:
        """Write a snapshot and list it.

        Parameters
        ----------
        packing : Packing
            The grains as they are now.
        done : int
            Attempts so far.

        Raises
        ------
        InputError
            If it is no packing, or `done` no whole number of at least 0.
        OutputError
            If it cannot be written; the list before is untouched.

        Examples
        --------
        >>> import voxgran as vg
        >>> series = vg.Series("run.pvd", every=100)
        >>> series.record(vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=5), 100)
        >>> series.path.read_text().count("<DataSet")
        1
        """
        check_packing(packing, "packing")
        done = as_count(done, "done")
        before, is_new = (self.times, self.every), not self._file(done).exists()
        save_packing(packing, self._file(done), overwrite=True)
        self.times = sorted({*self.times, done})
        # the end of a run falls between two regular times, and stays
        last, gone = done if done % self.every else 0, []
        while len(self.times) > self.max_snapshots:
            self.every *= 2
            gone += [time for time in self.times if time % self.every and time != last]
            self.times = [time for time in self.times if not time % self.every or time == last]
        try:
            self._list()
        except OutputError:
            self.times, self.every = before
            if is_new:
                _remove(self._file(done))
            raise
        for time in gone:
            _remove(self._file(time))

    def _file(self, done: int) -> Path:
        """Return the file of a snapshot."""
        return self.folder / f"snapshot_{done:015d}.vtp"

    def _list(self) -> None:
        """Write the list."""
        root = ET.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
        collection = ET.SubElement(root, "Collection")
        for time in self.times:
            file = f"{self.folder.name}/{self._file(time).name}"
            ET.SubElement(collection, "DataSet", timestep=str(time), group="", part="0", file=file)
        ET.indent(root)
        write_text(self.path, ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n")


def _remove(path: Path) -> None:
    """Remove a snapshot, if it is there; any other file stays."""
    with contextlib.suppress(OSError):
        if re.fullmatch(r"snapshot_\d{15}\.vtp", path.name) and has_seal(path):
            path.unlink()


def listed_times(path: str | os.PathLike[str]) -> list[int]:
    """Return the attempts after which the snapshots of a ``.pvd`` file were taken.

    Raises
    ------
    FileFormatError
        If it is no list of snapshots.
    """
    try:
        entries = ET.parse(path).getroot().iter("DataSet")
        times = sorted(int(entry.attrib["timestep"]) for entry in entries)
    except (ET.ParseError, KeyError, ValueError, OSError) as error:
        raise FileFormatError(f"{path} is no list of snapshots ({error}): remove it and run again") from error
    if times and times[0] < 1:
        raise FileFormatError(f"{path} is no list of snapshots (after {times[0]} attempts): remove it and run again")
    return times
