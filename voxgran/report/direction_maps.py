"""Equal-area maps of directions in space (Schmidt net), with the density that is fitted to them."""

import contextlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.measures.directions import fitted_density

#: points of the map along the radius and around it at which the fitted density is computed
RADII, TURNS = 25, 73


def plot_direction_map(
    axes: Any, polar: "ArrayLike", azimuth: "ArrayLike", density: "ArrayLike", *, deviator: "ArrayLike", pole: int = 2
) -> Any:
    """Draw the density of directions on the hemisphere around an axis, in Lambert's equal-area projection.

    Parameters
    ----------
    axes : matplotlib axes
        Polar axes; the pole is their center, the equator their rim.
    polar, azimuth : (k, 2) array_like of float
        Angles from the pole and azimuths, from and to, of the cells, in radians.
    density : (k,) array_like of float
        Density in each cell, relative to an isotropic distribution.
    deviator : (3, 3) array_like of float
        Fabric tensor D of second order, whose density is drawn as contour lines.
    pole : int
        Axis in the center; azimuths are measured from the next axis towards the one after it.

    References
    ----------
    Lambert 1772, the projection; Kanatani 1984, doi:10.1016/0020-7225(84)90055-7, the fitted density
    """
    colatitude, turn = np.asarray(polar, dtype=np.float64), np.asarray(azimuth, dtype=np.float64)
    values, tensor = np.asarray(density, dtype=np.float64), np.asarray(deviator, dtype=np.float64)
    most = max(float(np.abs(values - 1.0).max(initial=0.0)), 0.1)
    scale = load("matplotlib.colors").TwoSlopeNorm(1.0, max(1.0 - most, 0.0), 1.0 + most)
    colors = load("matplotlib").colormaps["PuOr_r"]
    # of the projection, 1 at the equator
    inner, outer = np.sqrt(np.maximum(1.0 - np.cos(colatitude.T), 0.0))
    width = turn[:, 1] - turn[:, 0]
    axes.bar(
        turn[:, 0], outer - inner, width=width, bottom=inner, align="edge", color=colors(scale(values)), linewidth=0
    )
    _draw_fitted(axes, tensor, pole)
    axes.set(ylim=(0.0, 1.0), yticks=[])
    axes.set_xticks(np.arange(4) * np.pi / 2)
    one, two = ("xyz"[(pole + k) % 3] for k in (1, 2))
    axes.set_xticklabels([f"+{one}", f"+{two}", f"\u2212{one}", f"\u2212{two}"])
    axes.grid(visible=False)
    map_of = load("matplotlib.cm").ScalarMappable(scale, colors)
    axes.figure.colorbar(map_of, ax=axes, shrink=0.7, pad=0.12, label="density / isotropic")
    return axes


def _draw_fitted(axes: Any, deviator: Floats, pole: int) -> None:
    """Draw contour lines of the fitted density; none where it is the same everywhere."""
    radius, turn = np.meshgrid(np.linspace(0.0, 1.0, RADII), np.linspace(0.0, 2.0 * np.pi, TURNS), indexing="ij")
    high = 1.0 - radius**2
    level = np.sqrt(np.maximum(1.0 - high**2, 0.0))
    way = np.empty((*radius.shape, 3))
    for axis, along in zip((1, 2, 0), (level * np.cos(turn), level * np.sin(turn), high), strict=True):
        way[..., (pole + axis) % 3] = along
    fitted = fitted_density(deviator, way.reshape(-1, 3)).reshape(radius.shape)
    if not np.isfinite(fitted).all() or np.ptp(fitted) < 1e-6:
        return
    lines = axes.contour(turn, radius, fitted, levels=5, colors="#404a50", linewidths=1.0)
    # matplotlib finds no place for the label of a line at whose very beginning it would stand
    with contextlib.suppress(IndexError):
        axes.clabel(lines, fontsize=8, fmt="%.2f")
