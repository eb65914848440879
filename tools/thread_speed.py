"""Measure what threads save: thread_speed.py FILE.csv [MOST]

Each line is a function that takes a number of threads, with the seconds of the clock on one thread and on more, the
smallest of three, and whether the results have the same bits. It needs a machine that does nothing else.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import voxgran as vg
from benchmarks.model import arguments, write_rows
from voxgran._base.compiling.threads import using_threads
from voxgran._base.machine import processor_count
from voxgran._base.seeds import stream
from voxgran.settling.balance import gauss_seidel_forces
from voxgran.settling.bed import normalized_bed
from voxgran.settling.impulses import Fall, advance_bodies
from voxgran.settling.projected_gradient import accelerated_projected_gradient

CHECKED, POURED = 20_000, 100_000


def neighbours(shapes: list[vg.Shape], count: int) -> vg.Packing:
    """Return grains in random poses on a lattice, so close that the contacts of all neighbours have to be tested."""
    generator, edge = stream(1, "poses"), int(np.ceil(count ** (1 / 3)))
    turns = generator.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    place = np.stack(np.unravel_index(np.arange(count), (edge,) * 3), axis=1) + 0.5
    widest = max(shape.bounding_radius for shape in shapes)
    spacing, which = 1.9 * widest, np.arange(count) % len(shapes)
    box = vg.Box((spacing * edge,) * 3)
    return vg.Packing.of(shapes, box, position=spacing * place, orientation=turns, shape_id=which)


def bed_of(shapes: vg.Shape | list[vg.Shape], count: int, threads: int) -> float:
    """Return the mean height of a bed of grains at rest, half as tall as the box."""
    edge = (count / 2) ** (1 / 3)
    bed = vg.pack(shapes, vg.Box((edge, edge, 4 * edge)), "gravity", count=count, threads=threads)
    return float(bed.position[:, 2].mean())


def poured() -> dict[str, Callable[[int], float]]:
    """Return steps of solvers with poured spheres, which have 312,065 contacts: of the fall, the rest and the proof."""
    edge = (POURED / 3.0) ** (1 / 3)
    grains = vg.pack(vg.shapes.sphere(), vg.Box((edge, edge, 4 * edge), periodic="xy"), "deposition", count=POURED)
    bed = normalized_bed(grains, np.array([0.0, 0.0, -1.0]))
    bed.find(0.02, 0.0)
    rows = bed.rows.row.copy()

    def fall(threads: int) -> float:
        bed.rows.row[:], bed.bodies[:, :6] = rows, 0.0
        with using_threads(threads):
            for _ in range(10):
                how = Fall(np.array([0.5]))
                advance_bodies(bed.rows, bed.m, bed.bodies, bed.motion, bed.gravity, how, 1.0, np.zeros(0))
        return float(bed.motion.sum())

    def sweeps(threads: int) -> float:
        forces = np.zeros((bed.m, 3))
        with using_threads(threads):
            gauss_seidel_forces(
                bed.contacts, forces, np.zeros(bed.m), friction=0.5, skin=1e-5, iterations=60, tolerance=0
            )
        return float(forces.sum())

    def gradient(threads: int) -> float:
        forces = np.zeros((bed.m, 3))
        with using_threads(threads):
            accelerated_projected_gradient(bed.contacts, forces, friction=0.5, iterations=100, tolerance=0, near=0)
        return float(forces.sum())

    of = f"{POURED:,} spheres"
    return {
        f"fall, {of}, 10 steps": fall,
        f"sweeps of a quasi-static step, {of}, 60 iterations": sweeps,
        f"projected gradient, {of}, 100 iterations": gradient,
    }


def cases() -> dict[str, Callable[[int], Any]]:
    """Return the calls that are measured."""
    rock = vg.load_shape(vg.data_file("eros.obj"))
    convex = neighbours([vg.shapes.ellipsoid(aspect=(1, 1, 1.5))], CHECKED)
    meshes = neighbours(vg.make_shapes("polyhedron", count=5, solid="random"), CHECKED)
    pores = stream(2, "pores").random((250, 250, 250)) > 0.01
    solids = vg.make_shapes("solid_union", count=5)
    size = rock.volume ** (1 / 3) / 700
    return {
        "voxelize, a scan in 650 million voxels": lambda threads: (
            vg.voxelize(rock, voxel_size=size, threads=threads).volume
        ),
        "distance_transform, 250 voxels wide": lambda threads: vg.distance_transform(pores, threads=threads).sum(),
        "local_thickness, 250 voxels wide": lambda threads: vg.local_thickness(pores, threads=threads).sum(),
        "verify, 20,000 ellipsoids": lambda threads: vg.verify(convex, threads=threads).deepest,
        "verify, 20,000 polyhedra": lambda threads: vg.verify(meshes, threads=threads).deepest,
        "pack by gravity, 1,000 convex polyhedra": lambda threads: bed_of(vg.shapes.convex_polyhedron(), 1000, threads),
        **poured(),
        "pack by gravity, 30,000 spheres": lambda threads: bed_of(vg.shapes.sphere(), 30_000, threads),
        "pack by gravity, 300 random solids": lambda threads: bed_of(solids, 300, threads),
    }


def timed(call: Callable[[int], Any], threads: int) -> tuple[float, Any]:
    """Return the smallest time of three calls, and their result."""
    seconds = []
    for _ in range(3):
        began = time.perf_counter()
        found = call(threads)
        seconds.append(time.perf_counter() - began)
    return min(seconds), found


def main() -> None:
    """Write the table."""
    target, most = arguments(__doc__, "file", most=processor_count())
    rows = []
    for name, call in cases().items():
        call(1), call(most)
        (alone, one), (together, other) = timed(call, 1), timed(call, most)
        rows.append(
            {
                "call": name,
                "seconds_1": f"{alone:.3f}",
                "threads": most,
                "seconds": f"{together:.3f}",
                "factor": f"{alone / together:.2f}",
                "same_bits": one == other,
            }
        )
    write_rows(target, ",".join(rows[0]), [row.values() for row in rows])


if __name__ == "__main__":
    main()
