"""Segmentation of grey images whose grains are known: number of grains, Rand error and variation of information.

Packings of spheres, polyhedra and rocks become grey images with blur and noise, of cubes and of voxels that are twice
as long along z. Three ways part the same solid: the default of `segment`; a separation of one length, two voxels; and a
watershed of scikit-image from every maximum of the distance, smoothed over a voxel.
"""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.bench.model import TradeOff, panels_of, write_rows
from voxgran.containers.kinds.box import Box
from voxgran.io.image import to_image
from voxgran.lattice.distance import distance_transform
from voxgran.lattice.image import Edges
from voxgran.lattice.segment import segment
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes import sizes
from voxgran.shapes.family import make_shape

#: grains, voxels over their mean diameter, and voxels of the smallest body or hole that is no noise
GRAINS, ACROSS, LEAST = 180, 24, 64
#: blur, as standard deviation in voxels, and noise, as that of the grey values over the contrast
QUALITIES = ((1.0, 0.1), (1.5, 0.2))
FAMILIES = {"spheres": "sphere", "polyhedra": "convex_polyhedron", "rocks": "mollon_zhao"}
WAYS = ("default", "two voxels", "watershed")

#: grains, packing, solid fraction, blur, noise, voxels along z over x, way, true and found number of grains, Rand
#: error, variation of information by splitting and by merging, processor seconds, suspects
Row = tuple[str, str, float, float, float, int, str, int, int, float, float, float, float, int]


def packings(count: int = GRAINS) -> Iterator[tuple[str, str, Packing]]:
    """Yield shapes, kind and packing: beds at rest, and jammed packings, in boxes of which no grain is cut."""
    law = sizes.lognormal(1.0, 0.2)
    edge = (count * 1.07) ** (1 / 3)
    for name, family in FAMILIES.items():
        shapes = [make_shape(family, seed=seed) for seed in range(1 if name == "spheres" else 12)]
        growth: dict[str, Any] = {} if name == "spheres" else {"growth_rate": 0.1}
        box = Box((edge, edge, edge))
        yield name, "jammed", pack(shapes, box, "jam", count=count, sizes=law, seed=1, **growth)
        column = Box((edge, edge, 2 * edge))
        yield name, "at rest", pack(shapes, column, "gravity", count=count, sizes=law, friction=0.2, seed=1)


def true_labels(packing: Packing, across: int = ACROSS) -> NDArray[Any]:
    """Return the labels of a packing up to its highest grain, with an even number of slices."""
    size = float(packing.container.bounds[1][0]) / round(float(packing.container.bounds[1][0]) * across)
    labels = to_image(packing, size)
    top = int(np.flatnonzero(labels.any(axis=(0, 1)))[-1]) + 2
    return labels[:, :, : min(top, labels.shape[2]) // 2 * 2]


def grey_image(solid: Booleans, *, blur: float, noise: float, slices: int) -> Floats:
    """Return grey values, 0 for void and 1 for solid, with blur and noise; each voxel is the mean of some along z."""
    soft = load("scipy.ndimage").gaussian_filter(solid.astype(np.float64), blur)
    thick = soft.reshape(*soft.shape[:2], -1, slices).mean(axis=3)
    return np.asarray(thick + stream(0, "noise").normal(0.0, noise, thick.shape))


def watershed(solid: Booleans, edges: Edges) -> Integers:
    """Return labels of a plain watershed: a seed at each maximum of the distance, smoothed over a voxel."""
    ndimage, skimage = load("scipy.ndimage"), load("skimage.segmentation")
    distance = ndimage.gaussian_filter(distance_transform(np.pad(solid, 1), voxel_size=edges)[1:-1, 1:-1, 1:-1], 1.0)
    maxima = load("skimage.morphology").local_maxima(distance) & solid
    found = skimage.watershed(-distance, ndimage.label(maxima, np.ones((3, 3, 3)))[0], mask=solid)
    return np.asarray(found, dtype=np.int64)


def scores(true: NDArray[Any], found: NDArray[Any]) -> tuple[float, float, float]:
    """Return the adapted Rand error, and the variation of information by splitting and by merging, of what both call
    solid.
    """
    both, metrics = (true > 0) & (found > 0), load("skimage.metrics")
    error = metrics.adapted_rand_error(true[both], found[both])[0]
    splitting, merging = metrics.variation_of_information(true[both], found[both])
    return float(error), float(splitting), float(merging)


def measured(made: Iterator[tuple[str, str, Packing]], qualities: Any = QUALITIES, across: int = ACROSS) -> list[Row]:
    """Return the rows of some packings."""
    rows: list[Row] = []
    for name, kind, packing in made:
        labels = true_labels(packing, across)
        for (blur, noise), slices in ((quality, slices) for quality in qualities for slices in (1, 2)):
            grey, edges = grey_image(labels > 0, blur=blur, noise=noise, slices=slices), (1.0, 1.0, float(slices))
            # the slice nearest to the middle of a thick one
            true, least = labels[:, :, slices // 2 :: slices], LEAST // slices
            ways: dict[str, Callable[[], Any]] = {
                "default": lambda: segment(grey, min_size=least, voxel_size=edges),  # noqa: B023
                "two voxels": lambda: segment(grey, min_size=least, voxel_size=edges, separation=2.0),  # noqa: B023
                "watershed": lambda: watershed(solid, edges),  # noqa: B023
            }
            for way in WAYS:
                began = time.process_time()
                result = ways[way]()
                seconds = time.process_time() - began
                solid = np.asarray(result > 0)
                parted = np.asarray(result)
                suspects = 0 if way == "watershed" else int(result.suspects.sizes["neck"])
                many = len(np.unique(parted[parted > 0]))
                inner = labels[tuple(slice(n // 4, n - n // 4) for n in labels.shape)] > 0
                numbers = (packing.count, many, *scores(true, parted), seconds, suspects)
                rows.append((name, kind, float(inner.mean()), blur, noise, slices, way, *numbers))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = measured(packings())
    lines = [
        f"{name},{kind},{solid:.3f},{blur},{noise},{slices},{way},{true},{found},{found / true:.3f},{rand:.4f},"
        f"{split:.4f},{merge:.4f},{seconds:.2f},{suspects}"
        for name, kind, solid, blur, noise, slices, way, true, found, rand, split, merge, seconds, suspects in rows
    ]
    head = (
        "grains,packing,solid_fraction_of_the_middle,blur,noise,z_over_x,way,true,found,found_over_true,rand_error,"
        "information_of_splitting,information_of_merging,processor_seconds,suspects"
    )
    _draw(rows, folder / "segmentation.svg")
    return write_rows(folder / "segmentation.csv", head, lines), folder / "segmentation.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw the number of grains and the Rand error of each way, one image beside the other."""
    names = list(dict.fromkeys((row[0], row[1]) for row in rows))
    with panels_of(path, 2, width=11.0) as (numbers, errors):
        for place, way in enumerate(WAYS):
            mine = [row for row in rows if row[6] == way]
            at = [names.index((row[0], row[1])) + 0.22 * (place - 1) for row in mine]
            numbers.plot(at, [row[8] / row[7] for row in mine], "os^"[place], alpha=0.7, label=way)
            errors.plot(at, [row[9] for row in mine], "os^"[place], alpha=0.7, label=way)
        numbers.axhspan(0.98, 1.02, alpha=0.15)
        numbers.set(ylabel="grains found over true")
        errors.set(ylabel="adapted Rand error", ylim=(0.0, None))
        for panel in (numbers, errors):
            panel.set_xticks(range(len(names)), ["\n".join(name) for name in names], fontsize=8)


registration = TradeOff(
    name="segmentation",
    summary="segmentation of grey images: grains found over true, Rand error and seconds, beside a plain watershed",
    run=run,
)
