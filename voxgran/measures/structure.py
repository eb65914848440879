"""Structure factor of points: on the vectors of a reciprocal lattice, or from the radial distribution function.

``S(k) = |sum of exp(-i k x)|**2 / n``; it is 1 on average for independent points, and tends to the relative variance of
numbers of points in large windows where k tends to 0 (Hansen & McDonald, Theory of Simple Liquids).
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran._base.seeds import stream

#: vectors of a shell, at most: half of all, since those of opposite sign have the same value
MOST_VECTORS = 60


@dataclass(frozen=True, eq=False)
class StructureFactor:
    """Structure factor by wave number."""

    wave_number: Floats  # (k,) mean of the vectors of each shell, in radians per unit of length
    value: Floats  # (k,) mean over the vectors of a shell, or transform of g(r)
    error: Floats  # (k,) standard error
    vectors: Integers  # (k,) number of vectors of a shell, those of opposite sign once; 0 from g(r)


def lattice_structure(points: Floats, periods: Floats, *, reach: float, step: float) -> StructureFactor:
    """Return the structure factor of points (n, d) with the periods (d, d), in shells of width `step` up to `reach`.

    It is exact on each vector of the reciprocal lattice; of a shell with more than 60, 60 are drawn.
    """
    chosen = _vectors(periods, reach, step)
    length = np.linalg.norm(chosen @ reciprocal(periods), axis=1)
    power = np.zeros(len(chosen))
    d, turns = len(periods), np.zeros((len(points), 3))
    turns[:, :d] = np.linalg.solve(periods.T, points.T).T % 1.0 * 2 * np.pi
    vectors = np.zeros((len(chosen), 3), np.int64)
    vectors[:, :d] = chosen
    if len(points) and len(chosen):
        real, imaginary = np.zeros(len(chosen)), np.zeros(len(chosen))
        _add_waves(turns, vectors, np.abs(vectors).max(axis=0), real, imaginary)
        power = (real**2 + imaginary**2) / len(points)
    shell = np.floor(length / step).astype(np.int64)
    many = np.bincount(shell)
    kept = many > 0
    divide = np.maximum(many, 1)
    mean = np.bincount(shell, weights=power) / divide
    spread = np.bincount(shell, weights=(power - mean[shell]) ** 2) / np.maximum(many - 1, 1)
    error = np.where(many > 1, np.sqrt(spread / divide), np.nan)
    place = np.bincount(shell, weights=length) / divide
    return StructureFactor(place[kept], mean[kept], error[kept], many[kept])


def transformed_structure(
    edges: Floats, g: Floats, error: Floats, *, density: float, dimension: int, waves: Floats
) -> StructureFactor:
    """Return the structure factor at wave numbers from the radial distribution function in bins.

    The end of g(r) at the last edge R is smoothed by Lorch's window, sin(pi r / R) / (pi r / R) (Lorch 1969,
    doi:10.1088/0022-3719/2/2/305), so that peaks are about 2 pi / R wide. Errors of the bins count as independent.
    """
    middle = (edges[1:] + edges[:-1]) / 2
    shell = np.diff(4 / 3 * np.pi * edges**3 if dimension == 3 else np.pi * edges**2)
    phase = waves[:, None] * middle
    wave = np.sinc(phase / np.pi) if dimension == 3 else load("scipy.special").j0(phase)
    weight = density * shell * np.sinc(middle / edges[-1]) * wave
    known = np.isfinite(g)
    value = 1 + weight[:, known] @ (g[known] - 1)
    spread = np.sqrt(weight[:, known] ** 2 @ error[known] ** 2)
    return StructureFactor(waves, value, spread, np.zeros(len(waves), np.int64))


def reciprocal(periods: Floats) -> Floats:
    """Return the vectors of the reciprocal lattice (d, d), in the rows, of periods (d, d)."""
    return np.asarray(2 * np.pi * np.linalg.inv(periods).T)


def _vectors(periods: Floats, reach: float, step: float) -> Integers:
    """Return whole-number vectors (m, d) of the reciprocal lattice of periods (d, d), one of each opposite pair."""
    d, unit = len(periods), reciprocal(periods)
    # within this sphere all vectors are listed; they are some thousands
    inner = min(reach, float((MOST_VECTORS * 40 * abs(np.linalg.det(unit))) ** (1 / d)))
    most = np.floor(inner * np.linalg.norm(periods, axis=1) / (2 * np.pi) * (1 + 1e-12)).astype(np.int64)
    axes = [np.arange(-n, n + 1) for n in most]
    every = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, d)
    generator = stream(0, "wave vectors")
    aims = np.arange(inner, reach, step / MOST_VECTORS / 2) if reach > inner else np.zeros(0)
    directions = generator.standard_normal((len(aims), d))
    directions *= (aims / np.linalg.norm(directions, axis=1))[:, None]
    drawn = np.round(directions @ periods.T / (2 * np.pi)).astype(np.int64)
    drawn = drawn[np.linalg.norm(drawn @ unit, axis=1) > inner]
    found = np.concatenate([every[np.linalg.norm(every @ unit, axis=1) <= inner], drawn])
    # the first coordinate that is not 0 is above 0
    leading = found[np.arange(len(found)), (found != 0).argmax(axis=1)]
    found = np.unique(found[leading != 0] * np.sign(leading[leading != 0])[:, None], axis=0)
    length = np.linalg.norm(found @ unit, axis=1)
    found, length = found[length < reach], length[length < reach]
    shell = np.floor(length / step).astype(np.int64)
    order = np.lexsort((generator.random(len(found)), shell))
    rank = np.arange(len(found)) - np.searchsorted(shell[order], shell[order])
    return np.asarray(found[np.sort(order[rank < MOST_VECTORS])])


@kernel
def _add_waves(turns, vectors, most, real, imaginary):  # type: ignore[no-untyped-def]
    """Add the waves of all points along each vector; powers of the wave along each axis are made once per point."""
    size = max(most[0], most[1], most[2]) + 1
    cosine, sine = np.ones((3, size)), np.zeros((3, size))
    for i in range(len(turns)):
        for a in range(3):
            c, s = np.cos(turns[i, a]), np.sin(turns[i, a])
            for n in range(1, most[a] + 1):
                cosine[a, n] = cosine[a, n - 1] * c - sine[a, n - 1] * s
                sine[a, n] = cosine[a, n - 1] * s + sine[a, n - 1] * c
        for v in range(len(vectors)):
            kx, ky, kz = vectors[v, 0], vectors[v, 1], vectors[v, 2]
            c, s = cosine[0, kx], sine[0, kx]
            cy, sy = cosine[1, abs(ky)], sine[1, abs(ky)]
            cz, sz = cosine[2, abs(kz)], sine[2, abs(kz)]
            sy = -sy if ky < 0 else sy
            sz = -sz if kz < 0 else sz
            c, s = c * cy - s * sy, c * sy + s * cy
            real[v] += c * cz - s * sz
            imaginary[v] += c * sz + s * cz
