"""Cells of given volumes by weights and by inverse Monte Carlo: error against seconds; and thin containers filled.

The cells of `voronoi_fill` get their volumes by Newton steps on weights. Mollon & Zhao 2012 move the seeds of ordinary
Voronoi cells at random instead, and keep a move where the distribution of the volumes comes nearer to the one that is
wanted; that is a peer here, with the same geometry and the same first seeds. Errors are those of the distribution,
which is all that the peer aims at: the largest difference of the cumulative shares (Kolmogorov & Smirnov), and the
largest relative difference of the k-th smallest volumes. Cells by weights have their volumes each by itself besides.

A second table has thin containers that `tetrahedral` fills by its defaults. Seconds are CPU seconds.
"""

import warnings
from pathlib import Path

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from benchmarks.peers import cells as peers
from voxgran._base.arrays import Floats
from voxgran._base.errors import PackingWarning
from voxgran._base.seeds import stream
from voxgran.containers.kernel_container import kernel_container
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container
from voxgran.packing.method import State
from voxgran.packing.pack import pack
from voxgran.packing.tessellation.voronoi_cells import Cells, seeds_of
from voxgran.packing.tessellation.voronoi_steps import first_arrays, step
from voxgran.shapes.family import make_shape

#: cells, standard deviations of the logarithms of their diameters, smoothing moves, and moves of the peer
COUNT, SIGMAS, SMOOTHING, MOVES = 300, (0.2, 0.4), (0, 30), {2: (1_000, 10_000, 100_000), 3: (1_000, 10_000)}
#: thin containers
THIN: dict[str, Container] = {
    "plate 20 x 20 x 1": Box((20, 20, 1)),
    "plate 20 x 20 x 0.1": Box((20, 20, 0.1)),
    "disk 20 wide, 0.1 thick": Cylinder(10, 0.1),
    "needle 0.1 x 0.1 x 20": Box((0.1, 0.1, 20)),
    "rod 0.1 wide, 20 long": Cylinder(0.05, 20),
    "strip 20 x 0.1": Rectangle((20, 0.1)),
    "strip 20 x 0.001": Rectangle((20, 0.001)),
}

#: dimension, standard deviation, program, moves, seconds, largest difference of shares, largest relative one of volumes
Row = tuple[int, float, str, int, float, float, float]


def measure_cells(
    dimension: int, sigma: float, *, count: int = COUNT, moves: tuple[int, ...] | None = None
) -> list[Row]:
    """Make cells of log-normal diameters in a periodic box in both ways; return their rows."""
    room: Container = Rectangle((1, 1), "xy") if dimension == 2 else Box((1, 1, 1), "xyz")
    cells, generator = Cells(kernel_container(room, from_corner=True)), stream(0, "cells")
    place = np.zeros((count, 3))
    place[:, :dimension] = generator.random((count, dimension))
    wanted = np.exp(dimension * sigma * generator.normal(size=count))
    wanted /= wanted.sum()
    rows = []
    for smoothing in SMOOTHING:
        by_weights(cells, place, wanted, 0)
        volume, seconds = timed(by_weights, cells, place, wanted, smoothing)
        rows.append((dimension, sigma, "weights", smoothing, seconds, *errors_of(volume, wanted)))
    moves = MOVES[dimension] if moves is None else moves
    if moves:
        peers.inverse_monte_carlo(cells, place, wanted, 1)
        for many in moves:
            _, volume, seconds, _ = peers.inverse_monte_carlo(cells, place, wanted, many)
            rows.append((dimension, sigma, "inverse Monte Carlo", many, seconds, *errors_of(volume, wanted)))
    return rows


def by_weights(cells: Cells, place: Floats, wanted: Floats, smoothing: int) -> Floats:
    """Return the volumes of the cells of `voronoi_fill`, (n,)."""
    state = State({**first_arrays(place.copy()), "tally": np.zeros(6, dtype=np.int64)}, {})
    while not state.arrays["tally"][2]:
        step(cells, state, wanted, smoothing, lambda: None)
    seeds = seeds_of(state.arrays["known_place"], state.arrays["known_weight"], cells.walls)
    return cells.measured(seeds, len(place), lambda: None).volume


def errors_of(volume: Floats, wanted: Floats) -> tuple[float, float]:
    """Return the largest difference of cumulative shares by number, and the largest relative one of sorted volumes."""
    found, aim = np.sort(volume), np.sort(wanted)
    both = np.concatenate([found, aim])
    shares = [np.searchsorted(one, both, side="right") / len(aim) for one in (found, aim)]
    return float(np.abs(shares[0] - shares[1]).max()), float(np.abs(found / aim - 1.0).max())


def measure_thin(name: str) -> tuple[int, float, float]:
    """Fill a thin container by the defaults of `tetrahedral`; return spheres, seconds and solid fraction."""
    room = THIN[name]
    shape = make_shape("disk" if room.dimension == 2 else "sphere")
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        small: Container = Rectangle((1, 1)) if room.dimension == 2 else Box((1, 1, 1))
        pack(shape, small, method="tetrahedral", count=50)
        packing, seconds = timed(pack, shape, room, method="tetrahedral")
    return packing.count, seconds, packing.solid_fraction


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = [row for d in (2, 3) for sigma in SIGMAS for row in measure_cells(d, sigma)]
    head = "dimension,sigma:g,program,moves,cpu_seconds:.4f,share_error:.5f,volume_error:.3g"
    table = write_rows(folder / "tessellation.csv", head, rows)
    head = "container,spheres,cpu_seconds:.3f,solid_fraction:.4f"
    other = write_rows(folder / "tessellation_thin.csv", head, [(name, *measure_thin(name)) for name in THIN])
    _draw(rows, folder / "tessellation.svg")
    return table, other, folder / "tessellation.svg"


def _draw(rows: list[Row], path: Path) -> None:
    """Draw the errors of the volumes against seconds, 2D on the left and 3D on the right."""
    with panels_of(path, 2, width=10.0, sharey=True) as panels:
        for panel, dimension in zip(panels, (2, 3), strict=True):
            for k, sigma in enumerate(SIGMAS):
                for program, style in (("weights", "o"), ("inverse Monte Carlo", "s-")):
                    here = [row for row in rows if row[:3] == (dimension, sigma, program)]
                    spots = [(row[4], row[6]) for row in here]
                    if spots:
                        label = f"{program}, sigma {sigma:g}"
                        panel.loglog(*zip(*spots, strict=True), f"C{k}{style}", label=label)
            panel.set(xlabel="seconds", ylabel="largest relative error of a volume", title=f"{dimension} dimensions")
