"""The pore space of a packing as voxels: between the grains, within the walls and below the surface of a bed.

Between spheres or disks, and walls in closed form, pore sizes come from exact distances. The sphere about a voxel of
the ridge of the pores gets the place and the radius of the largest sphere of pores whose center lies in the voxel, by a
search of ever shorter steps. A wide pore has its diameter, wherever the lattice lies.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.compiling.threads import in_blocks, using_threads
from voxgran._base.errors import TooLargeError
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.containers.kernel_container import KernelContainer, clearance, kernel_container
from voxgran.containers.model import UNKNOWN, boundary_of, periods_of, refuse_tilt
from voxgran.geometry.sphere_pairs import spheres_near
from voxgran.lattice.distance import distance_transform
from voxgran.lattice.grid import Grid
from voxgran.lattice.label import percolating
from voxgran.lattice.thickness import cover, local_thickness, ridge
from voxgran.measures.crossings import spheres_of
from voxgran.measures.painting import labels_on
from voxgran.measures.region import Regions, gravity_of
from voxgran.packing.model import Packing
from voxgran.shapes.mesh import Mesh
from voxgran.voxels.occupy import occupy

#: voxels of the pore space at the most
MOST_VOXELS = 2**31
#: tries for a voxel size that divides all periodic lengths
TRIES = 200
#: layer above the surface of a bed whose grains limit the pores below, in mean diameters
MARGIN = 1.0


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
            near = np.column_stack([self.centers[body] + linear.matmul(image, self.periods), self.radii[body]])
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


@dataclass(frozen=True, eq=False)
class Pores:
    """Voxels of the pore space of a region of the container."""

    mask: Booleans  # (nx, ny, nz) whether the center of a voxel lies in the pore space; in 2D nz = 1
    room: Booleans  # (nx, ny, nz) whether it lies in the container
    voxel_size: float
    dimension: int
    periodic: tuple[bool, bool, bool]
    # the axis of the free surface of a bed, the index of the first voxel and that after the last one below it; None
    # where the region is the whole container
    surface: tuple[int, int, int] | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)  # lower corner of the image
    bodies: Bodies | None = None  # what is around the pores, where its distance is known exactly

    @property
    def below(self) -> "Pores":
        """The part below the free surface of a bed."""
        return Pores(self.mask[self._kept], self.room[self._kept], self.voxel_size, self.dimension, self.periodic)

    @property
    def _kept(self) -> tuple[slice, ...]:
        """Where the part below the free surface lies."""
        axis, first, last = self.surface or (0, 0, self.mask.shape[0])
        return tuple(slice(first, last) if k == axis else slice(None) for k in range(3))

    @property
    def porosity(self) -> float:
        """Share of the pores in the region."""
        part = self.below
        return float(part.mask.sum()) / max(int(part.room.sum()), 1)

    def sizes(self) -> NDArray[np.float64]:
        """Return the local thickness (n,) at each voxel of the pores below the surface, in the unit of lengths.

        It is the diameter of the largest sphere of pores that covers the center of the voxel; walls limit spheres, as
        grains do. Between spheres, disks and walls in closed form the radii are those of the true shapes, for centers
        anywhere in voxels; otherwise those of the image. It is empty where nothing limits them.
        """
        padded, inner = self._walled()
        if padded.all() or not padded.any():
            return np.zeros(0)
        if self.bodies is None:
            found = local_thickness(padded, periodic=self.periodic).astype(np.float64) * self.voxel_size
        else:
            corner = np.array(self.origin) - [part.start * self.voxel_size for part in inner]
            found = self.bodies.sizes(padded, corner, self.voxel_size, self.periodic)
        return np.asarray(found[inner][self._kept][self.below.mask])

    @property
    def widest(self) -> float:
        """Diameter in voxels of the largest sphere of pores; 0 without any, infinite where nothing limits it."""
        return 2.0 * float(distance_transform(self._walled()[0], periodic=self.periodic).max(initial=0.0))

    def _walled(self) -> tuple[Booleans, tuple[slice, ...]]:
        """Return the image within walls, a layer of voxels that are no pores, and where the image lies in it."""
        walled = [not around and k < self.dimension for k, around in enumerate(self.periodic)]
        ends = [(int(wall), int(wall)) for wall in walled]
        if self.surface is not None:
            # the side of the free surface is no wall
            lead = int(self.surface[1] > 0)
            ends[self.surface[0]] = (1 - lead, lead)
        padded = np.pad(self.mask, ends)
        return padded, tuple(slice(low, n - high) for (low, high), n in zip(ends, padded.shape, strict=True))

    def percolating(self, axis: int) -> float:
        """Return the share of the pores in bodies that connect the two sides across an axis; NaN without pores.

        Voxels are connected through faces, and across the faces of other periodic axes.
        """
        part = self.below
        total = int(part.mask.sum())
        if not total:
            return math.nan
        sides = [around and k != axis for k, around in enumerate(self.periodic)]
        return float(percolating(part.mask, axis, periodic=sides, region=part.room).sum()) / total


def pores_of(packing: Packing, voxel_size: float) -> Pores:
    """Return the pores of a packing; the voxels are at most as large as `voxel_size`, about where axes are periodic.

    Raises
    ------
    InputError
        If a grain is an open surface, or the container is tilted.
    TooLargeError
        If there are more than 2**31 voxels.
    """
    container, d = packing.container, packing.dimension
    refuse_tilt(container, "the pore space", "measure it in an upright one")
    lower, upper = container.bounds
    periodic = tuple(bool(around) and k < d for k, around in enumerate(container.periodic))
    size = commensurate(voxel_size, (upper - lower)[list(periodic)])
    start, end, surface = lower.copy(), upper.copy(), None
    gravity = gravity_of(packing)
    if gravity is not None and packing.count:
        axis, sign = gravity
        margin = MARGIN * float(packing.diameters.mean())
        height = Regions(packing).limits[1 if sign < 0 else 0, axis]
        if sign < 0:
            end[axis] = min(end[axis], height + margin)
            surface = (axis, 0, max(1, round((height - lower[axis]) / size)))
        else:
            start[axis] = max(start[axis], height - margin)
            surface = (axis, round((height - start[axis]) / size), -1)
    counts = np.maximum(np.where(periodic, np.rint((end - start) / size), np.ceil((end - start) / size - 1e-9)), 1)
    if d == 2:
        counts[2] = 1
    if float(np.prod(counts)) > MOST_VOXELS:
        raise TooLargeError(
            f"voxel_size is {size:.4g}: the pore space would take {float(np.prod(counts)):.3g} voxels, at most "
            f"{MOST_VOXELS:.3g} fit; take larger voxels"
        )
    if surface is not None and surface[2] < 0:
        # voxels lie at the wall, which is the upper end
        start[surface[0]] = end[surface[0]] - counts[surface[0]] * size
        surface = (surface[0], max(1, min(surface[1], int(counts[surface[0]]) - 1)), int(counts[surface[0]]))
    grid = Grid(tuple(float(value) for value in start), size, tuple(int(n) for n in counts))  # type: ignore[arg-type]
    room = _room(packing, grid)
    mask = room & (labels_on(packing, start, np.full(3, size), grid.shape) == 0)
    return Pores(mask, room, size, d, periodic, surface, grid.origin, Bodies.of(packing))  # type: ignore[arg-type]


def commensurate(size: float, lengths: Floats) -> float:
    """Return the voxel size near to one that divides all periodic lengths best, by at most a tenth smaller."""
    if not len(lengths):
        return size
    longest = float(lengths.max())
    least = max(1, math.ceil(longest / size - 1e-9))
    tries = longest / (least + np.arange(min(TRIES, least // 10 + 1)))
    exact = np.asarray(lengths)[None] / tries[:, None]
    missed = np.abs(exact - np.maximum(np.rint(exact), 1)).max(axis=1)
    # the largest voxels of those that are as good
    return float(tries[np.flatnonzero(missed <= missed.min() + 1e-9)[0]])


def _room(packing: Packing, grid: Grid) -> Booleans:
    """Return the voxels with their centers in the container."""
    container, d = packing.container, packing.dimension
    boundary = boundary_of(container)
    room = np.ones(grid.shape, dtype=bool)
    for axis in range(d):
        if not container.periodic[axis]:
            place = grid.centers(axis)
            inside = (place > container.bounds[0, axis]) & (place < container.bounds[1, axis])
            room &= inside.reshape([-1 if k == axis else 1 for k in range(3)])
    if boundary.is_flat:
        return room
    if d == 3 and boundary.solid is not None and isinstance(boundary.solid.geometry, Mesh):
        return room & occupy(boundary.solid, grid, offset=np.array(boundary.solid.offset))
    y, z = np.meshgrid(grid.centers(1), grid.centers(2) if d == 3 else np.zeros(1), indexing="ij")
    layer = np.column_stack([np.zeros(y.size), y.ravel(), z.ravel()])
    for k, x in enumerate(grid.centers(0)):
        layer[:, 0] = x
        room[k] &= (container.signed_distance(layer) < 0).reshape(y.shape)
    return room


#: points whose spheres are in memory at a time
POINTS = 2**15
#: times the step of the search in a voxel, at first half its edge, is divided by four
FINER = 2
#: points of which a thread takes no fewer
LEAST_POINTS = 2**10


@kernel
def _climb(walls, places, half, near, starts, found, begin, end):  # type: ignore[no-untyped-def]
    """Write centers and radii of the largest spheres with centers in cubes about some places.

    Spheres `near[starts[p]]` to `near[starts[p + 1]]` are those around place p.
    """
    deep = 1 if walls.dimension == 3 else 0
    for p in range(begin, end):
        x, y, z = places[p]
        around = near[starts[p] : starts[p + 1]]
        wall, best, step, left = (
            clearance(walls, x, y, z),
            _room_at(walls, False, around, -np.inf, x, y, z),
            half,
            FINER,
        )
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
                        room = _room_at(walls, walled, around, best, a, b, c)
                        if room > best:
                            x, y, z, best = a, b, c, room
            if best <= before + 1e-6 * half:
                step, left = step / 4, left - 1
        found[p, 0], found[p, 1], found[p, 2], found[p, 3] = x, y, z, max(best, 0.0)


@bare_kernel
def _room_at(walls, walled, near, least, x, y, z):  # type: ignore[no-untyped-def]
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
