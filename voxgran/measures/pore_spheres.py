"""Pore sizes between spheres or disks, and walls in closed form, whose distances are known exactly.

The sphere about a voxel of the ridge of the pores gets the place and the radius of the largest sphere of pores whose
center lies in the voxel, by a search of ever shorter steps. A wide pore has its diameter, wherever the lattice lies.
"""

import math
from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.compiling.threads import in_blocks, using_threads
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.containers.kernel_container import KernelContainer, clearance, kernel_container
from voxgran.containers.model import UNKNOWN, boundary_of, periods_of
from voxgran.geometry.sphere_pairs import spheres_near
from voxgran.lattice.distance import distance_transform
from voxgran.lattice.thickness import cover, ridge
from voxgran.measures.crossings import spheres_of
from voxgran.packing.model import Packing

#: points whose spheres are in memory at a time
POINTS = 2**15
#: times the step of the search in a voxel, at first half its edge, is divided by four
FINER = 2
#: points of which a thread takes no fewer
LEAST_POINTS = 2**10


@dataclass(frozen=True, eq=False)
class Bodies:
    """Spheres and walls around the pores."""

    centers: Floats  # (n, 3)
    radii: Floats  # (n,)
    walls: KernelContainer
    lower: Floats  # (3,) corner of the container
    periods: Floats  # (3, 3) vectors by which it repeats

    @classmethod
    def of(cls, packing: Packing) -> "Bodies | None":
        """Return those of a packing; None where grains or walls have other forms."""
        container = packing.container
        boundary = boundary_of(container)
        parts = [spheres_of(packing, int(index)) for index in np.unique(packing.shape_id)]
        if boundary.solid is not None or boundary is UNKNOWN or any(part is None for part in parts):
            return None
        known = [part for part in parts if part is not None]
        centers = np.concatenate([np.zeros((0, 3)), *(one for one, _ in known)])
        radii = np.concatenate([np.zeros(0), *(one for _, one in known)])
        walls = kernel_container(container)
        # a sphere of pores may meet its own image
        walls = walls._replace(shortest=math.inf)
        return cls(centers, radii, walls, np.array(container.bounds[0]), periods_of(container))

    def largest_near(self, places: Floats, reach: Floats, edge: float) -> Floats:
        """Return centers and radii (n, 4) of the largest spheres of pores with centers in the voxels about places.

        `reach` (n,) is at least the radius of the largest sphere about a place.
        """
        found = np.empty((len(places), 4))
        for begin in range(0, len(places), POINTS):
            part = slice(begin, begin + POINTS)
            # to a corner of the voxel the distance and the radius change by half a diagonal each; voxels may miss the
            # length of a period by half of one
            far = reach[part] + (math.sqrt(3.0) + 0.5) * edge
            known = {"lower": self.lower, "periods": self.periods}
            point, body, image = spheres_near(places[part], far, self.centers, self.radii, **known)
            near = np.column_stack([self.centers[body] + image @ self.periods, self.radii[body]])
            starts = np.searchsorted(point, np.arange(len(far) + 1))
            arguments = self.walls, places[part], edge / 2, near, starts, found[part]
            in_blocks(_climb, len(far), *arguments, least=LEAST_POINTS)
        return found

    def sizes(self, mask: Booleans, origin: Floats, edge: float, around: tuple[bool, bool, bool]) -> Floats:
        """Return the diameter of the largest sphere of pores that covers each voxel of a mask, 0 outside of it.

        A voxel that no sphere covers has that of the largest sphere with its center in the voxel.
        """
        squares = distance_transform(mask, periodic=around, squared=True)

        def spheres(voxels: Integers) -> Floats:
            places = (np.stack(np.unravel_index(voxels, mask.shape), axis=1) + 0.5) * edge + origin
            places[:, self.walls.dimension :] = 0.0
            return self.largest_near(places, np.sqrt(squares.ravel()[voxels]) * edge, edge)

        with using_threads(None):
            known = spheres(np.flatnonzero(ridge(squares, around)))
            scaled = np.column_stack([(known[:, :3] - origin) / edge - 0.5, (known[:, 3] / edge) ** 2])
            scaled[:, self.walls.dimension : 3] = 0.0
            found = 2.0 * edge * np.sqrt(cover(mask, scaled, around))
            missed = np.flatnonzero(mask & (found == 0.0))
            found.ravel()[missed] = 2.0 * spheres(missed)[:, 3]
        return found


@kernel
def _climb(walls, places, half, near, starts, found, begin, end):  # type: ignore[no-untyped-def]
    """Write centers and radii of the largest spheres with centers in cubes about some places.

    Spheres `near[starts[p]]` to `near[starts[p + 1]]` are those around place p.
    """
    deep = 1 if walls.dimension == 3 else 0
    for p in range(begin, end):
        x, y, z = places[p]
        around = near[starts[p] : starts[p + 1]]
        wall, best, step, left = clearance(walls, x, y, z), _room(walls, False, around, -np.inf, x, y, z), half, FINER
        # in the voxel both change by less than 2 half edges
        walled, best = wall < best + 4 * half, min(wall, best)
        while left >= 0:
            u, v, w, before = x, y, z, best
            for i in range(-1, 2):
                for j in range(-1, 2):
                    for k in range(-deep, deep + 1):
                        a = min(max(u + i * step, places[p, 0] - half), places[p, 0] + half)
                        b = min(max(v + j * step, places[p, 1] - half), places[p, 1] + half)
                        c = min(max(w + k * step, places[p, 2] - half), places[p, 2] + half)
                        room = _room(walls, walled, around, best, a, b, c)
                        if room > best:
                            x, y, z, best = a, b, c, room
            if best <= before + 1e-6 * half:
                step, left = step / 4, left - 1
        found[p, 0], found[p, 1], found[p, 2], found[p, 3] = x, y, z, max(best, 0.0)


@bare_kernel
def _room(walls, walled, near, least, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance of a point from the nearest sphere or, if asked for, wall; negative inside of one.

    What is not above `least` need not be the nearest one.
    """
    room = clearance(walls, x, y, z) if walled else np.inf
    for s in range(len(near)):
        dx, dy, dz = x - near[s, 0], y - near[s, 1], z - near[s, 2]
        square, reach = dx * dx + dy * dy + dz * dz, room + near[s, 3]
        if square < reach * reach:
            room = np.sqrt(square) - near[s, 3]
        if room <= least:
            break
    return room
