"""Spreading: grains are moved, not rotated, by the least translations that leave a gap between all true shapes."""

from dataclasses import replace

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.contacts.assembly import Assembly
from voxgran.containers.model import UNKNOWN, boundary_of
from voxgran.settling.bed import Bed
from voxgran.settling.parting import part_grains

#: most rounds, and the share of the gap that may be missed
ROUNDS, CLOSE = 40, 0.02


def spread(assembly: Assembly, room: float, up: Floats) -> Assembly:
    """Return the grains moved, where there is space, until their surfaces are some distance apart; they may overlap.

    `room` is the wanted distance of surfaces from each other and from walls, above 0, and `up` the direction along
    which grains are numbered. Orientations do not change. Where there is no space, gaps are left that are less. Open
    surfaces, and grains in containers whose walls are not known, stay where they are.
    """
    if any(shape.is_open for shape in assembly.shapes) or boundary_of(assembly.container) is UNKNOWN:
        return assembly
    bed = Bed(replace(assembly, lid=None), -np.asarray(up, dtype=np.float64), exact=True)
    bed.bodies[:, 7] = 0.0
    part_grains(bed, room, ROUNDS, missed=CLOSE, most=room)
    return replace(assembly, position=bed.poses()[0])
