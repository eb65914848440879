"""Distances: seconds of the exact transform beside SciPy's, and error of signed distances against voxels per radius.

Squared distances are whole numbers; those that differ from SciPy's are counted. Signed distances are compared
within two voxels of the surface of a sphere: those from the triangles with the exact distance from them in double
precision, those from shares of voxels and from a binary mask with the distance from the true sphere.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.model import least_seconds, panels_of, write_rows
from voxgran._base.arrays import Booleans, Floats
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.geometry.tree import grow_tree
from voxgran.lattice.distance import distance_transform
from voxgran.lattice.grid import Grid
from voxgran.shapes.family import make_shape
from voxgran.voxels.closed_form import spheres_bits
from voxgran.voxels.occupy import voxelize
from voxgran.voxels.signed_distance import signed_distance

EDGES = (64, 128, 256)
#: voxels per radius of the sphere whose signed distances are looked at
RADII = (6, 11, 22, 45)
#: share of the images that grains take
SOLID = 0.6


def bench_images(n: int) -> dict[str, Booleans]:
    """Return images of grains, of the pores between them, and of one sphere, n voxels along each edge."""
    generator, grid = stream(0, "bench grains", n), Grid((0.0, 0.0, 0.0), 1.0, (n, n, n))
    radius = n / 26
    count = int(-np.log(1 - SOLID) / (4 / 3 * np.pi * 1.05 * radius**3 / n**3))
    centers, radii = generator.uniform(0, n, (count, 3)), radius * generator.uniform(0.7, 1.3, count)
    grains = spheres_bits(centers, radii, grid, cover="center").unpacked()
    sphere = spheres_bits(np.full((1, 3), n / 2), np.array([0.45 * n]), grid, cover="center").unpacked()
    return {"grains": grains, "pores": ~grains, "sphere": sphere}


def measure_transforms(edges: tuple[int, ...] = EDGES) -> list[tuple[str, int, float, float, float, int]]:
    """Time the exact transform and SciPy's on images of so many voxels along each edge.

    Return image, voxels along an edge, seconds on one thread, on two and of SciPy, and squared distances that differ.
    """
    scipy: Callable[[Booleans], Floats] = load("scipy.ndimage").distance_transform_edt
    rows = []
    for n in edges:
        for name, mask in bench_images(n).items():
            wrong = np.round(scipy(mask) ** 2) != distance_transform(mask, squared=True)
            one = least_seconds(lambda: distance_transform(mask, threads=1), repeats=5)  # noqa: B023
            two = least_seconds(lambda: distance_transform(mask, threads=2), repeats=5)  # noqa: B023
            rows.append((name, n, one, two, least_seconds(lambda: scipy(mask), repeats=2), int(wrong.sum())))  # noqa: B023
    return rows


def measure_signed(radii: tuple[int, ...] = RADII) -> list[tuple[str, int, float, float]]:
    """Compare signed distances with those of a true sphere, by voxels per radius.

    Return source, voxels per radius, seconds, and root mean square error in voxels within two voxels of the surface.
    """
    sphere, rows = make_shape("sphere"), []
    tree = grow_tree(sphere.vertices, sphere.faces)
    for cells in radii:
        size = 0.5 / cells
        low = -(cells + 6.3) * size
        grid = Grid((low, low, low), size, (2 * cells + 13,) * 3)
        place = grid.coordinates(np.argwhere(np.ones(grid.shape)))
        true = ((np.linalg.norm(place, axis=1) - 0.5) / size).reshape(grid.shape)
        near = np.abs(true) < 2
        sources: dict[str, Callable[[], Floats]] = {
            "mesh": lambda: signed_distance(sphere, grid=grid).values / size,  # noqa: B023
            "fraction": lambda: signed_distance(sphere, grid=grid, source="fraction").values / size,  # noqa: B023
            "binary mask": lambda: _from_mask(voxelize(sphere, grid=grid).mask),  # noqa: B023
        }
        facets = tree.signed_distance(place[near.ravel()]) / size
        for name, work in sources.items():
            exact = facets if name == "mesh" else true[near]
            error = float(np.sqrt(np.mean((work()[near] - exact) ** 2)))
            rows.append((name, cells, least_seconds(work, repeats=2), error))
    return rows


def _from_mask(mask: Booleans) -> Floats:
    """Return what a binary mask alone tells of the signed distance."""
    outside = distance_transform(~mask).astype(np.float64)
    return np.where(mask, 0.5 - distance_transform(mask), outside - 0.5)


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    transforms, signed = measure_transforms(), measure_signed()
    head = "image,voxels_along_edge,seconds:.5f,seconds_two_threads:.5f,seconds_scipy:.5f,ratio:.1f,squares_that_differ"
    rows = [(*row[:5], row[4] / row[2], row[5]) for row in transforms]
    signed_head = "source,voxels_per_radius,seconds:.5f,rms_error_in_voxels:.2e"
    _draw(transforms, signed, folder / "distance.svg")
    return (
        write_rows(folder / "distance.csv", head, rows),
        write_rows(folder / "signed_distance.csv", signed_head, signed),
        folder / "distance.svg",
    )


def _draw(
    transforms: list[tuple[str, int, float, float, float, int]], signed: list[tuple[str, int, float, float]], path: Path
) -> None:
    """Draw seconds against voxels on the left, and error against seconds of signed distances on the right."""
    with panels_of(path, 2, width=9.6) as (left, right):
        for color, name in zip(("C0", "C1", "C2"), ("grains", "pores", "sphere"), strict=True):
            part = [row for row in transforms if row[0] == name]
            voxels = [row[1] ** 3 for row in part]
            left.loglog(voxels, [row[4] for row in part], color + ":", marker="s", label=f"SciPy, {name}")
            left.loglog(voxels, [row[2] for row in part], color + "-", marker="o", label=f"voxgran, {name}")
        title = "exact distance transform, no square differs"
        left.set(xlabel="voxels", ylabel="seconds, one thread", title=title)
        for name in ("mesh", "fraction", "binary mask"):
            line = [row for row in signed if row[0] == name]
            right.loglog([row[2] for row in line], [row[3] for row in line], marker="o", label=name)
        title = "signed distance of a sphere, 6 to 45 voxels per radius"
        right.set(xlabel="seconds", ylabel="rms error in voxels", title=title)
