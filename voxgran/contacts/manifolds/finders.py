"""Which functions find the contacts of a scene: those for the kinds of grains that it has, and no others."""

import copy
import math
from collections.abc import Sequence

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.errors import InputError
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.manifolds.blocks import pairs_of_kind
from voxgran.contacts.manifolds.convex_bodies import convex_bodies, convex_work, has_convex_parts
from voxgran.contacts.manifolds.convex_contacts import find_convex_contacts
from voxgran.contacts.manifolds.distance_grids import surface_bodies
from voxgran.contacts.manifolds.outline_contacts import find_outline_contacts, outline_bodies
from voxgran.contacts.manifolds.pair_list import no_pairs
from voxgran.contacts.manifolds.rows import CONVEX, OUTLINE, SPHERE, SURFACE, ContactRows, Grains, PairList, Search
from voxgran.contacts.manifolds.sphere_contacts import find_sphere_contacts
from voxgran.contacts.manifolds.surface_contacts import find_surface_contacts
from voxgran.contacts.manifolds.surface_memory import follow_pairs, surface_work
from voxgran.contacts.manifolds.triangle_contacts import find_triangle_contacts, prove_separate
from voxgran.contacts.manifolds.wall_bodies import Lid, wall_bodies
from voxgran.contacts.manifolds.wall_contacts import find_wall_contacts
from voxgran.contacts.parts import is_disk
from voxgran.containers.kernel_container import kernel_container
from voxgran.containers.model import UNKNOWN, Container, boundary_of
from voxgran.shapes.model import Shape


def kinds_of(shapes: Sequence[Shape], *, hulls: bool = False) -> Integers:
    """Return what finds the contacts of each shape, (k,): `SPHERE`, `CONVEX`, `SURFACE` or `OUTLINE`.

    hulls: whether convex hulls stand for meshes that are not convex.

    Raises
    ------
    InputError
        If a shape is an open surface.
    """
    kinds = np.array([_kind_of(shape) for shape in shapes], dtype=np.int64)
    return np.where(hulls & (kinds == SURFACE), CONVEX, kinds)


def _kind_of(shape: Shape) -> int:
    """Return the kind of one shape."""
    shape.refuse_open("grains that settle")
    if shape.dimension == 2:
        return SPHERE if is_disk(shape.geometry) else OUTLINE
    if shape.is_sphere:
        return SPHERE
    return CONVEX if has_convex_parts(shape.geometry) else SURFACE


class ContactFinders:
    """Finds the contacts of the grains of an assembly.

    Parameters
    ----------
    assembly : Assembly
        Shapes, container and lid, with lengths in median diameters.
    grains : Grains
        The grains; their number and shapes count.
    exact : bool
        Whether contacts of meshes that are not convex come from their triangles, not from grids of distances.
    hulls : bool
        Whether convex hulls stand for them.

    Raises
    ------
    InputError
        If the walls of the container are not known.
    """

    def __init__(self, assembly: Assembly, grains: Grains, *, exact: bool = False, hulls: bool = False) -> None:
        if boundary_of(assembly.container) is UNKNOWN:
            raise InputError(
                f"container is of type {type(assembly.container).__name__}: grains settle in containers whose walls "
                "are known only; make a mesh of it, ClosedMesh(Shape.from_mesh(*container.mesh()))"
            )
        self.exact = exact
        self.kinds = set(grains.kind.tolist())
        self._walls = kernel_container(assembly.container)
        self._wall_bodies = wall_bodies(assembly.shapes, assembly.container)
        self._normal = np.zeros(3) if assembly.lid is None else np.array(assembly.lid.normal, dtype=np.float64)
        #: (s,) corners of the shapes, of which what is remembered of pairs names some
        self.corners: Integers = np.zeros(len(assembly.shapes), dtype=np.int64)
        if CONVEX in self.kinds:
            bodies = convex_bodies(assembly.shapes, hulls=hulls)
            self._convex_work, self.corners = convex_work(bodies, grains), np.diff(bodies.first)
        if SURFACE in self.kinds:
            self._surfaces = surface_bodies(assembly.shapes)
            self._surface_work, self._remembered = surface_work(self._surfaces, 0), no_pairs()
        if OUTLINE in self.kinds:
            self._outlines = outline_bodies(assembly.shapes)

    def prove(
        self, grains: Grains, pairs: PairList, rows: ContactRows, reach: float
    ) -> tuple[Floats, Booleans, Booleans]:
        """Return exact gaps of pairs with a mesh that is not convex, whether they are proven separate, and which pairs.

        All are (m,); gaps are infinite beyond reach.
        """
        self._remember(pairs)
        gap, proven = prove_separate(grains, pairs, self._surface_work, rows, reach)
        return gap, proven, pairs_of_kind(grains, pairs, SURFACE)

    def crossing(self, pairs: PairList, grains: Grains) -> int:
        """Return how many pairs were not proven to be separate when exact contacts were last found."""
        if SURFACE not in self.kinds or not self.exact:
            return 0
        proven = self._surface_work.arrays.proven[: len(pairs.i)]
        return int((pairs_of_kind(grains, pairs, SURFACE) & ~proven).sum())

    @property
    def notched(self) -> bool:
        """Whether some grains are polygons that are not convex."""
        if OUTLINE not in self.kinds:
            return False
        bodies = self._outlines.arrays
        return bool(((np.diff(bodies.start) > 0) & (bodies.convex == 0)).any())

    def _remember(self, pairs: PairList) -> None:
        """Let the memory of pairs follow them to their rows in a new list."""
        if pairs.i is not self._remembered.i:
            follow_pairs(self._surface_work, self._remembered, pairs)
            self._remembered = pairs

    def move_walls(self, container: Container) -> None:
        """Take over a container of the same kind, whose walls have moved."""
        self._walls = kernel_container(container)

    @property
    def gridded(self) -> bool:
        """Whether all grains have grids of distances, in a bed of meshes that are not convex: spheres have none."""
        return SURFACE in self.kinds and bool(self._surfaces.frame[:, 0].all())

    def by_grids(self) -> "ContactFinders":
        """Return finders of contacts by grids of distances, which remember pairs of meshes on their own."""
        made = copy.copy(self)
        made.exact, made._surface_work, made._remembered = False, surface_work(self._surfaces, 0), no_pairs()
        return made

    def forget(self) -> None:
        """Forget all that a search has remembered of pairs of meshes."""
        if SURFACE in self.kinds:
            self._surface_work.arrays.key[:] = -1

    def find(
        self, grains: Grains, pairs: PairList, rows: ContactRows, *, at_walls: tuple[Integers, Integers],
        lid_level: float, margin: float, rest: float, reuse: float = 0.0, fixed: Booleans | None = None,
    ) -> int:  # fmt: skip
        """Write all contacts nearer than a margin, and return their number, or -1 where they are more than the rows.

        reuse: motion of a pair up to which exact contacts of meshes are those of before.  fixed: (n,) grains whose
        contacts with walls are left out.
        """
        m, search = 0, Search(grains, pairs, margin, rest, reuse)
        if SPHERE in self.kinds:
            m = find_sphere_contacts(search, rows, m)
        if m >= 0 and CONVEX in self.kinds:
            m = find_convex_contacts(search, self._convex_work, rows, m)
        if m >= 0 and SURFACE in self.kinds:
            self._remember(pairs)
            find = find_triangle_contacts if self.exact else find_surface_contacts
            m = find(search, self._surface_work, rows, m)
        if m >= 0 and OUTLINE in self.kinds:
            m = find_outline_contacts(search, self._outlines, rows, m)
        if m < 0:
            return m
        if fixed is not None:
            search = search._replace(grains=grains._replace(radius=np.where(fixed, -1.0, grains.radius)))
        lid = Lid(self._normal, lid_level if math.isfinite(lid_level) else math.inf)
        return int(find_wall_contacts(search, self._walls, lid, self._wall_bodies, at_walls, rows, m))
