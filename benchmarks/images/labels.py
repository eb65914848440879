"""Surfaces of label images: seconds, errors of volume and area, and whether they are closed and free of crossings.

Spheres, ellipsoids and cubes lie apart from each other, at random places and in random poses; Voronoi cells fill the
image, and those within it are compared with their convex hulls. The peers are marching cubes of scikit-image, label by
label, and the surface nets of VTK, whose single surface of all labels is parted by label after its time is taken.
"""

import tempfile
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.model import calibration, least_seconds, panels_of, write_rows
from benchmarks.peers import labels as peers
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import PackingWarning
from voxgran._base.lazy import load
from voxgran._base.machine import forget_peak, peak_memory
from voxgran._base.seeds import stream
from voxgran.contacts.verify import verify
from voxgran.geometry.crossing import count_crossings
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.geometry.triangles import areas_of, enclosed_volume
from voxgran.io.vtk_files import save_packing
from voxgran.lattice.cuberille import fans
from voxgran.packing.transform.from_labels import packing_of_labels
from voxgran.shapes.images.labels import load_labels
from voxgran.shapes.mesh import Mesh, hull_of
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.shells import half_edges

#: voxels across a body, half axes of ellipsoids in these, and bodies, or points of Voronoi cells, along an edge
ACROSS, HALF_AXES, BODIES, POINTS = (10, 20, 40), (0.75, 0.5, 0.35), 2, 5
#: voxels along the edge of the crowded image, and its points
CROWDED = 200, 230
#: voxels along the edge of the part that large images are made of, its points, and parts along their edges: the
#: largest one has 500^3 voxels and about 10,000 labels
PART, PARTS = (125, 158), (2, 4)
#: calls of which the least time counts
REPEATS = 2
#: accuracy of corners up to which they are one, in voxels
SAME = 1e-6

#: an image of labels
Labels: TypeAlias = NDArray[np.int32]
#: vertices (v, 3) in voxels, and triangles (m, 3)
Surface: TypeAlias = tuple[Floats, Integers]
#: what is timed, and what makes surfaces of the labels 1, 2, ... of its result
Program: TypeAlias = tuple[Callable[[], Any], Callable[[Any], list[Surface]]]
#: body, voxels across, program, CPU seconds, mean error of the volume without and of the area with its sign
Row: TypeAlias = tuple[str, int, str, float, float, float]


def bodies(kind: str, across: int) -> tuple[Labels, Floats, Floats, Integers]:
    """Return an image of bodies, and volumes and areas of those that are compared, whose labels follow."""
    if kind == "voronoi":
        return _cells(across)
    half = {"sphere": (0.5,) * 3, "ellipsoid": HALF_AXES, "cube": (0.5,) * 3}[kind]
    lengths, draw = np.array(half) * across, stream(across, kind)
    true = Primitive("box", tuple(2 * lengths)) if kind == "cube" else Primitive("ellipsoid", tuple(lengths))
    room, count = int(1.8 * across) + 6, BODIES**3
    image = np.zeros((BODIES * room,) * 3, dtype=np.int32)
    for k, turn in enumerate(rotation_matrices(random_rotations(draw, count))):
        corner = room * np.array(np.unravel_index(k, (BODIES,) * 3))
        away = (_centers(room) - room / 2 - draw.random(3) + 0.5) @ turn / lengths
        inside = (np.abs(away) < 1).all(axis=-1) if kind == "cube" else (away**2).sum(axis=-1) < 1
        image[tuple(slice(low, low + room) for low in corner)][inside] = k + 1
    return image, np.full(count, true.volume), np.full(count, true.surface_area), np.arange(1, count + 1)


def _cells(across: int) -> tuple[Labels, Floats, Floats, Integers]:
    """Return an image that the Voronoi cells of shaken lattice points fill; those at its border are not compared."""
    spacing = across * (np.pi / 6) ** (1 / 3)
    n = round(POINTS * spacing)
    points = (_centers(POINTS) + 0.8 * (stream(across, "voronoi").random((POINTS,) * 3 + (3,)) - 0.5)) * n / POINTS
    points = points.reshape(-1, 3)
    image = load("scipy.spatial").cKDTree(points).query(_centers(n))[1] + 1
    inner = np.flatnonzero(np.pad(np.ones((POINTS - 2,) * 3), 1).ravel())
    diagram = load("scipy.spatial").Voronoi(points)
    hulls = [hull_of(diagram.vertices[diagram.regions[diagram.point_region[k]]]) for k in inner]
    volumes, areas = (np.array([getattr(hull, name) for hull in hulls]) for name in ("volume", "surface_area"))
    return image.astype(np.int32), volumes, areas, inner + 1


def _centers(n: int) -> Floats:
    """Return the centers of n^3 voxels, (n, n, n, 3)."""
    return np.asarray(np.moveaxis(np.indices((n,) * 3), 0, -1) + 0.5, dtype=np.float64)


def crowded(n: int, count: int) -> Labels:
    """Return an image of cells of random points, cut at a distance from them, with consecutive labels."""
    points, reach = stream(0, "crowded").random((count, 3)) * n, 1.05 * n * (0.55 * 3 / (4 * np.pi * count)) ** (1 / 3)
    away, nearest = load("scipy.spatial").cKDTree(points).query(_centers(n))
    found = np.unique(np.where(away <= reach, nearest + 1, 0), return_inverse=True)[1]
    return found.reshape((n,) * 3).astype(np.int32)


def programs(image: Labels) -> dict[str, Program]:
    """Return what makes surfaces of an image whose labels are 1, 2, ...; each with what parts its result by label."""

    def shapes(surface: str) -> list[Shape]:
        with warnings.catch_warnings():
            # the image cuts some
            warnings.simplefilter("ignore", PackingWarning)
            return load_labels(image, voxel_size=1.0, surface=surface)

    return {
        "voxgran": (lambda: shapes("smooth"), _placed),
        "voxgran, faces of voxels": (lambda: shapes("voxel"), _placed),
        "scikit-image, marching cubes": (lambda: peers.marching_cubes(image), list),
        "VTK, surface nets": (lambda: peers.surface_nets(image), lambda made: _parted(*made, count=image.max())),
    }


def _placed(shapes: list[Shape]) -> list[Surface]:
    """Return the surfaces of shapes where the image has them."""
    return [(shape.vertices + np.array(shape.offset), shape.faces) for shape in shapes]


def _parted(points: Floats, faces: Integers, sides: Integers, *, count: int) -> list[Surface]:
    """Return the triangles of each label, of a surface whose triangles look from the first of their labels outward."""
    surfaces = []
    for label in range(1, count + 1):
        own = np.concatenate([faces[sides[:, 0] == label], faces[sides[:, 1] == label][:, ::-1]])
        used, index = np.unique(own, return_inverse=True)
        surfaces.append((points[used], index.reshape(-1, 3)))
    return surfaces


def measured(across: tuple[int, ...] = ACROSS) -> list[Row]:
    """Return the rows of the bodies."""
    rows = []
    for kind in ("sphere", "ellipsoid", "cube", "voronoi"):
        for size in across:
            image, volumes, areas, labels = bodies(kind, size)
            for name, (work, surfaces_of) in programs(image).items():
                seconds = least_seconds(work, repeats=REPEATS, processor=True)
                made = surfaces_of(work())
                surfaces = [made[label - 1] for label in labels]
                volume = np.array([enclosed_volume(*surface) for surface in surfaces]) / volumes - 1
                area = np.array([areas_of(points[faces]).sum() for points, faces in surfaces]) / areas - 1
                rows.append((kind, size, name, seconds, float(np.abs(volume).mean()), float(area.mean())))
    return rows


def measured_crowd(n: int = CROWDED[0], points: int = CROWDED[1]) -> list[tuple[str, float, int, int, int, int]]:
    """Return program, CPU seconds, labels, triangles, closed manifolds and crossing pairs for a crowded image."""
    image, rows = crowded(n, points), []
    for name, (work, surfaces_of) in programs(image).items():
        seconds = least_seconds(work, repeats=REPEATS, processor=True)
        surfaces = surfaces_of(work())
        closed = sum(is_manifold(*surface) for surface in surfaces)
        triangles = sum(len(faces) for _, faces in surfaces)
        rows.append((name, seconds, len(surfaces), triangles, closed, crossings(surfaces)))
    work = partial(packing_of_labels, image, voxel_size=1.0, gravity="none")
    for name, step in (("as a packing", work), ("verify of the packing", partial(verify, work()))):
        seconds = least_seconds(step, repeats=REPEATS, processor=True)
        rows.append((f"{rows[0][0]}, {name}", seconds, *rows[0][2:]))
    return rows[-2:] + rows[:-2]


def measured_large(
    part: tuple[int, int] = PART, parts: tuple[int, ...] = PARTS
) -> list[tuple[int, int, int, float, float, float, float]]:
    """Return voxels along the edge, labels, triangles, CPU seconds and largest memory in MiB of packings of large
    images, their bytes for each triangle, and the size of their files over the size of an image of 16 bits a voxel.
    """
    one, rows = crowded(*part), []
    for many in parts:
        steps = np.arange(many**3, dtype=np.int32).reshape((many,) * 3) * one.max()
        image = np.block(
            [[[np.where(one, one + step, 0) for step in row] for row in plane] for plane in steps.tolist()]
        )
        image = image.astype(np.int32, copy=False)
        forget_peak()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PackingWarning)
            began = time.process_time()
            packing = packing_of_labels(image, voxel_size=1.0, gravity="none")
            seconds, memory = time.process_time() - began, peak_memory() / 2**20
        meshes = [shape.geometry for shape in packing.shapes if isinstance(shape.geometry, Mesh)]
        triangles = sum(len(mesh.corners) for mesh in meshes)
        kept = sum(mesh.corners.nbytes + mesh.points.nbytes for mesh in meshes) / triangles
        with tempfile.TemporaryDirectory() as folder:
            save_packing(packing, Path(folder, "packing.vtp"))
            length = Path(folder, "packing.vtp").stat().st_size / (2 * image.size)
        rows.append((len(image), packing.count, triangles, seconds, memory, kept, length))
        # the next image is to find no memory of this one
        del image, packing, meshes
    return rows


def is_manifold(points: Floats, faces: Integers) -> bool:
    """Return whether a surface is closed, its triangles face one way, and those around each vertex are one fan."""
    start, end, edge, uses = half_edges(faces, len(points))
    if (uses != 2).any() or (np.bincount(edge, np.sign(end - start)) != 0).any():
        return False
    order = np.argsort(edge, kind="stable")
    return int(fans(faces, order[0::2], order[1::2]).max()) + 1 == len(np.unique(faces))


def crossings(surfaces: list[Surface]) -> int:
    """Return the pairs of triangles of all surfaces that cross; a triangle that two of them share counts once."""
    first = np.cumsum([0] + [len(points) for points, _ in surfaces])
    points, faces = np.concatenate([points for points, _ in surfaces]), [faces for _, faces in surfaces]
    _, place, index = np.unique(np.rint(points / SAME), axis=0, return_index=True, return_inverse=True)
    together = index.ravel()[np.concatenate([mine + start for mine, start in zip(faces, first, strict=False)])]
    _, kept = np.unique(np.sort(together, axis=1), axis=0, return_index=True)
    return count_crossings(points[place], together[kept])


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    head = (
        "voxels_along_an_edge:d,labels:d,triangles:d,cpu_seconds:.4g,largest_memory_mib:.0f,"
        "bytes_of_a_triangle:.4g,file_over_image:.3g"
    )
    # first, since memory that other jobs leave behind would count
    large = write_rows(folder / "labels_large.csv", head, measured_large())
    loop, rows = calibration(), measured()
    lines = [
        f'{kind},{size},"{name}",{seconds:.4g},{volume:.2g},{area:.2g},{loop:.5f}'
        for kind, size, name, seconds, volume, area in rows
    ]
    head = "body,voxels_across,program,cpu_seconds,volume_error,area_error,calibration_seconds"
    table = write_rows(folder / "labels.csv", head, lines)
    crowd = [
        f'"{name}",{seconds:.4g},{labels},{triangles},{closed},{crossed},{loop:.5f}'
        for name, seconds, labels, triangles, closed, crossed in measured_crowd()
    ]
    head = "program,cpu_seconds,labels,triangles,closed_manifolds,crossing_pairs,calibration_seconds"
    _draw(rows, folder / "labels.svg")
    crowd_table = write_rows(folder / "labels_crowded.csv", head, crowd)
    return table, crowd_table, large, folder / "labels.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw the error of the area against seconds, a line for each program."""
    kinds = dict.fromkeys(row[0] for row in rows)
    with panels_of(path, len(kinds), width=3.4 * len(kinds), sharey=True, legend=0) as panels:
        for kind, panel in zip(kinds, panels, strict=True):
            for name in dict.fromkeys(row[2] for row in rows):
                mine = [row for row in rows if (row[0], row[2]) == (kind, name)]
                panel.loglog([row[3] for row in mine], [100 * abs(row[5]) for row in mine], "o-", label=name)
            panel.set(xlabel="CPU seconds", title=kind)
        panels[0].set(ylabel="error of the area (%)")
        panels[0].legend(frameon=False, fontsize=8)
