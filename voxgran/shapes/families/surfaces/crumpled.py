"""Crumpled sheets: paper folded along straight lines, exactly without stretching.

A fold reflects all that lies beyond a plane in that plane. This changes no length along the surface, whatever has been
folded before, and the new creases are straight where facets meet the plane. The plane contains a random line of a
random facet and is inclined to it by half the angle of the fold; other facets that it meets turn by other angles.
Planes with which the surface would meet itself are drawn again. Triangles are cut along the creases, so that every one
of them stays rigid: the lengths of all edges are those of the flat sheet to round-off.
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, as_number, as_positive
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.geometry.crossing import count_crossings
from voxgran.geometry.triangles import areas_of
from voxgran.shapes.families.surfaces.sheet import lattice_faces
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.finer import cut_edges, edges_of
from voxgran.shapes.mesh import Surface
from voxgran.shapes.model import Shape

#: least distance of a plane from all vertices, in mean edges, so that no triangle is cut into slivers
CLEAR = 1e-4
#: planes that are tried for one fold; after each so many of them the angle is halved
TRIES, GENTLER = 400, 100
#: folds at the most
MOST_FOLDS = 400


@parameter_class
class Crumpled(Sized):
    """Parameters of a crumpled sheet.

    Parameters
    ----------
    fold_length
        mean length of the straight creases between crossings and rims, in mean edges of the flat sheet; folds are made
        until it is no longer.
    angles
        range from which the angle of each fold is drawn, in degrees; 0 is flat, below 180.
    aspect
        ratio of the edges along x and y of the flat sheet.
    diameter
        diameter of the disk of equal area; default: 1.

    Raises
    ------
    InputError
        If a number is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.crumpled(fold_length=0.5, seed=1).is_open
    True
    """

    fold_length: float = parameter(0.35, at_least=0.1, at_most=1.0)
    angles: tuple[float, float] = parameter((20.0, 90.0))
    aspect: tuple[float, float] = parameter((1.0, 1.0))

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self)
        low, high = self.angles
        if as_number(high, "angles", above=0.0, at_least=as_number(low, "angles", above=0.0)) >= 180.0:
            raise InputError(f"angles end at {high:g}: folded through 180 degrees a sheet lies on itself; give less")


@dataclass(slots=True)
class Folded:
    """A folded sheet: where its vertices are, and where they were."""

    vertices: Floats  # (n, 3)
    flat: Floats  # (n, 2)
    faces: Integers  # (m, 3)
    creases: Integers  # vertices at both ends of the edges that are folded, (k, 2)

    def mean_length(self) -> tuple[float, int]:
        """Return mean length and number of the straight creases between crossings and rims."""
        if not len(self.creases):
            return np.inf, 0
        total = linear.norm(self.flat[self.creases[:, 0]] - self.flat[self.creases[:, 1]], axis=1).sum()
        # where two edges of a crease meet, a crease goes on across an edge of triangles that is not folded
        number = len(self.creases) - int((np.bincount(self.creases.ravel()) == 2).sum())
        return float(total / number), number


def make(parameters: Crumpled, generator: np.random.Generator) -> Shape:
    """Return a crumpled sheet.

    Raises
    ------
    InputError
        If no further fold keeps the sheet from meeting itself.
    """
    edges = np.array([as_positive(value, "aspect") for value in parameters.aspect])
    x, y = edges / edges.mean()
    flat = np.array([(0.0, 0.0), (x, 0.0), (0.0, y), (x, y)])
    sheet = Folded(np.column_stack([flat, np.zeros(4)]), flat, lattice_faces(1, 1), np.zeros((0, 2), np.int64))
    folds = 0
    while sheet.mean_length()[0] > parameters.fold_length:
        if folds == MOST_FOLDS or (new := _next(sheet, parameters.angles, generator)) is None:
            reached = sheet.mean_length()[0]
            raise InputError(
                f"fold_length is {parameters.fold_length:g}: after {folds} folds and with a mean length of "
                f"{reached:.3g} no other fold was found that keeps the sheet from meeting itself; give at least "
                f"{np.ceil(100 * reached) / 100:g}, or smaller angles"
            )
        sheet, folds = new, folds + 1
    ends, _ = edges_of(sheet.faces)
    before, after = (linear.norm(at[ends[:, 0]] - at[ends[:, 1]], axis=1) for at in (sheet.flat, sheet.vertices))
    length, number = sheet.mean_length()
    told = {
        "folds": folds,
        "creases": number,
        "fold_length": length,
        "isometry_error": float(np.abs(after / before - 1.0).max()),
    }
    return sized(Surface(sheet.vertices, sheet.faces), parameters.diameter, name="crumpled", record=told)


def _next(sheet: Folded, angles: tuple[float, float], generator: np.random.Generator) -> Folded | None:
    """Return the sheet with one more fold; None where none of many planes can be used."""
    areas = areas_of(sheet.vertices[sheet.faces])
    for trial in range(TRIES):
        face = sheet.faces[generator.choice(len(areas), p=areas / areas.sum())]
        a, b, c = sheet.vertices[face]
        u, v = generator.random(2)
        u, v = (1 - u, 1 - v) if u + v > 1 else (u, v)
        along, normal = (b - a) / linear.norm(b - a), np.cross(b - a, c - a)
        normal /= linear.norm(normal)
        turn = 2 * np.pi * generator.random()
        across = libm.cos(turn) * along + libm.sin(turn) * np.cross(normal, along)
        half = np.deg2rad(generator.uniform(*angles)) / 2 * 0.5 ** (trial // GENTLER)
        direction = libm.sin(half) * across + libm.cos(half) * (1 if generator.random() < 0.5 else -1) * normal
        new = folded(sheet, a + u * (b - a) + v * (c - a), direction)
        if new is not None and count_crossings(new.vertices, new.faces) == 0:
            return new
    return None


def folded(sheet: Folded, point: Floats, direction: Floats) -> Folded | None:
    """Return a sheet with all that lies beyond a plane reflected in it; None where a vertex is too near the plane."""
    height = linear.matmul(sheet.vertices - point, direction)
    if np.abs(height).min() < CLEAR:
        return None
    ends, index = edges_of(sheet.faces)
    one, two = height[ends].T
    cut = one * two < 0
    share = (one[cut] / (one[cut] - two[cut]))[:, None]
    first, second = ends[cut].T
    new = np.full(len(ends), -1)
    new[cut] = len(height) + np.arange(int(cut.sum()))
    vertices = np.concatenate([sheet.vertices, (1 - share) * sheet.vertices[first] + share * sheet.vertices[second]])
    flat = np.concatenate([sheet.flat, (1 - share) * sheet.flat[first] + share * sheet.flat[second]])
    height = np.concatenate([height, np.zeros(int(cut.sum()))])
    # a triangle that the plane crosses has one more crease, between the two new vertices
    on = np.sort(new[index], axis=1)
    added = on[on[:, 1] >= 0][:, 1:]
    base = int(sheet.faces.max()) + 1
    where = np.searchsorted(
        ends[:, 0] * base + ends[:, 1], linear.matmul(np.sort(sheet.creases, axis=1), np.array([base, 1]))
    )
    halved = new[where] >= 0
    middle = new[where][halved]
    old = sheet.creases[halved]
    pieces = np.concatenate([np.column_stack([old[:, 0], middle]), np.column_stack([middle, old[:, 1]])])
    creases = np.concatenate([sheet.creases[~halved], pieces, added])
    faces = cut_edges(np.column_stack([flat, np.zeros(len(flat))]), sheet.faces, index, new)
    vertices = vertices - 2 * np.maximum(height, 0.0)[:, None] * direction
    return Folded(vertices, flat, faces, creases)


registration = ShapeFamily(
    summary="open surface: a sheet folded along random straight lines without stretching",
    parameters=Crumpled,
    make=make,
    random=True,
    is_open=True,
)
