"""Voxelization: seconds against volume error, for each backend, resolution and shape; and ratios to peers.

The error is the root mean square over poses of the volume of the voxels against the exact volume. Centers of voxels
sample the volume with an error of order 2 in the voxel size where the surface lies in no special direction, of order 1
where flat faces lie along the lattice; exact shares are at round-off whatever the voxel size is.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.model import least_seconds, panels_of, scans, write_rows
from benchmarks.peers import voxels as peers
from voxgran._base.arrays import Floats
from voxgran._base.lazy import Dataset, load
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.lattice.grid import Grid
from voxgran.shapes.family import make_shape
from voxgran.shapes.files import load_shape
from voxgran.shapes.formats.mesh_files import WRITERS
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.voxels.occupy import BACKENDS, voxelize

#: voxels per equivalent diameter
RESOLUTIONS = (16, 32, 64, 128)
POSES = 12
#: the series of exact shares, beside those of the backends
SHARES = "exact shares"
#: voxels along an edge at which peers are timed; the slow one only at the first
PEER_SIZES = (256, 512)
SLOW_PEER = "Open3D occupancy"


def bench_shapes() -> list[Shape]:
    """Return a fine sphere, a box, the same box along the lattice, a random solid and scanned bodies: all as meshes."""
    sphere = make_shape("sphere")
    box = make_shape("box", aspect=(1, 0.7, 0.5))
    shapes = [Shape.of(Mesh(body.vertices.copy(), body.faces.copy()), name=body.name) for body in (sphere, box)]
    shapes.append(Shape(shapes[1].geometry, "aligned box"))
    shapes.append(make_shape("solid_union", seed=1))
    return [*shapes, *(body.scaled(1 / body.diameter) for body in scans("eros.obj", "itokawa_lp.obj").values())]


def posed_shapes(shape: Shape, poses: int) -> list[Shape]:
    """Return a shape in random poses; the aligned box in random sizes along the lattice instead."""
    generator = stream(0, "bench sizes")
    if shape.name == "aligned box":
        return [shape.scaled(float(factor)) for factor in generator.uniform(0.95, 1.05, poses)]
    return [shape.rotated(turn) for turn in random_rotations(stream(0, "bench poses"), poses)]


def measure_rows(shapes: list[Shape], resolutions: tuple[int, ...] = RESOLUTIONS, poses: int = POSES) -> "Dataset":
    """Return seconds and rms relative volume error over random poses by shape, backend and resolution (voxels per
    equivalent diameter).
    """
    names = (*BACKENDS, SHARES)
    seconds = np.zeros((len(shapes), len(names), len(resolutions)))
    errors = np.zeros_like(seconds)
    for s, shape in enumerate(shapes):
        bodies = posed_shapes(shape, poses)
        for b, name in enumerate(names):
            for r, resolution in enumerate(resolutions):
                size = shape.diameter / resolution
                found = [_volume(body, size, name) / body.volume - 1 for body in bodies]
                errors[s, b, r] = np.sqrt(np.mean(np.square(found)))
                seconds[s, b, r] = least_seconds(lambda: _volume(bodies[0], size, name), processor=True)  # noqa: B023
    dims = ("shape", "backend", "resolution")
    return load("xarray").Dataset(
        {
            "seconds": (dims, seconds, {"units": "s", "long_name": "CPU time of one voxelization"}),
            "volume_error": (dims, errors, {"units": "1", "long_name": "rms relative volume error"}),
        },
        coords={"shape": [shape.name for shape in shapes], "backend": list(names), "resolution": list(resolutions)},
    )


def _volume(shape: Shape, size: float, name: str) -> float:
    """Voxelize, and return the volume of the voxels or of their shares."""
    if name == SHARES:
        return voxelize(shape, voxel_size=size, fraction=True).volume
    return voxelize(shape, voxel_size=size, backend=name).volume


def measure_peers(sizes: tuple[int, ...] = PEER_SIZES) -> list[tuple[int, str, float, int]]:
    """Time voxgran and its peers on a sphere of 20,480 triangles; CPU time of one thread, the least of some
    calls.

    Return voxels along an edge, program, seconds, and voxels that differ from voxgran's.
    """
    icosphere = load("pyvista").Icosphere(nsub=5)
    turn = rotation_matrices(random_rotations(stream(1, "bench pose"), 1))[0]
    points: Floats = np.asarray(icosphere.points, dtype=np.float64) @ turn.T
    faces = np.ascontiguousarray(icosphere.regular_faces.astype(np.int64))
    rows = []
    for n in sizes:
        vertices = points / np.abs(points).max() * 0.45 * n + n / 2
        shape, grid = Shape(Mesh(vertices, faces), "sphere"), Grid((0.0, 0.0, 0.0), 1.0, (n, n, n))
        mask = voxelize(shape, grid=grid).mask
        packed = least_seconds(lambda: voxelize(shape, grid=grid), repeats=9, processor=True)  # noqa: B023
        rows.append((n, "voxgran, bits", packed, 0))
        unpacked = least_seconds(lambda: voxelize(shape, grid=grid).mask, repeats=9, processor=True)  # noqa: B023
        rows.append((n, "voxgran, bool", unpacked, 0))
        for name, program in peers.voxel_peers(vertices, faces, n).items():
            if name == SLOW_PEER and n > sizes[0]:
                continue
            wrong = int(np.count_nonzero(program() != mask))
            rows.append((n, name, least_seconds(program, repeats=1 if name == SLOW_PEER else 3, processor=True), wrong))
    return rows


def measure_files(divisions: int = 2) -> list[tuple[str, int, str, float, float]]:
    """Time reading a scanned body, whose triangles are divided into four again and again, from files that are parsed
    here, with all checks, and by PyVista, without.

    Return format, triangles, program, CPU seconds, and the largest error of a coordinate over the size.
    """
    pyvista, rows = load("pyvista"), []
    (body,) = scans("eros.obj").values()
    divided = pyvista.PolyData.from_regular_faces(body.vertices, body.faces).subdivide(divisions, "linear")
    points, faces = np.asarray(divided.points, dtype=np.float64) / body.diameter, divided.regular_faces
    with TemporaryDirectory() as folder:
        for suffix in (".ply", ".stl", ".obj", ".off"):
            path = Path(folder) / f"scan{suffix}"
            WRITERS[suffix](points, faces, path)
            programs: dict[str, Callable[[], Any]] = {
                "voxgran": partial(load_shape, path),
                "PyVista": partial(pyvista.read, path),
            }
            for name, program in programs.items():
                seconds, read = least_seconds(program, processor=True), program()
                there = (
                    read.vertices + np.array(read.offset)
                    if name == "voxgran"
                    else np.asarray(read.points, dtype=np.float64)
                )
                error = float(np.abs(there.max(axis=0) - points.max(axis=0)).max() / np.ptp(points))
                rows.append((suffix, len(faces), name, seconds, error))
    return rows


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    data = measure_rows(bench_shapes())
    rows = []
    for shape in data.shape.values:
        for backend in data.backend.values:
            for resolution in data.resolution.values:
                at = data.sel(shape=shape, backend=backend, resolution=resolution)
                rows.append((shape, backend, resolution, float(at.seconds), float(at.volume_error)))
    compared = []
    times: dict[tuple[int, str], float] = {}
    for n, name, seconds, wrong in measure_peers():
        times[n, name] = seconds
        bits, mask = seconds / times[n, "voxgran, bits"], seconds / times.get((n, "voxgran, bool"), np.nan)
        compared.append((n, name, seconds, bits, mask, wrong))
    head = "shape,backend,voxels_per_diameter,seconds:.5f,volume_error:.3e"
    peer_head = "voxels_along_edge,program,seconds:.5f,ratio_to_bits:.1f,ratio_to_bool:.1f,voxels_that_differ"
    _draw(data, folder / "voxelize.svg")
    return (
        write_rows(folder / "voxelize.csv", head, rows),
        write_rows(folder / "voxelize_peers.csv", peer_head, compared),
        write_rows(folder / "mesh_files.csv", "format,triangles,program,seconds:.3f,error:.1e", measure_files()),
        folder / "voxelize.svg",
    )


def _draw(data: "Dataset", path: Path) -> None:
    """Draw error against seconds, a line per backend, a panel per shape."""
    count, columns = data.sizes["shape"], 3
    rows = -(-count // columns)
    width, height = 3.4 * columns, 3.2 * rows
    with panels_of(path, columns, rows=rows, width=width, height=height, sharey=True, sharex=True, legend=0) as panels:
        for panel, shape in zip(panels, data.shape.values, strict=False):
            for backend in data.backend.values:
                line = data.sel(shape=shape, backend=backend)
                panel.loglog(line.seconds, np.maximum(line.volume_error, 1e-16), marker="o", label=str(backend))
            errors = data.volume_error.sel(shape=shape, backend="scanline")
            order = -np.polyfit(np.log(data.resolution), np.log(errors), 1)[0]
            panel.set_title(f"{shape}, centers: order {order:.1f}")
        for panel in panels[count:]:
            panel.set_axis_off()
        for panel in panels[::columns]:
            panel.set_ylabel("rms volume error")
        for panel in panels[-columns:]:
            panel.set_xlabel("seconds")
        panels[0].legend(frameon=False)
