"""Bonds between the spheres of a clump, for clumps that may break: a bonded clump in place of a rigid one.

All pairs of spheres of a grain that overlap or touch are bonded, also where their circle of intersection lies within a
third sphere. The bond stands for the largest circle of the common part of two spheres that is normal to the line
between their centers: the circle of intersection, or the great circle of the smaller sphere where its center lies
beyond that circle or all of it is within the other. The area of a bond is thus continuous in the distance.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_number, as_share
from voxgran._base.errors import PackingWarning, warn
from voxgran._base.lazy import Dataset, load
from voxgran.geometry.sphere_pairs import near_pairs

#: least area of a bond, as share of the great circle of the smaller sphere
LEAST_AREA = 0.1
#: gap up to which spheres touch, as share of the radius of the smaller one
TOUCHING = 1e-6


class BodyBonds(NamedTuple):
    """Bonds between the spheres of one body, in its frame and unit."""

    first: Integers  # (m,) spheres, in lexical order with first < second
    second: Integers
    point: Floats  # (m, 3) center of the circle
    normal: Floats  # (m, 3) unit vector from the first to the second center
    area: Floats  # (m,)
    gap: Floats  # (m,) distance of the surfaces, negative where the spheres overlap
    added: int  # number of bonds between spheres that do not touch


class Strengths(NamedTuple):
    """How strong bonds are, and between which spheres there are any."""

    normal: float  # force per area
    shear: float
    tolerance: float  # gap up to which spheres touch, in radii of the smaller one
    least_area: float  # in great circles of the smaller one

    @classmethod
    def of(cls, strength: Any, shear_strength: Any, tolerance: Any, least_area: Any) -> "Strengths":
        """Return checked strengths; the shear strength is the other one where it is None.

        Raises
        ------
        InputError
            If a number is negative or not finite, or the least area is above 1.
        """
        normal = as_number(strength, "strength", at_least=0.0)
        return cls(
            normal,
            normal if shear_strength is None else as_number(shear_strength, "shear_strength", at_least=0.0),
            as_number(tolerance, "tolerance", at_least=0.0),
            as_share(least_area, "least_area", zero=True),
        )


def body_bonds(
    centers: Floats, radii: Floats, *, tolerance: float = TOUCHING, least_area: float = LEAST_AREA
) -> BodyBonds:
    """Return the bonds between spheres with centers (n, 3) and radii (n,).

    Pairs overlap or are at most `tolerance` times the smaller radius apart. Where these do not join all spheres, the
    pairs with the least gaps that do are added. No bond is smaller than `least_area` times the great circle of its
    smaller sphere.
    """
    reach = tolerance * float(radii.max())
    i, j, _ = near_pairs(centers, radii, reach)
    gap = _gaps(centers, radii, i, j)
    near = gap <= tolerance * np.minimum(radii[i], radii[j])
    i, j = i[near], j[near]
    more = _joining(centers, radii, i, j)
    i, j = np.concatenate([i, more[:, 0]]), np.concatenate([j, more[:, 1]])
    order = np.lexsort((j, i))
    i, j = i[order], j[order]
    apart = centers[j] - centers[i]
    distance = linear.norm(apart, axis=1)
    # of spheres with the same center any direction is one between their centers
    normal = np.where(distance[:, None] > 0, apart / np.where(distance > 0, distance, 1.0)[:, None], [1.0, 0.0, 0.0])
    area, along = _circles(radii[i], radii[j], distance)
    area = np.maximum(area, least_area * math.pi * np.minimum(radii[i], radii[j]) ** 2)
    point = centers[i] + along[:, None] * normal
    return BodyBonds(i, j, point, normal, area, _gaps(centers, radii, i, j), len(more))


def _gaps(centers: Floats, radii: Floats, i: Integers, j: Integers) -> Floats:
    """Return the distances of the surfaces of pairs of spheres."""
    return np.asarray(linear.norm(centers[j] - centers[i], axis=1) - radii[i] - radii[j])


def _circles(one: Floats, other: Floats, distance: Floats) -> tuple[Floats, Floats]:
    """Return areas of the circles of pairs of spheres with radii (m,), and distances of their centers from the first
    center, (m,).

    Spheres that do not overlap have no area and a point halfway between their surfaces.
    """
    far = np.where(distance > 0, distance, 1.0)
    plane = (far + (one - other) / far * (one + other)) / 2
    apart, small = distance >= one + other, np.minimum(one, other)
    # the center of the smaller sphere lies beyond the circle of intersection, or there is no such circle
    first, second = (plane <= 0) & (one <= other), (plane >= far) & (other <= one)
    inner = (first | second | (distance == 0)) & ~apart
    along = np.where(inner, np.where(one < other, 0.0, distance), plane)
    along = np.where(apart, (distance + one - other) / 2, along)
    area = math.pi * np.where(inner, small**2, np.maximum((one - plane) * (one + plane), 0.0))
    return np.where(apart, 0.0, area), along


def _joining(centers: Floats, radii: Floats, i: Integers, j: Integers) -> Integers:
    """Return the pairs (k, 2) with the least gaps that join all spheres that the pairs (i, j) leave apart."""
    graph = load("scipy.sparse").coo_matrix((np.ones(len(i)), (i, j)), shape=(len(radii), len(radii)))
    _, label = load("scipy.sparse.csgraph").connected_components(graph, directed=False)
    found = []
    while label.max(initial=0) > 0:
        part, counts = np.unique(label, return_counts=True)
        mine = label == part[counts.argmin()]
        if mine.all():
            break
        inside, outside = np.flatnonzero(mine), np.flatnonzero(~mine)
        best = (math.inf, 0, 0)
        for k in inside.tolist():
            gaps = _gaps(centers, radii, np.full(len(outside), k), outside)
            nearest = int(gaps.argmin())
            best = min(best, (float(gaps[nearest]), k, int(outside[nearest])))
        found.append(sorted(best[1:]))
        label[mine] = label[best[2]]
        if len(part) == 2:
            break
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def bonds_of_bodies(
    bodies: Sequence[tuple[Floats, Floats]],
    shape_id: Integers,
    *,
    scale: Floats,
    matrices: Floats,
    position: Floats,
    strengths: Strengths,
    unit: str,
) -> "Dataset":
    """Return the bonds of all grains, one row each: `bodies` are centers and radii of the spheres of each shape.

    Spheres are numbered grain by grain and within a grain in the order of its shape.
    """
    counts = np.array([len(radii) for _, radii in bodies], dtype=np.int64)[shape_id]
    start, rows, added = np.cumsum(counts) - counts, [], 0
    for k in np.unique(shape_id).tolist():
        grain = np.flatnonzero(shape_id == k)
        made = body_bonds(*bodies[k], tolerance=strengths.tolerance, least_area=strengths.least_area)
        added += made.added * len(grain)
        size, first = scale[grain, None], start[grain, None]
        turned = linear.einsum("gij,sj->gsi", matrices[grain], made.point) * size[:, :, None]
        rows.append(
            (
                (first + made.first).reshape(-1),
                (first + made.second).reshape(-1),
                np.repeat(grain, len(made.first)),
                (turned + position[grain, None]).reshape(-1, 3),
                linear.einsum("gij,sj->gsi", matrices[grain], made.normal).reshape(-1, 3),
                (size**2 * made.area).reshape(-1),
                (size * made.gap).reshape(-1),
            )
        )
    if added:
        warn(
            f"{added} bonds join spheres that do not touch, so that each grain is one body: their gaps are in 'gap'",
            PackingWarning,
        )
    return _dataset(rows, strengths, unit, added)


def _dataset(rows: list[tuple[Any, ...]], strengths: Strengths, unit: str, added: int) -> "Dataset":
    """Return the rows of all shapes as a table, in the order of the grains."""
    empty = (*(np.zeros(0, np.int64) for _ in range(3)), *(np.zeros((0, 3)) for _ in range(2)), *[np.zeros(0)] * 2)
    first, second, grain, point, normal, area, gap = (np.concatenate(parts) for parts in zip(empty, *rows, strict=True))
    order = np.argsort(grain, kind="stable")
    square = "1" if unit == "1" else f"{unit}^2"
    row, vector = ("bond",), ("bond", "axis")
    area = area[order]
    columns = {
        "first": (row, first[order], "1", "number of the first sphere"),
        "second": (row, second[order], "1", "number of the second sphere"),
        "grain": (row, grain[order], "1", "grain of both spheres"),
        "point": (vector, point[order], unit, "center of the circle that is bonded"),
        "normal": (vector, normal[order], "1", "unit vector from the first to the second center"),
        "area": (row, area, square, "area of the circle that is bonded"),
        "gap": (row, gap[order], unit, "distance of the surfaces, negative where the spheres overlap"),
        "normal_strength": (row, strengths.normal * area, "force", "force that breaks the bond in tension"),
        "shear_strength": (row, strengths.shear * area, "force", "force that breaks the bond in shear"),
    }
    data = {
        name: (dims, values, {"units": units, "long_name": text})
        for name, (dims, values, units, text) in columns.items()
    }
    about = {
        "strength": strengths.normal,
        "strength_in_shear": strengths.shear,
        "tolerance": strengths.tolerance,
        "least_area": strengths.least_area,
        "bonds_over_gaps": added,
    }
    made: Dataset = load("xarray").Dataset(data, attrs=about)
    return made
