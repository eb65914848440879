"""Data files of MercuryDPM, in: for each time a line with the number of particles, the time and the bounds of the box,
and one line for each particle.

References
----------
Format: docs.mercurydpm.org, ``DPMBase::outputXBallsData``.
"""

import re
from pathlib import Path

import numpy as np

from voxgran._base.axes import Periodic
from voxgran._base.errors import FileFormatError
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.io.particles import Particles, box_of, frame_of, numbers_of, refuse_bad_spheres, text_lines

#: numbers of the first line, and of a particle, with the place of its radius, by dimension
WIDTHS = {3: (8, 14, 6), 2: (6, 8, 4)}


def is_mercury(head: str) -> bool:
    """Return whether a text begins as a data file of MercuryDPM does."""
    return _dimension(head.splitlines()[:2]) is not None


def _dimension(lines: list[str]) -> int | None:
    """Return the dimension of a file by its first two lines; None for a file of another format."""
    first, second = ([*(line.split() for line in lines), [], []])[:2]
    if not first or not re.fullmatch(r"[1-9]\d*", first[0]):
        return None
    return next((d for d, (head, row, _) in WIDTHS.items() if (len(first), len(second)) == (head, row)), None)


def read_mercury(path: Path, *, frame: int = -1) -> Particles:
    """Read spheres, or disks, from one time of a data file of MercuryDPM, which does not say whether its box is
    periodic.

    Raises
    ------
    FileFormatError
        If there is no such time, it is cut off, or a line is wrong.
    """
    lines = text_lines(path, "a data file of MercuryDPM")
    dimension = _dimension(lines[:2]) or 3
    wide, width, size = WIDTHS[dimension]
    starts, begin = [], 0
    while begin < len(lines):
        count = numbers_of([lines[begin].split()], [begin + 1], path, width=wide)[0, 0]
        if not (0 <= count == np.rint(count) and begin + 1 + count <= len(lines)):
            raise FileFormatError(
                f"{path} has {len(lines) - begin - 1} lines of particles behind line {begin + 1}, which says "
                f"{count:g}: it is cut off; choose an earlier frame or write it again"
            )
        starts.append(begin)
        begin += 1 + int(count)
    start = starts[frame_of(len(starts), frame, path)]
    head = numbers_of([lines[start].split()], [start + 1], path, width=wide)[0]
    rows, count = [line.split() for line in lines[start + 1 : start + 1 + int(head[0])]], int(head[0])
    table = numbers_of(rows, list(range(start + 2, start + 2 + count)), path, width=width)
    centers, radii = np.zeros((count, 3)), table[:, size]
    centers[:, :dimension] = table[:, :dimension]
    refuse_bad_spheres(centers, radii, path, row="particle")
    bounds = head[2:].reshape(2, dimension).T
    assumed = {"periodic": "nowhere: a data file does not say"}
    if len(starts) > 1:
        assumed["frame"] = f"time {head[1]:g}, one of {len(starts)}"
    nowhere: Periodic = ""
    box = box_of(bounds if dimension == 3 else np.vstack([bounds, (0.0, 1.0)]), nowhere, path)
    (x, y, _), (left, low, _) = box.lengths, box.origin
    return Particles(
        centers=centers,
        radii=radii,
        container=box if dimension == 3 else Rectangle((x, y), origin=(left, low)),
        assumed=assumed,
        flat=dimension == 2,
    )
