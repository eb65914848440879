"""Advancing front: seconds, density and how well spheres touch, from thousands to millions, beside a plain program.

The plain program advances the same front, a sphere a face, with arrays of NumPy and near spheres found by SciPy's
trees: what a user would write in an afternoon. The paper gives 86 seconds for 50,000 particles on a PC of 2.8 GHz;
machines, years and compilers differ. Seconds are CPU seconds, of one thread.
"""

import math
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from benchmarks.peers import front as peers
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes import sizes as laws
from voxgran.shapes.family import make_shape
from voxgran.shapes.sizes import SizeDistribution

#: program, grains, seconds, seconds for 50,000, solid fraction inside, worst residual of a contact in radii, solid
#: fraction of the whole container where it was filled
Row: TypeAlias = tuple[str, int, float, float, float, float, float]
#: how often each is timed, and points in which the solid fraction inside is measured
REPEATS, POINTS = 3, 100_000
COUNTS = {"large": (50_000, 500_000, 5_000_000), "loose": (50_000,), "dense": (50_000, 500_000), "disks": (1_000_000,)}
PLAIN = 2000


def seconds_of(
    count: int, *, disks: bool = False, fill: float = 0.0, sizes: SizeDistribution | None = None, **options: Any
) -> tuple[float, Packing]:
    """Return the least CPU time for packing so many equal grains, or grains of these sizes, and the packing.

    `fill` is the mean volume of the grains where they shall fill a box, about as many as asked; 0 where the box is
    wide. Options are parameters of the method.
    """
    edge = (count * fill / 0.6) ** (1 / 3) if fill else 1.26 * count ** (1 / 3)
    container = Rectangle((1.15 * count**0.5,) * 2) if disks else Box((edge,) * 3)
    shape, best = make_shape("disk" if disks else "sphere"), np.inf
    asked = {"count": None if fill else count, "sizes": sizes, "seed": 1, **options}
    for _ in range(REPEATS if count <= 100_000 else 1):
        packing, seconds = timed(pack, shape, container, "advancing_front", **asked)
        best = min(best, seconds)
    return best, packing


def inner_fraction(packing: Packing) -> float:
    """Return the share of random points in a sphere of half the size of the packing that lie in a grain."""
    places, radii = packing.position, np.append(packing.bounding_radii, 0.0)
    low, high = places.min(axis=0), places.max(axis=0)
    generator, d = stream(1, "bench points"), packing.dimension
    ways = np.zeros((POINTS, 3))
    ways[:, :d] = generator.normal(size=(POINTS, d))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    reach = (high - low)[:d].min() / 4 * generator.random((POINTS, 1)) ** (1 / d)
    away, grain = (
        load("scipy.spatial")
        .cKDTree(places)
        .query((low + high) / 2 + ways * reach, k=16, distance_upper_bound=float(radii.max()))
    )
    return float((away <= radii[grain]).any(axis=1).mean())


def residual(packing: Packing) -> float:
    """Return how far the worst contact is from touching, in radii of the smaller grain.

    A contact is a pair whose gap is less than 1e-11 of the smaller one: at others spheres happen to be near each other.
    """
    radii = packing.bounding_radii
    tree = load("scipy.spatial").cKDTree(packing.position)
    pairs = tree.query_pairs(2.000002 * float(radii.max()), output_type="ndarray")
    gap = np.linalg.norm(packing.position[pairs[:, 0]] - packing.position[pairs[:, 1]], axis=1)
    gap = (gap - radii[pairs].sum(axis=1)) / radii[pairs].min(axis=1)
    return float(np.abs(gap[np.abs(gap) < 1e-11]).max(initial=0.0))


def measure(counts: dict[str, tuple[int, ...]] | None = None, *, plain: int = PLAIN) -> list[Row]:
    """Pack equal and graded grains, as many as `counts` says of ``"large"``, ``"loose"``, ``"dense"`` and ``"disks"``,
    and `plain` by the plain program.
    """
    asked, rows = COUNTS if counts is None else counts, []
    graded = laws.uniform(0.5, 1.5)
    cases: dict[str, tuple[str, dict[str, Any]]] = {
        "loose, nearest": ("large", {}),
        "loose, random": ("loose", {"order": "random"}),
        "loose, lowest": ("loose", {"order": "lowest"}),
        "loose, graded": ("loose", {"sizes": graded}),
        "dense": ("dense", {"mode": "dense"}),
        "dense, lowest": ("loose", {"mode": "dense", "order": "lowest"}),
        "dense, graded": ("loose", {"mode": "dense", "sizes": graded}),
        "dense, filled": ("loose", {"mode": "dense", "fill": math.pi / 6}),
        "dense, graded, filled": ("loose", {"mode": "dense", "sizes": graded, "fill": 1.25 * math.pi / 6}),
        "disks, graded": ("disks", {"disks": True, "sizes": graded}),
    }
    for name, (kind, options) in cases.items():
        seconds_of(200, **options)
        for count in asked[kind]:
            seconds, packing = seconds_of(count, **options)
            # contacts of millions would take as long as the packing
            worst = residual(packing) if count <= 1_000_000 else np.nan
            whole = packing.solid_fraction if "fill" in options else np.nan
            each = seconds / packing.count * 50_000
            rows.append((name, packing.count, seconds, each, inner_fraction(packing), worst, whole))
    seconds, places = peers.plain_front(plain)
    sphere, edge = make_shape("sphere"), float(np.ptp(places, axis=0).max() + 2)
    shown = Packing.of([sphere], Box((edge,) * 3), position=places - places.min(axis=0) + 1)
    each = seconds / plain * 50_000
    rows.append(("NumPy and SciPy, loose", plain, seconds, each, inner_fraction(shown), residual(shown), np.nan))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = measure()
    head = (
        "program,grains,seconds:.3f,seconds_for_50000:.4f,inner_solid_fraction:.4f,residual_in_radii:.1e,"
        "whole_solid_fraction:.4f"
    )
    _draw(rows, folder / "front.svg")
    return write_rows(folder / "front.csv", head, rows), folder / "front.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw seconds against grains on the left, density against seconds for 50,000 on the right."""
    with panels_of(path, 2, width=9.0, height=6.0, legend=0) as (left, right):
        for k, name in enumerate(dict.fromkeys(row[0] for row in rows)):
            found, marker = [row for row in rows if row[0] == name], "os^D"[k // 10]
            left.loglog([row[1] for row in found], [row[2] for row in found], f"C{k}-", marker=marker, label=name)
            right.semilogx([row[3] for row in found], [row[4] for row in found], f"C{k}-", marker=marker, label=name)
        left.set(xlabel="grains", ylabel="CPU seconds")
        right.set(xlabel="seconds for 50,000 grains", ylabel="solid fraction inside")
        left.legend(frameon=False, fontsize=9, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.12))
