"""Exact Apollonian gaskets: circles and spheres in the gaps between mutually tangent ones.

A circle, a sphere or a line is a row of curvature coordinates: its curvature b, which is negative for what holds the
others and 0 for a line, b times its center, which is the unit normal of a line, and the curvature of its inversion in
the unit sphere. In these coordinates the reflection that exchanges one of d + 2 mutually tangent spheres for the other
that touches the rest is linear (Lagarias, Mallows & Wilks 2002), so that whole generations are made by sums.
"""

import itertools
import math
from collections.abc import Iterator

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Words
from voxgran._base.stopping import stop_if_asked


def row_of(center: Floats, radius: float) -> Floats:
    """Return the coordinates of a sphere of center (d,); a negative radius stands for one that holds the others."""
    square = float(linear.matmul(center, center)) - radius**2
    return np.concatenate([[1.0 / radius], center / radius, [square / radius]])


def line_of(normal: Floats, offset: float) -> Floats:
    """Return the coordinates of a line or plane with normal @ x = offset; the normal leads away from the others."""
    return np.concatenate([[0.0], normal, [2.0 * offset]])


def in_sphere(dimension: int, most: float) -> Iterator[Floats]:
    """Return the spheres in the unit sphere around d + 1 equal ones, up to a curvature: rows, in parts."""
    if dimension == 2:
        angles = 2.0 * math.pi * np.arange(3) / 3.0
        corners = np.column_stack([libm.cos(angles), libm.sin(angles)])
    else:
        corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / math.sqrt(3.0)
    # the corners of a simplex are by this factor farther apart than from its middle
    edge = float(linear.norm(corners[0] - corners[1]))
    radius = edge / (2.0 + edge)
    rows = [row_of(corner * (1.0 - radius), radius) for corner in corners]
    first = np.array([*rows, row_of(np.zeros(dimension), -1.0)])
    if first[0, 0] <= most:
        yield first[:-1]
    yield from _in_gaps(first[None], most) if dimension == 2 else _around(first, most)


def in_strip(most: float) -> Iterator[Floats]:
    """Return the circles between two lines at the distance 1, in one period: rows, in parts.

    One circle at x = 0 touches both lines and its images at whole x.
    """
    up = np.array([0.0, 1.0])
    first = [line_of(-up, 0.0), line_of(up, 1.0), row_of(np.array([0.0, 0.5]), 0.5), row_of(np.array([1.0, 0.5]), 0.5)]
    if first[2][0] <= most:
        yield first[2][None]
    # the gaps to both lines; those beyond the circles are images
    yield from _in_gaps(np.array([first]), most, exchanged=(0, 1))


def in_triangle(corners: Floats, most: float) -> Iterator[Floats]:
    """Return the circles in a triangle (3, 2): the inscribed one, those toward the corners, those between."""
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = linear.norm(edges, axis=1)
    turn = float(np.sign(edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0]))
    normals = turn * np.column_stack([edges[:, 1], -edges[:, 0]]) / lengths[:, None]
    opposite = np.roll(lengths, -1)
    middle = linear.matmul(opposite, corners) / lengths.sum()
    inside = float(linear.matmul(corners[0] - middle, normals[0]))
    yield row_of(middle, inside)[None] if 1.0 / inside <= most else np.zeros((0, 4))
    for corner in range(3):
        way = middle - corners[corner]
        sine = inside / float(linear.norm(way))
        ratio = (1.0 - sine) / (1.0 + sine)
        radius, chain = inside, [row_of(middle, inside)]
        while 1.0 / (radius * ratio) <= most:
            radius *= ratio
            chain.append(row_of(corners[corner] + way * (radius / inside), radius))
        yield np.array(chain[1:]).reshape(-1, 4)
        for side in (corner, (corner - 1) % 3):
            line = line_of(normals[side], float(linear.matmul(normals[side], corners[corner])))
            gaps = [[_between(line, big, small), line, big, small] for big, small in itertools.pairwise(chain)]
            # beyond the last of a chain there are gaps that are larger than what it leaves at the corner
            rest = row_of(corners[corner] + way * (radius * ratio / inside), radius * ratio)
            gaps.append([_between(line, chain[-1], rest), line, chain[-1], rest])
            quadruples = np.array(gaps)
            new = quadruples[quadruples[:, 0, 0] <= most]
            yield new[:, 0]
            yield from _in_gaps(new, most, exchanged=(1, 2, 3))


def _between(line: Floats, big: Floats, small: Floats) -> Floats:
    """Return the circle in the gap between a line and two circles that touch it and each other."""
    radius = 1.0 / (math.sqrt(big[0]) + math.sqrt(small[0])) ** 2
    normal, offset = line[1:3], 0.5 * line[3]
    feet = [row[1:3] / row[0] + normal / row[0] for row in (big, small)]
    share = math.sqrt(radius / big[0]) * 2.0 / float(linear.norm(feet[1] - feet[0]))
    foot = feet[0] + share * (feet[1] - feet[0])
    foot += (offset - float(linear.matmul(normal, foot))) * normal
    return row_of(foot - radius * normal, radius)


def _in_gaps(first: Floats, most: float, exchanged: tuple[int, ...] = (0, 1, 2, 3)) -> Iterator[Floats]:
    """Return the circles in the gaps of quadruples (m, 4, 4), each once, by exchanging one circle of each in turn."""
    quadruples, exchange = first, exchanged
    while len(quadruples):
        stop_if_asked()
        children = []
        for old in exchange:
            rest = [k for k in range(4) if k != old]
            new = 2.0 * quadruples[:, rest].sum(axis=1) - quadruples[:, old]
            fits = new[:, 0] <= most
            yield new[fits]
            # the newest comes first: to exchange it again would lead back
            children.append(np.concatenate([new[fits][:, None], quadruples[fits][:, rest]], axis=1))
        quadruples, exchange = np.concatenate(children), (1, 2, 3)


def _around(first: Floats, most: float) -> Iterator[Floats]:
    """Return the spheres in the gaps of five that touch each other, (5, 5), each once.

    In space different exchanges lead to the same five spheres, and different fives hold the same sphere. From any five
    one comes back to the first by exchanging the smallest each time, which never leads to a smaller one, so that no
    five with a sphere beyond the largest curvature is needed.
    """
    fives, names = first[None], _names(first, most)[None]
    known, met = set(names.sum(axis=1).tolist()), set(names[0].tolist())
    while len(fives):
        stop_if_asked()
        children, named = [], []
        for old in range(5):
            new = fives.sum(axis=1) - 2.0 * fives[:, old]
            near = np.flatnonzero((new[:, 0] > fives[:, old, 0]) & (new[:, 0] <= most))
            called = names[near].copy()
            called[:, old] = _names(new[near], most)
            fresh = np.array(_first_of(called.sum(axis=1), known), dtype=np.int64)
            made = fives[near[fresh]].copy()
            made[:, old] = new[near[fresh]]
            children.append(made)
            named.append(called[fresh])
            yield made[_first_of(called[fresh, old], met), old]
        fives, names = np.concatenate(children), np.concatenate(named)


def _first_of(names: Words, known: set[int]) -> list[int]:
    """Return the indices of the names that are not known, each at its first place, and add them."""
    found = []
    for index, name in enumerate(names.tolist()):
        if name not in known:
            known.add(name)
            found.append(index)
    return found


def _names(rows: Floats, most: float) -> Words:
    """Return a number for each sphere, by the cell of its center; centers are two smallest radii apart."""
    # the shift keeps centers in special places away from the faces of cells
    cells = np.floor(rows[:, 1:-1] / rows[:, :1] * most + 0.318).astype(np.int64).astype(np.uint64)
    words = np.where(rows[:, 0] < 0.0, np.uint64(1), np.uint64(0))
    for axis in range(cells.shape[1]):
        words = (words ^ cells[:, axis]) * np.uint64(0x9E3779B97F4A7C15)
        words ^= words >> np.uint64(29)
    return np.asarray(words * np.uint64(0xBF58476D1CE4E5B9))
