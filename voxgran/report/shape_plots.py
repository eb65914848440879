"""Plots of the form of grains and of the directions of contact normals."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats
from voxgran.measures.directions import fitted_density
from voxgran.report.plots import ASKED, OTHER, PLACED

#: number of sectors of a rose over half a turn
SECTORS = 18
#: ratio that separates flat and elongated from compact grains
ZINGG = 2 / 3


def plot_zingg(axes: Any, elongation: "ArrayLike", flatness: "ArrayLike") -> Any:
    """Draw grains (n,) by the ratios of the edges of their smallest boxes.

    References
    ----------
    Zingg 1935, Beitrag zur Schotteranalyse, doi:10.3929/ethz-a-000103455
    """
    for line in (axes.axhline, axes.axvline):
        line(ZINGG, color="#808a90", linewidth=1.0, linestyle=(0, (4, 2)))
    for x, y, word in (
        (0.32, 0.97, "flat"),
        (0.85, 0.97, "compact"),
        (0.32, 0.32, "flat and long"),
        (0.85, 0.32, "long"),
    ):
        axes.text(x, y, word, ha="center", va="top", fontsize=10, alpha=0.7)
    _dots(axes, flatness, elongation)
    axes.set(xlim=(0.0, 1.03), ylim=(0.0, 1.03), xlabel="shortest / intermediate", ylabel="intermediate / longest")
    return axes


def plot_roundness(axes: Any, sphericity: "ArrayLike", roundness: "ArrayLike") -> Any:
    """Draw grains (n,) by sphericity and roundness."""
    _dots(axes, roundness, sphericity)
    axes.set(xlim=(-0.03, 1.03), ylim=(0.0, 1.03), xlabel="roundness", ylabel="sphericity")
    return axes


def _dots(axes: Any, x: "ArrayLike", y: "ArrayLike") -> None:
    """Draw pairs of numbers (n,), equal ones as larger dots where there are few different ones."""
    points, counts = np.unique(np.round(np.column_stack([x, y]), 6), axis=0, return_counts=True)
    size = 16 + 220 * counts / counts.sum() if len(counts) <= 50 else 10
    axes.scatter(points[:, 0], points[:, 1], s=size, color=PLACED, alpha=0.75, linewidth=0)


def normal_rose(normals: "ArrayLike", *, dimension: int, down: int | None) -> tuple[Floats, Floats]:
    """Return the distribution of contact normals (m, 3) over direction, relative to an isotropic one; opposite vectors
    are equivalent.

    In 2D angles are measured from x towards y; in 3D from the axis `down` (None stands for z), for all azimuths, and
    the share is relative to the solid angle of each sector. Returned are the middle of each sector over half a turn, in
    radians, (k,), and the share, (k,), 1 everywhere for an isotropic packing.
    """
    way = np.asarray(normals, dtype=np.float64).reshape(-1, 3)
    edges = np.linspace(0.0, np.pi, SECTORS + 1)
    middle = (edges[:-1] + edges[1:]) / 2
    if dimension == 2:
        angle = np.mod(np.arctan2(way[:, 1], way[:, 0]), np.pi)
        expected = np.full(SECTORS, 1.0 / SECTORS)
    else:
        along = np.clip(way[:, 2 if down is None else down], -1.0, 1.0)
        angle = np.arccos(np.concatenate([along, -along]))
        expected = (np.cos(edges[:-1]) - np.cos(edges[1:])) / 2
    count = np.histogram(angle, edges)[0].astype(np.float64)
    return middle, count / max(count.sum(), 1.0) / expected


def plot_rose(
    axes: Any,
    angle: "ArrayLike",
    share: "ArrayLike",
    *,
    upright: bool,
    error: "ArrayLike | None" = None,
    deviator: "ArrayLike | None" = None,
) -> Any:
    """Draw a rose over half a turn, in radians (k,), such as that of :func:`normal_rose`, on polar axes.

    The dashed circle is an isotropic packing. In 3D angles are `upright`, measured from the vertical axis. Standard
    errors (k,) are drawn as bars, and the fabric tensor D of second order (2, 2) of the plane as the density that is
    fitted with it.
    """
    theta, radius = np.asarray(angle, dtype=np.float64), np.asarray(share, dtype=np.float64)
    if upright:
        axes.set_theta_zero_location("N")
        axes.set_theta_direction(-1)
    both, twice = np.concatenate([theta, theta + np.pi]), np.tile(radius, 2)
    axes.bar(both, twice, width=0.96 * np.pi / len(theta), color=PLACED, alpha=0.8, linewidth=0)
    circle = np.linspace(0, 2 * np.pi, 200)
    axes.plot(circle, np.ones(200), color=ASKED, linewidth=1.5, linestyle=(0, (4, 2)))
    top = float(radius.max(initial=0.0))
    if error is not None:
        bars = np.tile(np.asarray(error, dtype=np.float64), 2)
        axes.errorbar(both, twice, yerr=bars, fmt="none", ecolor="#404a50", elinewidth=0.8)
        top = max(top, float((twice + bars).max(initial=0.0)))
    if deviator is not None:
        ways = np.column_stack([np.cos(circle), np.sin(circle)])
        fitted = np.maximum(fitted_density(np.asarray(deviator, dtype=np.float64), ways), 0.0)
        axes.plot(circle, fitted, color=OTHER, linewidth=2.0)
        top = max(top, float(fitted.max()))
    axes.set_rlabel_position(68)
    axes.set_ylim(0, max(1.15 * top, 1.2))
    axes.set_yticks([1.0])
    return axes
