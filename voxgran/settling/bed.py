"""A bed: grains, their near pairs and their contacts, changed in place step by step.

Lengths are in median diameters and times in sqrt(d / g); the inverse mass of a grain of the median diameter is 1, where
densities differ of one of their mean by volume.
Grains are kept in the order of their heights at the beginning, so that neighbours lie close in memory; many of them
layer by layer, along a curve across each one (Morton).
"""

import copy
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.contacts.assembly import Assembly, Lid
from voxgran.contacts.forces import LID, WALL
from voxgran.contacts.manifolds.finders import ContactFinders, kinds_of
from voxgran.contacts.manifolds.pair_list import count_relative_ways, no_pairs, renewed
from voxgran.contacts.manifolds.rows import (
    ARM_I,
    ARM_J,
    GAP,
    MASS_ACROSS,
    NORMAL,
    SPHERE,
    SURFACE,
    Grains,
    PairList,
    carry_rows,
    doubled_rows,
    no_rows,
)
from voxgran.containers.model import Container, boundary_of, within_periods
from voxgran.geometry.morton import layered_order
from voxgran.geometry.rotation import normalized
from voxgran.geometry.walls import Plane, Round
from voxgran.settling.balance import LoadedContacts
from voxgran.settling.impulses import bodies_of, move_bodies, rolls_of, write_matrices
from voxgran.settling.materials import FrictionTable

Array = TypeVar("Array", bound="np.ndarray[Any, Any]")

#: distance up to which pairs are listed, in median diameters
SKIN = 0.5
#: share of the smaller diameter from which on an overlap of meshes that are not convex is deep
DEEP = 0.1


class Bed:
    """Grains in a container under gravity.

    Parameters
    ----------
    assembly : Assembly
        The grains, with lengths in median diameters.
    gravity : (3,) ndarray of float
        Unit vector in which gravity acts; zeros without it.
    lid_weight : float
        Weight of the lid, if the assembly has one, in weights of a grain of the median diameter and the mean density.
    exact : bool
        Whether contacts of meshes that are not convex come from their triangles, not from grids of distances.
    hulls : bool
        Whether convex hulls stand for them.
    held : int
        How many of the last grains are held back: they come later, in their order.

    Raises
    ------
    InputError
        If a shape is an open surface, or the walls of the container are not known.
    """

    def __init__(
        self, assembly: Assembly, gravity: Floats, *, lid_weight: float = 1.0, exact: bool = False, hulls: bool = False,
        held: int = 0,
    ) -> None:  # fmt: skip
        self.assembly, self.gravity = assembly, np.array(gravity, dtype=np.float64)
        self.hulls = hulls
        # without gravity neighbours are near each other in memory too
        down = gravity if gravity.any() else -np.eye(3)[assembly.dimension - 1]
        n = assembly.count
        first = layered_order(assembly.position[: n - held], down)
        self.order: Integers = np.concatenate([first, np.arange(n - held, n)])
        order = self.order
        self.orientation: Floats = assembly.orientation[order].copy()
        self.bounding: Floats = assembly.bounding_radii[order].copy()
        self.grains = Grains(
            position=assembly.position[order].copy(),
            matrix=np.zeros((n, 3, 3)),
            scale=assembly.scale[order],
            radius=self.bounding.copy(),
            shape=assembly.shape_id[order].astype(np.int64),
            kind=kinds_of(assembly.shapes, hulls=hulls)[assembly.shape_id[order]],
            way=np.zeros(n),
        )
        write_matrices(self.orientation, self.grains.matrix)
        self.diameter: Floats = assembly.diameters[order].copy()
        self.density: Floats = assembly.relative_densities[order]
        self.fixed: Booleans | None = None if assembly.fixed is None else assembly.fixed[order]
        self.bodies, self.motion = bodies_of(assembly, order, lid_weight), np.zeros((n + 1, 6))
        self.rolls = rolls_of(assembly.shapes)
        self.lid_level = math.inf if assembly.lid is None else float(assembly.lid.level)
        self.pairs: PairList = no_pairs()
        self.rows = no_rows(8 * n + 64)
        self.m = 0
        # margin and rest distance of the contacts that were found, while they are carried along with the grains
        self.carried: Floats = np.full(2, np.nan)
        self.wall_first, self.wall_count = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        self.listed = False
        # where single spheres under gravity, which rolling brings no nearer to others, were listed, and their radii
        self._listed_at: Floats = np.zeros((0, 4))
        self.finders = ContactFinders(assembly, self.grains, exact=exact, hulls=hulls)
        # of all grains, those included that come later: what is known of pairs is handed on from list to list
        self.spheres = self.finders.kinds <= {SPHERE}
        self._coming = self.bodies[n - held : n].copy()
        if held:
            self._keep(n - held)

    def _keep(self, first: int) -> None:
        """Leave all but the first grains out."""
        held = self.arrays
        for name in (*("position", "orientation", "scale", "radius", "way", "order"), "wall_first", "wall_count"):
            held[name] = held[name][:first]
        self.restore({**held, "bodies": np.delete(self.bodies, np.s_[first : self.count], axis=0)})

    def admit(self, position: Floats, velocity: Floats) -> None:
        """Add the next grains that were held back, at their positions (k, 3) and with a velocity (3,)."""
        n, k, held, assembly = self.count, len(position), self.arrays, self.assembly
        first = n - (assembly.count - len(self._coming))
        bodies, new = self._coming[first : first + k].copy(), slice(n, n + k)
        bodies[:, :3] = velocity
        none = np.zeros(k, dtype=np.int64)
        added = {
            "position": position, "orientation": assembly.orientation[new], "scale": assembly.scale[new],
            "radius": assembly.bounding_radii[new], "way": np.zeros(k), "order": np.arange(n, n + k),
            "wall_first": none, "wall_count": none,
        }  # fmt: skip
        both = {name: np.concatenate([held[name], values]) for name, values in added.items()}
        self.restore({**held, **both, "bodies": np.insert(self.bodies, n, bodies, axis=0), "listed": np.array(False)})

    @property
    def count(self) -> int:
        """Number of grains."""
        return len(self.orientation)

    @property
    def contacts(self) -> LoadedContacts:
        """Contacts that were last found, with bodies and gravity."""
        rows, m = self.rows, self.m
        return LoadedContacts(rows.row[:m], rows.i[:m], rows.j[:m], self.bodies, self.gravity)

    @property
    def gap(self) -> Floats:
        """Gaps of the contacts that were last found, (m,), counted from the rest distance."""
        return self.rows.row[: self.m, 9]

    @property
    def load(self) -> float:
        """Ratio of the weight of all grains and the lid to that of the grains."""
        inverse = float(self.bodies[-1, 6])
        return 1.0 + (1.0 / (inverse * float((1.0 / self.bodies[:-1, 6]).sum())) if inverse > 0.0 else 0.0)

    @property
    def movable(self) -> Booleans:
        """Which grains are not fixed, (n,)."""
        return np.ones(self.count, dtype=np.bool_) if self.fixed is None else ~self.fixed

    def mean(self, values: "Floats | Booleans") -> float:
        """Return the mean of values of the grains, (n,), over those that are not fixed; 0 without any."""
        values = values if self.fixed is None else values[~self.fixed]
        return float(values.mean()) if len(values) else 0.0

    @property
    def kinetic_energy(self) -> float:
        """Mean kinetic energy of translation of a grain, for its mass."""
        return 0.5 * self.mean((self.bodies[: self.count, :3] ** 2).sum(axis=1))

    @property
    def height(self) -> float:
        """Mean height of the centroids, along gravity."""
        return -self.mean(linear.matmul(self.grains.position, self.gravity))

    def find(self, margin: float, rest: float, *, reuse: float = 0.0) -> None:
        """Find the contacts nearer than a margin; gaps count from a rest distance.

        The rows of before become the old ones, whose impulses the new ones take over. Exact contacts of meshes are not
        found again where neither surface of a pair has moved by more than `reuse` since, if they were carried along.
        """
        asked = np.array([margin, rest])
        reuse = reuse if np.array_equal(asked, self.carried) else 0.0
        self.carried = asked
        grains, way = self.grains, self.grains.way
        if self.listed and len(self._listed_at):
            gone, grown = grains.position - self._listed_at[:, :3], grains.radius - self._listed_at[:, 3]
            way[:] = np.sqrt((gone * gone).sum(axis=1)) + np.maximum(grown, 0.0)
        two = np.partition(way, -2)[-2:].sum() if len(way) > 1 else 2.0 * float(way.max(initial=0.0))
        if not self.listed or two + margin > SKIN:
            self.pairs = renewed(self.pairs, grains, self.assembly.container, SKIN, self.fixed, known=not self.spheres)
            self.listed, reuse = True, 0.0
            if self.gravity.any() and self.spheres:
                self._listed_at = np.column_stack([grains.position, grains.radius])
        self.rows = self.rows._replace(row=self.rows.old, old=self.rows.row)
        places = (*self.pairs[3:], self.wall_first, self.wall_count)
        before = [place.copy() for place in places]
        while (found := self._found(margin, rest, reuse)) < 0:
            self.rows = doubled_rows(self.rows)
            for place, old in zip(places, before, strict=True):
                place[:] = old
            # where a search has ended depends on the number of threads: the next one begins without it
            self.finders.forget()
        self.m = found
        if SURFACE in grains.kind and not self.finders.exact:
            self._unlock()
        # nothing of former steps is left in what solvers write
        self.rows.row[:found, MASS_ACROSS] = 0.0

    def _unlock(self) -> None:
        """Let the contacts of pairs that overlap deeply push along the line of centres.

        Deep within a mesh that is not convex, the normals of contacts point to all its sides, and their forces leave
        the pair as it is.
        """
        row, i, j = self.rows.row[: self.m], self.rows.i[: self.m], self.rows.j[: self.m]
        inner = (j >= 0) & (j < self.count)
        other = np.where(inner, j, i)
        deep = inner & (row[:, GAP] < -DEEP * np.minimum(self.diameter[i], self.diameter[other]))
        if not deep.any():
            return
        pair = i.astype(np.int64) * (self.count + 1) + j
        rows = np.flatnonzero(inner & np.isin(pair, pair[deep]))
        line = row[rows, ARM_I : ARM_I + 3] - row[rows, ARM_J : ARM_J + 3]
        line += row[rows, GAP, None] * row[rows, NORMAL : NORMAL + 3]
        length = linear.norm(line, axis=1)
        some = length > 1e-6
        row[rows[some], NORMAL : NORMAL + 3] = line[some] / length[some, None]

    def _found(self, margin: float, rest: float, reuse: float) -> int:
        """Return the number of contacts, or -1 where they are more than the rows."""
        return self.finders.find(
            self.grains, self.pairs, self.rows, at_walls=(self.wall_first, self.wall_count), lid_level=self.lid_level,
            margin=margin, rest=rest, reuse=reuse, fixed=self.fixed,
        )  # fmt: skip

    def deep_overlaps(self, deepest: float) -> tuple[Integers, Integers, Floats]:
        """Return the pairs of grains (k,), (k,) that overlap deeper than a share of the smaller diameter, and depths.

        The depths (k,) are in diameters of the smaller grain. No forces are lost: it is called before the first step.
        """
        self.find(0.0, 0.0)
        i, j = self.rows.i[: self.m], self.rows.j[: self.m]
        inner = np.flatnonzero((j >= 0) & (j < self.count))
        i, j = i[inner], j[inner]
        depth = -self.gap[inner] / np.minimum(self.diameter[i], self.diameter[j])
        deep = depth > deepest
        return self.order[i[deep]], self.order[j[deep]], depth[deep]

    def in_order(self, values: Array) -> Array:
        """Return values of the grains, (n, ...), in the order of the assembly."""
        found = np.empty_like(values)
        found[self.order] = values
        return found

    def contact_grains(self, *, wall: int, lid: int) -> tuple[Integers, Integers]:
        """Return the grains of the contacts as the assembly numbers them, (m,) each; walls and lid as given."""
        i, j, n = self.rows.i[: self.m], self.rows.j[: self.m], self.count
        partner = np.where(j < 0, wall, lid)
        inner = (j >= 0) & (j < n)
        partner[inner] = self.order[j[inner]]
        return np.asarray(self.order[i]), partner

    def friction_at(self, friction: float | FrictionTable | Floats) -> float | Floats:
        """Return the coefficients of friction of the contacts that were last found, (m,), or one for all of them."""
        if not isinstance(friction, FrictionTable):
            return friction
        i, j = self.contact_grains(wall=WALL, lid=LID)
        return friction.of_contacts(i, j, self._walls_at(j) if friction.walls_differ else np.zeros_like(j))

    def _walls_at(self, partner: Integers) -> Integers:
        """Return the numbers of the walls that contacts are at, (m,), the lid as the last one; 0 between grains."""
        boundary = boundary_of(self.assembly.container)
        walls: tuple[Plane | Round, ...] = (*boundary.planes, *boundary.round)
        found = np.where(partner == LID, len(boundary.walls), 0)
        at = np.flatnonzero(partner == WALL)
        row = self.rows.row[at]
        normal = row[:, NORMAL : NORMAL + 3]
        # points beyond the walls of the contacts by 1: near an edge both walls are near, and one is as far as that
        beyond = self.grains.position[self.rows.i[at]] + row[:, ARM_I : ARM_I + 3] + (row[:, GAP, None] + 1.0) * normal
        if len(walls) > 1:
            found[at] = np.argmin([np.abs(wall.distance(beyond) + 1.0) for wall in walls], axis=0)
        return found

    def forces(self) -> Floats:
        """Return the forces of the contacts on their partners, (m, 3)."""
        row = self.rows.row[: self.m]
        return row[:, 10:11] * row[:, :3] + row[:, 11:14]

    def keep_forces(self, forces: Floats) -> None:
        """Keep forces (m, 3), from which the next solution starts."""
        row = self.rows.row[: self.m]
        row[:, 10] = (forces * row[:, :3]).sum(axis=1)
        row[:, 11:14] = forces - row[:, 10:11] * row[:, :3]

    def move(self, motion: Floats, most: float, *, carry: bool = False) -> float:
        """Move the grains, and the lid along gravity, by no more than `most`; return the largest translation.

        carry: whether the contacts are carried along, so that they need not all be found again.
        """
        grains, n = self.grains, self.count
        surfaces = SURFACE in self.finders.kinds
        if carry or surfaces:
            motion = self.clipped(motion, most)
        if surfaces:
            count_relative_ways(self.pairs, grains, motion)
        if carry:
            carry_rows(self.rows, self.m, motion[:n])
        else:
            self.carried = np.full(2, np.nan)
        far = move_bodies(grains.position, self.orientation, grains.matrix, motion, grains.radius, grains.way, most)
        if math.isfinite(self.lid_level):
            self.lid_level -= float(np.clip(linear.matmul(motion[n, :3], self.gravity), -most, most))
        return float(far)

    def put(self, position: Floats, orientation: Floats, lid_level: float) -> None:
        """Put the grains in former poses (n, 3), (n, 4), in the order of the bed, and the lid where it was.

        Nothing of what is known of pairs holds any more.
        """
        self.lid_level = lid_level
        self.grains.position[:], self.orientation[:] = position, orientation
        write_matrices(self.orientation, self.grains.matrix)
        self.pairs, self.listed, self.carried = no_pairs(), False, np.full(2, np.nan)

    def clipped(self, motion: Floats, most: float) -> Floats:
        """Return the motions (n + 1, 6) of which none moves a point of a surface by more than `most`."""
        clipped, reach = motion.copy(), np.append(self.grains.radius, 0.0)
        for part, lever in ((clipped[:, :3], np.ones(len(motion))), (clipped[:, 3:], reach)):
            far = linear.norm(part, axis=1) * lever
            part *= np.minimum(1.0, most / np.maximum(far, most))[:, None]
        return clipped

    def deform(self, gradient: Floats, container: Container) -> None:
        """Multiply the coordinates of the centroids by a matrix (3, 3), where the container becomes another one."""
        grains = self.grains
        grains.position[:] = linear.matmul(grains.position, gradient.T)
        self.pairs.shift[:] = linear.matmul(self.pairs.shift, gradient.T)
        # pairs of the list approach each other by no more than their distance times the strain
        grains.way[:] += float(np.abs(gradient - np.eye(3)).sum(axis=1).max()) * (grains.radius + 0.5 * SKIN)
        self.move_walls(container)
        self.carried = np.full(2, np.nan)

    def move_walls(self, container: Container) -> None:
        """Take over a container of the same kind."""
        self.assembly = replace(self.assembly, container=container)
        self.finders.move_walls(container)

    def resize(self, factor: Floats) -> None:
        """Give the grains sizes of `factor` (n,) times their final ones."""
        old, self.carried = self.grains.radius.copy(), np.full(2, np.nan)
        self.grains.scale[:] = self.assembly.scale[self.order] * factor
        self.grains.radius[:] = self.bounding * factor
        self.grains.way[:] += np.maximum(self.grains.radius - old, 0.0)

    def poses(self) -> tuple[Floats, Floats]:
        """Return centroids (n, 3), within the periodic sides, and orientations (n, 4), in the order of the assembly."""
        position, orientation = np.zeros_like(self.grains.position), np.zeros_like(self.orientation)
        position[self.order], orientation[self.order] = self.grains.position, self.orientation
        return within_periods(position, self.assembly.container), normalized(orientation)

    def moved_assembly(self) -> Assembly:
        """Return the grains in their present poses, with the lid where it is."""
        (position, orientation), lid = self.poses(), self.assembly.lid
        lid = lid and Lid(lid.normal, self.lid_level)
        return replace(self.assembly, position=position, orientation=orientation, lid=lid)

    def copy(self) -> "Bed":
        """Return a copy that moves on its own while this one does not; memory of searches and sizes are shared."""
        made, m, rows, grains = copy.copy(self), self.m, self.rows, self.grains
        made.grains = grains._replace(**{name: getattr(grains, name).copy() for name in ("position", "matrix", "way")})
        made.pairs = self.pairs._replace(**{name: getattr(self.pairs, name).copy() for name in PairList._fields[3:]})
        for name in ("orientation", "bodies", "motion", "wall_first", "wall_count"):
            setattr(made, name, getattr(self, name).copy())
        # old rows are room for those that are found next
        made.rows = no_rows(len(rows.row), old=rows.old)
        made.rows.row[:m], made.rows.i[:m], made.rows.j[:m] = rows.row[:m], rows.i[:m], rows.j[:m]
        return made

    @property
    def arrays(self) -> dict[str, Floats | Integers]:
        """All that the next step depends on, for a checkpoint."""
        grains = self.grains
        return {
            "position": grains.position,
            "orientation": self.orientation,
            "bodies": self.bodies,
            "scale": grains.scale,
            "radius": grains.radius,
            "way": grains.way,
            "order": self.order,
            **{f"pair_{name}": getattr(self.pairs, name) for name in PairList._fields},
            "row": self.rows.row[: self.m],
            "row_i": self.rows.i[: self.m],
            "row_j": self.rows.j[: self.m],
            # where rows are too few, the search begins again, and what it remembers of pairs changes
            "row_room": np.array(len(self.rows.row)),
            "listed": np.array(self.listed),
            "listed_at": self._listed_at,
            "wall_first": self.wall_first,
            "wall_count": self.wall_count,
            "lid_level": np.array(self.lid_level),
            "carried": self.carried,
        }

    def restore(self, arrays: Mapping[str, Any]) -> None:
        """Take over the arrays of a checkpoint."""
        row = arrays["row"]
        held: dict[str, Any] = {name: np.array(array) for name, array in arrays.items() if name != "row"}
        self.order = held["order"]
        self.orientation, self.bodies = held["orientation"], held["bodies"]
        matrix = np.zeros((len(self.orientation), 3, 3))
        names = {name: held[name] for name in ("position", "scale", "radius", "way")}
        shape = self.assembly.shape_id[self.order].astype(np.int64)
        kind = kinds_of(self.assembly.shapes, hulls=self.hulls)[shape]
        self.grains = Grains(matrix=matrix, shape=shape, kind=kind, **names)
        write_matrices(self.orientation, matrix)
        self.bounding = self.assembly.bounding_radii[self.order].copy()
        self.diameter = self.assembly.diameters[self.order].copy()
        self.density = self.assembly.relative_densities[self.order]
        self.fixed = None if self.assembly.fixed is None else self.assembly.fixed[self.order]
        self.pairs = PairList(*(held[f"pair_{name}"] for name in PairList._fields))
        self.listed, self._listed_at = bool(held["listed"]), held["listed_at"]
        m = self.m = len(row)
        self.rows = no_rows(int(held["row_room"]))
        self.rows.row[:m], self.rows.i[:m], self.rows.j[:m] = row, held["row_i"], held["row_j"]
        self.wall_first, self.wall_count = held["wall_first"], held["wall_count"]
        self.lid_level, self.carried = float(held["lid_level"]), held["carried"]
        self.motion = np.zeros((len(self.orientation) + 1, 6))


def normalized_bed(assembly: Assembly, gravity: Floats) -> Bed:
    """Return the grains of an assembly as a bed with exact contacts, whose lid does not move."""
    unit = assembly.median_diameter
    lid = assembly.lid if assembly.lid is None else Lid(assembly.lid.normal, assembly.lid.level / unit)
    arrays = (assembly.shapes, assembly.shape_id, assembly.scale / unit, assembly.position / unit, assembly.orientation)
    container = assembly.container.scaled(1.0 / unit)
    normalized = Assembly(*arrays, container, assembly.density, lid=lid, fixed=assembly.fixed)
    return Bed(normalized, gravity, lid_weight=math.inf, exact=True)
