"""Local solid fraction of each grain: its volume over that of its Voronoi cell, cut by the walls.

Spheres and disks of any sizes have the cells of the Laguerre tessellation, also called radical or power cells. Other
grains have set Voronoi cells (Schaller et al. 2013, doi:10.1080/14786435.2013.834389): all points that are nearer to
the surface of the grain than to that of another. They consist of the cells of points on the surfaces.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, as_count
from voxgran.measures.cells import cell_volumes
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.packing.model import Packing
from voxgran.points.blue_noise import spread_points
from voxgran.points.sample import sample_surface
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline

#: points on the surface of a grain, and of all grains together, by default; fewest points
POINTS, ALL_POINTS, FEWEST = 80, 400_000, 12
#: share of the points with which the error is estimated
COARSE = 4
#: bins of the distribution, and largest local solid fraction in them
BINS, LARGEST = 50, 1.0
#: quantiles of the distribution
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True, eq=False)
class LocalDensity:
    """Cells of the grains and their local solid fractions."""

    cell_volume: Floats  # (n,) volumes of the cells within the container, in 2D areas
    # (n,) volume of each grain over that of its cell; NaN where the grain has no cell, being inside of others
    solid_fraction: Floats
    error: float  # root mean square error of a local solid fraction; 0 if exact

    @property
    def mean(self) -> float:
        """Mean over the grains; NaN without any."""
        known = self.solid_fraction[np.isfinite(self.solid_fraction)]
        return float(known.mean()) if len(known) else math.nan

    @property
    def standard_deviation(self) -> float:
        """Standard deviation over the grains; NaN without any."""
        known = self.solid_fraction[np.isfinite(self.solid_fraction)]
        return float(known.std()) if len(known) else math.nan


def local_density(packing: Packing, *, points: int | None = None) -> LocalDensity:
    """Return the volumes of the Voronoi cells of the grains and their local solid fractions.

    Cells are cut by the walls and continue across periodic faces; their volumes add up to that of the container, to
    rounding. Cells of spheres and disks are exact. Other grains are represented by `points` on the surface of each, at
    least 12; by default 80, or fewer where all grains have more than 400 000 together. The error is estimated by the
    difference from a quarter of the points. In a container that is known by its mesh only, it includes the difference
    of the volumes.

    Raises
    ------
    InputError
        If `points` is less than 12, or grains are fixed.
    """
    packing.refuse_fixed("the local solid fraction")
    wanted = POINTS if points is None else as_count(points, "points", at_least=FEWEST)
    if points is None and packing.count:
        wanted = int(np.clip(ALL_POINTS // packing.count, FEWEST, POINTS))
    if all(packing.shapes[k].is_sphere for k in np.unique(packing.shape_id)):
        return _density(packing, cell_volumes(packing.position, packing.bounding_radii**2, packing.container), 0.0)
    cells = set_voronoi(packing, wanted)
    fine, coarse = (_shares(packing, found) for found in (cells, set_voronoi(packing, max(wanted // COARSE, 6))))
    both = np.isfinite(fine) & np.isfinite(coarse)
    error = float(np.sqrt(np.mean((fine - coarse)[both] ** 2))) if both.any() else math.nan
    return _density(packing, cells, error)


def set_voronoi(packing: Packing, points: int) -> Floats:
    """Return the volumes (n,) of the set Voronoi cells, from about so many points on the surface of each grain."""
    found, owner = [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]
    for k in np.unique(packing.shape_id):
        mine = np.flatnonzero(packing.shape_id == k)
        body = surface_points(packing.shapes[k], points)
        turned = linear.einsum("gij,pj->gpi", packing.matrices[mine] * packing.scale[mine, None, None], body)
        found.append((turned + packing.position[mine, None]).reshape(-1, 3))
        owner.append(np.repeat(mine, len(body)))
    place = np.concatenate(found)
    cells = cell_volumes(place, np.zeros(len(place)), packing.container)
    volumes: Floats = np.bincount(np.concatenate(owner), weights=cells, minlength=packing.count).astype(np.float64)
    return volumes


def surface_points(shape: Shape, points: int) -> Floats:
    """Return about so many points on the surface of a shape, at nearly equal distances; they are the same each time."""
    if isinstance(shape.geometry, Outline):
        return np.asarray(sample_surface(shape, spacing=shape.surface_area / points))
    size = shape.bounding_radius
    return spread_points(shape.vertices / size, shape.faces, points, seed=0) * size


def _shares(packing: Packing, cells: Floats) -> Floats:
    """Return the volumes of the grains over those of their cells, NaN where there is no cell."""
    return np.divide(packing.volumes, cells, out=np.full(packing.count, np.nan), where=cells > 0)


def _density(packing: Packing, cells: Floats, error: float) -> LocalDensity:
    """Return local solid fractions; the error includes that of the container's volume."""
    shares, volume = _shares(packing, cells), packing.container.volume
    missed = abs(float(cells.sum()) / volume - 1.0) if packing.count else 0.0
    if missed > 1e-9:
        error = math.hypot(error, missed * float(np.nanmean(shares)))
    return LocalDensity(cells, shares, error)


def _compute(packing: Packing) -> Groups:
    """Return local solid fractions of the grains and their distribution."""
    found = local_density(packing)
    size, kind = length_unit(packing, power=packing.dimension), "volume" if packing.dimension == 3 else "area"
    error = found.error or None
    known = found.solid_fraction[np.isfinite(found.solid_fraction)]
    whole = {
        "local_solid_fraction_mean": variable((), found.mean, "1", "mean local solid fraction", error=error),
        "local_solid_fraction_std": variable(
            (), found.standard_deviation, "1", "standard deviation of the local solid fraction", error=error
        ),
    }
    grains = {
        "cell_volume": variable(("grain",), found.cell_volume, size, f"{kind} of the Voronoi cell of each grain"),
        "local_solid_fraction": variable(
            ("grain",), found.solid_fraction, "1", f"{kind} of each grain over that of its Voronoi cell", error=error
        ),
    }
    return {"/": dataset(whole), "/grains": dataset(grains), "/local_density": _distribution(known)}


def _distribution(known: Floats) -> Any:
    """Return the probability density and the quantiles of local solid fractions."""
    edges = np.linspace(0.0, max(LARGEST, float(known.max(initial=0.0))), BINS + 1)
    counts = np.histogram(known, edges)[0]
    density = counts / (max(len(known), 1) * np.diff(edges))
    quantiles = np.quantile(known, QUANTILES) if len(known) else np.full(len(QUANTILES), np.nan)
    bins, levels = ("local_solid_fraction_bin",), ("quantile",)
    values = {
        "probability_density": variable(bins, density, "1", "probability density of the local solid fraction"),
        "local_solid_fraction_quantile": variable(levels, quantiles, "1", "quantile of the local solid fraction"),
    }
    coordinates = {
        bins[0]: variable(bins, (edges[1:] + edges[:-1]) / 2, "1", "local solid fraction, middle of the bin"),
        levels[0]: variable(levels, np.array(QUANTILES), "1", "share of the grains with at most this value"),
    }
    return dataset(values, coordinates)


registration = Measure(
    summary="Voronoi cells of the grains and local solid fractions: Laguerre cells of spheres, set Voronoi cells",
    groups=("/", "/grains", "/local_density"),
    compute=_compute,
    usual=False,
    applies=lambda packing: packing.fixed is None,
    sees_fixed=True,
)
