"""Digital packing: which true densities it reaches, against voxels, vibration, walls and dimension.

Beds settle after the walk, by their true shapes and with friction; all densities are bulk solid fractions of the true
solids, without overlap. Spheres stand at 20, 40 and 80 voxels per diameter, and a line through these is followed to
voxels of no size, without vibration and shaken. A bed of spheres in a cylinder is compared with the law of de Klerk,
and disks of two sizes settle in the plane, shaken.
"""

from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from benchmarks.model import panels_of, timed, write_rows
from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.model import Container
from voxgran.measures.registered.density import bulk_solid_fraction
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.report.wall_law import wall_law
from voxgran.settling.parameters import Settling, Shaking
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape

#: what, voxels per diameter (0: followed to voxels of no size), vibrated, seconds, bulk solid fraction, uncertainty
Row: TypeAlias = tuple[str, int, bool, float, float, float]
CELLS = (20, 40, 80)
SEEDS = (1, 2)
#: coefficient of friction of all beds, and how some of them are shaken
FRICTION, SHAKING = 0.5, Shaking(acceleration=1.0, duration=30.0)
#: bins of the wall profile, in diameters, and points in each
BIN, FAR, POINTS = 0.05, 4.0, 20_000


def bed(
    shapes: Shape | list[Shape], container: Container, count: int, *, shaken: bool = False, **parameters: Any
) -> tuple[Packing, float]:
    """Pack a bed digitally, with settling, and return it and the seconds that it took."""
    how = Settling(friction=FRICTION, shaking=SHAKING if shaken else None)
    return timed(pack, shapes, container, method="digital", count=count, settle=how, **parameters)


def extrapolated(sizes: Floats, values: Floats) -> tuple[float, float]:
    """Return where a straight line through three or more values (n,) meets size 0, and its standard error."""
    design = np.column_stack([np.ones_like(sizes), sizes])
    fit, *_ = np.linalg.lstsq(design, values, rcond=None)
    spread = ((values - design @ fit) ** 2).sum() / (len(sizes) - 2)
    return float(fit[0]), float(np.sqrt(spread * np.linalg.inv(design.T @ design)[0, 0]))


def measure_spheres(cells: tuple[int, ...] = CELLS, seeds: tuple[int, ...] = SEEDS, count: int = 350) -> list[Row]:
    """Pack beds of equal spheres, not shaken and shaken, at these numbers of voxels per diameter, one bed for each
    seed.
    """
    rows: list[Row] = []
    box = Box((6, 6, 8 + count / 30), periodic=(True, True, False))
    for vibrated in (False, True):
        many = []
        for n in cells:
            for seed in seeds:
                packing, seconds = bed(
                    make_shape("sphere"), box, count, voxel_size=1 / n, seed=seed, orientations=1, sweeps=1500,
                    vibration_up=0.0, shaken=vibrated,
                )  # fmt: skip
                many.append((1 / n, float(bulk_solid_fraction(packing))))
                rows.append((f"sphere, seed {seed}", n, vibrated, seconds, many[-1][1], 0.0))
        sizes, values = np.array(many).T
        rows.append(("sphere", 0, vibrated, 0.0, *extrapolated(sizes, values)))
    return rows


def measure_disks(count: int = 330) -> list[Row]:
    """Pack a bed of as many disks of diameter 1 as of 1.4."""
    disks = [make_shape("disk"), make_shape("disk", diameter=1.4)]
    floor = Rectangle((20, 10 + count / 14), periodic=(True, False))
    packing, seconds = bed(
        disks, floor, count, voxel_size=1 / 20, seed=1, orientations=1, sweeps=3000, shaken=True, weights=[1, 1]
    )
    return [("disks 1 : 1.4", 20, True, seconds, float(bulk_solid_fraction(packing)), 0.0)]


def measure_wall(count: int = 900) -> tuple[Floats, Floats, Floats, float]:
    """Pack spheres into a cylinder and compare the solid fraction near its wall with the law of de Klerk.

    Return distance, solid fraction and law, (b,), in bins of 1/20 of a diameter up to 4 diameters from the wall, and
    the root mean square of the difference.
    """
    radius = 4.6
    packing, _ = bed(
        make_shape("sphere"), Cylinder(radius, 4 + count / 60), count, voxel_size=1 / 20, seed=1, orientations=1,
        sweeps=1500,
    )  # fmt: skip
    bulk, generator = float(bulk_solid_fraction(packing)), stream(1, "bench wall")
    tree = load("scipy.spatial").cKDTree(packing.position)
    top = float(np.quantile(packing.position[:, 2], 0.85))
    edges = np.arange(0.0, FAR + BIN / 2, BIN)
    found = []
    for near, far in pairwise(edges):
        reach = np.sqrt(generator.uniform((radius - far) ** 2, (radius - near) ** 2, POINTS))
        turn, height = generator.uniform(0, 2 * np.pi, POINTS), generator.uniform(2.0, top, POINTS)
        places = np.column_stack([reach * np.cos(turn), reach * np.sin(turn), height])
        found.append(float((tree.query(places)[0] < 0.5).mean()))
    distance = (edges[1:] + edges[:-1]) / 2
    law = wall_law(distance, bulk=bulk)
    return distance, np.array(found), law, float(np.sqrt(np.mean((np.array(found) - law) ** 2)))


def run(folder: Path) -> tuple[Path, ...]:
    """Measure, and write rows as CSV and a figure as SVG."""
    rows = [*measure_spheres(), *measure_disks()]
    wall = measure_wall()
    head = "bed,voxels_per_diameter,vibrated,seconds:.1f,bulk_solid_fraction:.4f,standard_error:.4f"
    beds = [(name, cells or None, *others) for name, cells, *others in rows]
    wall_head, profile = "distance_in_diameters:.3f,solid_fraction:.4f,de_klerk:.4f", zip(*wall[:3], strict=True)
    _draw(rows, wall, folder / "density.svg")
    return (
        write_rows(folder / "density.csv", head, beds),
        write_rows(folder / "density_wall.csv", wall_head, profile),
        folder / "density.svg",
    )


def _draw(rows: list[Row], wall: tuple[Floats, Floats, Floats, float], path: Path) -> None:
    """Draw spheres against voxel size on the left, the wall on the right."""
    with panels_of(path, 2, width=9.2) as (left, right):
        for vibrated, color in ((False, "C0"), (True, "C1")):
            label = "shaken" if vibrated else "not shaken"
            beds = [row for row in rows if row[0].startswith("sphere,") and row[2] == vibrated]
            left.plot([1 / row[1] for row in beds], [row[4] for row in beds], f"{color}o", label=label)
            end = next(row for row in rows if row[0] == "sphere" and row[2] == vibrated)
            left.errorbar([0.0], [end[4]], yerr=[end[5]], fmt=f"{color}s", capsize=3)
        left.set(xlabel="voxel size in diameters", ylabel="bulk solid fraction, spheres")
        right.plot(wall[0], wall[1], label="spheres in a cylinder")
        right.plot(wall[0], wall[2], ":", label=f"de Klerk, rms {wall[3]:.3f}")
        right.set(xlabel="distance from the wall in diameters", ylabel="solid fraction")
