"""Voxelization: seconds against volume error, for each backend, resolution and shape.

The error is the root mean square over random poses of the volume of the voxels against the exact volume. Centers of
voxels sample the volume with an error of order 2 in the voxel size where the surface lies in no special direction.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from voxgran._base.files import write_text, written_whole
from voxgran._base.lazy import load
from voxgran._base.rotation import random_rotations
from voxgran._base.seeds import stream
from voxgran.bench.model import TradeOff, calibration, least_seconds
from voxgran.shapes.family import make_shape
from voxgran.shapes.files import load_shape
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.voxels.occupy import backends, voxelize

if TYPE_CHECKING:
    from xarray import Dataset

#: voxels per equivalent diameter
RESOLUTIONS = (16, 32, 64, 128)
POSES = 4


def bench_shapes() -> list[Shape]:
    """Return a fine sphere, a box, a random solid and, where its file is there, a scanned body: all as meshes."""
    ball = make_shape("sphere")
    box = make_shape("box", aspect=(1, 0.7, 0.5))
    shapes = [Shape.of(Mesh(body.vertices.copy(), body.faces.copy()), name=body.name) for body in (ball, box)]
    shapes.append(make_shape("solid_union", seed=1))
    scan = Path(__file__).parents[3] / "data" / "eros.obj"
    if scan.is_file():
        body = load_shape(scan)
        shapes.append(body.scaled(1 / body.diameter))
    return shapes


def measure_rows(shapes: list[Shape], resolutions: tuple[int, ...] = RESOLUTIONS, poses: int = POSES) -> "Dataset":
    """Return seconds and rms volume error by shape, backend and resolution.

    Parameters
    ----------
    shapes : list of Shape
        Meshes.
    resolutions : tuple of int
        Voxels per equivalent diameter.
    poses : int
        Random orientations over which the error is taken.

    Returns
    -------
    xarray.Dataset
        Variables seconds, volume_error; attribute calibration_seconds: a fixed loop of the same run.
    """
    names = backends()
    seconds = np.zeros((len(shapes), len(names), len(resolutions)))
    errors = np.zeros_like(seconds)
    turns = random_rotations(stream(0, "bench poses"), poses)
    for s, shape in enumerate(shapes):
        posed = [shape.rotated(turn) for turn in turns]
        for b, backend in enumerate(names):
            for r, resolution in enumerate(resolutions):
                size = shape.diameter / resolution
                found = [voxelize(body, voxel_size=size, backend=backend).volume / body.volume - 1 for body in posed]
                errors[s, b, r] = np.sqrt(np.mean(np.square(found)))
                seconds[s, b, r] = least_seconds(lambda: voxelize(posed[0], voxel_size=size, backend=backend))  # noqa: B023
    dims = ("shape", "backend", "resolution")
    return load("xarray").Dataset(
        {
            "seconds": (dims, seconds, {"units": "s", "long_name": "wall time of one voxelization"}),
            "volume_error": (dims, errors, {"units": "1", "long_name": "rms relative volume error"}),
        },
        coords={"shape": [shape.name for shape in shapes], "backend": list(names), "resolution": list(resolutions)},
        attrs={"calibration_seconds": calibration()},
    )


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    data = measure_rows(bench_shapes())
    rows = ["shape,backend,voxels_per_diameter,seconds,volume_error,calibration_seconds"]
    for shape in data.shape.values:
        for backend in data.backend.values:
            for resolution in data.resolution.values:
                at = data.sel(shape=shape, backend=backend, resolution=resolution)
                numbers = f"{float(at.seconds):.5f},{float(at.volume_error):.3e},{data.calibration_seconds:.5f}"
                rows.append(f"{shape},{backend},{resolution},{numbers}")
    table, figure = folder / "voxelize.csv", folder / "voxelize.svg"
    write_text(table, "\n".join(rows) + "\n")
    _draw(data, figure)
    return table, figure


registration = TradeOff(name="voxelize", summary="seconds against volume error of the voxel backends", run=run)


def _draw(data: "Dataset", path: Path) -> None:
    """Draw error against seconds, a line per backend, a panel per shape."""
    figure_class = load("matplotlib.figure").Figure
    figure = figure_class(figsize=(3.2 * data.sizes["shape"], 3.4), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, data.sizes["shape"], sharey=True))
    for panel, shape in zip(panels, data.shape.values, strict=True):
        for backend in data.backend.values:
            line = data.sel(shape=shape, backend=backend)
            panel.loglog(line.seconds, np.maximum(line.volume_error, 1e-16), marker="o", label=str(backend))
        panel.set_title(str(shape))
        panel.set_xlabel("seconds")
        panel.grid(visible=True, alpha=0.3)
    panels[0].set_ylabel("rms volume error")
    panels[-1].legend(frameon=False)
    with written_whole(path) as draft:
        figure.savefig(draft, format="svg")
