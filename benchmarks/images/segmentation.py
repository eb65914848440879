"""Segmentation of grey images whose grains are known: number of grains, Rand error and variation of information.

Packings of spheres, polyhedra and rocks become grey images with blur and noise, of cubes and of voxels that are twice
as long along z; whole, and their middle alone, whose border cuts grains and where only fragments of 512 voxels or more
are counted. Four ways part the same solid: the default of `segment`; a separation of one length, two voxels; a
watershed of scikit-image from every maximum of the distance, smoothed over a voxel; and, where the interpreter named by
the environment variable ``VOXGRAN_PEERS`` has porespy, its SNOW algorithm. Of the first two it is told how many of the
pairs and grains that are wrong are suspects.
"""

import itertools
import logging
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.model import PEERS, panels_of, peer_arrays, write_rows
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.io.image import to_image
from voxgran.lattice.distance import distance_transform
from voxgran.lattice.image import Edges
from voxgran.lattice.segment import Segmentation, segment
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes import sizes
from voxgran.shapes.family import make_shape

LOG = logging.getLogger(__name__)
#: grains, voxels over their mean diameter, and voxels of the smallest body or hole that is no noise
GRAINS, ACROSS, LEAST = 180, 24, 64
#: blur, as standard deviation in voxels, and noise, as that of the grey values over the contrast
QUALITIES = ((1.0, 0.1), (1.5, 0.2))
#: share of the edges of an image that is cut off at each end, and voxels of a fragment that counts as a grain then
CUT, FRAGMENT = 7, 512
FAMILIES = {"spheres": "sphere", "polyhedra": "convex_polyhedron", "rocks": "mollon_zhao"}
#: separation of the ways by `segment`, and the other ways
SEPARATIONS: dict[str, float | None] = {"default": None, "two voxels": 2.0}
WAYS = (*SEPARATIONS, "watershed", "SNOW")
#: seconds after which a peer is stopped
LONGEST = 120


class Row(NamedTuple):
    """A segmentation of an image."""

    grains: str
    packing: str
    solid_fraction_of_the_middle: float
    blur: float
    noise: float
    z_over_x: int
    border: str
    way: str
    true: int
    found: int
    rand_error: float
    information_of_splitting: float
    information_of_merging: float
    cpu_seconds: float
    suspects: int | str
    wrong: int | str
    wrong_suspects: int | str


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
    distance = ndimage.gaussian_filter(_distance(solid, edges), 1.0)
    maxima = load("skimage.morphology").local_maxima(distance) & solid
    found = skimage.watershed(-distance, ndimage.label(maxima, np.ones((3, 3, 3)))[0], mask=solid)
    return np.asarray(found, dtype=np.int64)


def _distance(solid: Booleans, edges: Edges) -> Floats:
    """Return the distance to the void within the image."""
    return np.asarray(distance_transform(solid, voxel_size=edges))


def snow(solid: Booleans, edges: Edges) -> tuple[Integers, float] | None:
    """Return labels by the SNOW algorithm of porespy, and its seconds; None where it is not installed, or fails."""
    script = PEERS / "segmentation_snow.py"
    solids: dict[str, Any] = {"solid": solid, "distance": _distance(solid, edges)}
    found = peer_arrays(script, "solid.npz", lambda path: np.savez(path, **solids), longest=LONGEST)
    return None if found is None else (found[0]["labels"].astype(np.int64), found[1])


def scores(true: NDArray[Any], found: NDArray[Any]) -> tuple[float, float, float]:
    """Return the adapted Rand error, and the variation of information by splitting and by merging, of what both call
    solid.
    """
    both, metrics = (true > 0) & (found > 0), load("skimage.metrics")
    error = metrics.adapted_rand_error(true[both], found[both])[0]
    splitting, merging = metrics.variation_of_information(true[both], found[both])
    return float(error), float(splitting), float(merging)


def judged(true: NDArray[Any], found: Segmentation, counted: int = 1) -> tuple[int, int, int]:
    """Return the numbers of suspects, of labels and pairs that are wrong, and of suspects that are wrong.

    A label is wrong if several grains have most of their voxels in it, and a pair of touching labels if the same grain
    has most voxels of both. Grains of fewer than `counted` voxels are left out, as are suspects of which one is such.
    """
    labels = np.asarray(found)
    both = (true > 0) & (labels > 0)
    shared = load("scipy.sparse").coo_array((np.ones(both.sum()), (labels[both], true[both]))).toarray()
    grain, label, large = shared.argmax(axis=1), shared.argmax(axis=0), shared.sum(axis=0) >= counted
    several = np.bincount(label[large], minlength=len(shared)) > 1
    # a label belongs to a grain that counts
    clear = large[grain] & shared.any(axis=1)

    def split(necks: Any) -> tuple[Booleans, Booleans]:
        one, other = necks["grain"].values, necks["other"].values
        some = clear[one] & clear[other]
        return some, some & (one != other) & (grain[one] == grain[other])

    one, other = (found.suspects[name].values for name in ("grain", "other"))
    some, right = split(found.suspects)
    right |= (one == other) & several[one]
    return int(some.sum()), int(several.sum() + split(found.necks)[1].sum()), int(right.sum())


def measured(made: Iterator[tuple[str, str, Packing]], qualities: Any = QUALITIES, across: int = ACROSS) -> list[Row]:
    """Return the rows of some packings."""
    rows: list[Row] = []
    for name, kind, packing in made:
        labels = true_labels(packing, across)
        inner = labels[tuple(slice(n // 4, n - n // 4) for n in labels.shape)] > 0
        for (blur, noise), slices, cut in itertools.product(qualities, (1, 2), (0, CUT)):
            grey = grey_image(labels > 0, blur=blur, noise=noise, slices=slices)
            # the slice nearest to the middle of a thick one
            true, least, edges = labels[:, :, slices // 2 :: slices], LEAST // slices, (1.0, 1.0, float(slices))
            if cut:
                box = tuple(slice(n // cut, n - n // cut) for n in grey.shape)
                grey, true = grey[box], true[box]
            image = name, kind, float(inner.mean()), blur, noise, slices, "cut" if cut else "whole"
            counted, solid = FRAGMENT // slices if cut else least, np.zeros(0, dtype=np.bool_)
            for way in WAYS:
                told: tuple[int | str, int | str, int | str] = ("", "", "")
                began = time.process_time()
                if way in SEPARATIONS:
                    result = segment(grey, min_size=least, voxel_size=edges, separation=SEPARATIONS[way])
                    seconds, found = time.process_time() - began, np.asarray(result)
                    told, solid = judged(true, result, counted), found > 0
                elif way == "watershed":
                    found = watershed(solid, edges)
                    seconds = time.process_time() - began
                elif (peer := snow(solid, edges)) is not None:
                    found, seconds = peer
                else:
                    LOG.warning("porespy is not installed or failed: its row is left out")
                    continue
                # without the voxels that blur and noise take from them
                many, parts = (int((np.bincount(each[solid])[1:] >= counted).sum()) for each in (true, found))
                rows.append(Row(*image, way, many, parts, *scores(true, found), seconds, *told))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = measured(packings())
    lines = [
        f"{row.grains},{row.packing},{row.solid_fraction_of_the_middle:.3f},{row.blur},{row.noise},{row.z_over_x},"
        f"{row.border},{row.way},{row.true},{row.found},{row.found / row.true:.3f},{row.rand_error:.4f},"
        f"{row.information_of_splitting:.4f},{row.information_of_merging:.4f},{row.cpu_seconds:.2f},"
        f"{row.suspects},{row.wrong},{row.wrong_suspects}"
        for row in rows
    ]
    head = ",".join(Row._fields).replace("found,", "found,found_over_true,")
    _draw(rows, folder / "segmentation.svg")
    return write_rows(folder / "segmentation.csv", head, lines), folder / "segmentation.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw the number of grains and the Rand error of each way, one image beside the other."""
    names = list(dict.fromkeys((row.grains, row.packing) for row in rows))
    with panels_of(path, 2, width=11.0) as (numbers, errors):
        for place, way in enumerate(dict.fromkeys(row.way for row in rows)):
            mine = [row for row in rows if row.way == way]
            at = [names.index((row.grains, row.packing)) + 0.18 * (place - 1.5) for row in mine]
            numbers.plot(at, [row.found / row.true for row in mine], "os^D"[place], alpha=0.7, label=way)
            errors.plot(at, [row.rand_error for row in mine], "os^D"[place], alpha=0.7, label=way)
        numbers.axhspan(0.98, 1.02, alpha=0.15)
        numbers.set(ylabel="grains found over true")
        errors.set(ylabel="adapted Rand error", ylim=(0.0, None))
        for panel in (numbers, errors):
            panel.set_xticks(range(len(names)), ["\n".join(name) for name in names], fontsize=8)
