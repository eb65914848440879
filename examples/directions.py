"""
Lattice directions against any directions
=========================================

Eight or 26 lattice directions are compared with arbitrary directions, as in figure 7 of Sajjadi & Khalili (2015).

First, free grains take random steps on a lattice or in arbitrary directions; the fourth moment of their positions,
relative to an isotropic distribution, measures the influence of the axes (1: none). Then the same grains are packed in
the same box by digital packing (lattice directions) and by control-point packing (arbitrary directions). The script
prints solid fraction, seconds, and the share of contact normals within 15 degrees of a lattice direction, relative to
isotropic normals (1: no preference), and writes a figure.

Arguments: folder, number of grains.
"""

import itertools
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments

folder, count = arguments(__doc__, folder=Path("out/directions"), count=200)
steps, walkers, cone = 64, 40_000, np.deg2rad(15)
near = 0.15  # gap in diameters up to which two grains are neighbours: more than the two voxels left by a lattice
generator = np.random.Generator(np.random.PCG64(7))
figure = Figure(figsize=(11, 6), layout="constrained")
panels = figure.subplots(2, 3)


# %%
# **Directions and what is measured**
def lattice_directions(dimension):
    """Return the 8 or 26 steps to the neighbours of a site."""
    return np.array([d for d in itertools.product((-1, 0, 1), repeat=dimension) if any(d)], dtype=float)


def any_directions(dimension, many):
    """Return random unit vectors."""
    drawn = generator.normal(size=(many, dimension))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def fourth_moment(positions):
    """Return the mean of the sum of x_i^4 over that of r^4, relative to the isotropic value 3 / (d + 2)."""
    dimension = positions.shape[1]
    return float((positions**4).sum() / ((positions**2).sum(axis=1) ** 2).sum() * (dimension + 2) / 3)


def near_axes(normals, dimension):
    """Return the share of normals near a lattice direction, relative to that of isotropic normals."""
    directions = lattice_directions(dimension)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)

    def share(vectors):
        return float((np.max(vectors @ directions.T, axis=1) > np.cos(cone)).mean())

    return share(normals[:, :dimension]) / share(any_directions(dimension, 200_000))


# %%
# **Free walks, and packings by both methods**
for row, dimension in enumerate((2, 3)):
    directions = lattice_directions(dimension)
    for column, lattice in enumerate((True, False)):
        first = (
            directions[generator.integers(0, len(directions), walkers)]
            if lattice
            else any_directions(dimension, walkers)
        )
        positions = first.copy()
        for _ in range(steps - 1):
            drawn = generator.integers(0, len(directions), walkers)
            positions += directions[drawn] if lattice else any_directions(dimension, walkers)
        title = f"{len(directions)} directions" if lattice else "any direction"
        panels[row, column].plot(*positions[:3000, :2].T, ".", ms=1, rasterized=True)
        panels[row, column].set(title=f"{dimension}D, {title}, {steps} steps", aspect="equal", xlabel="x", ylabel="y")
        moments = f"1 step {fourth_moment(first):.3f}, {steps} steps {fourth_moment(positions):.3f}"
        print(f"{dimension}D {title:14s} fourth moment: {moments}")
    shape = vg.make_shape("disk") if dimension == 2 else vg.make_shape("sphere")
    box = vg.Rectangle((10, 4 + count / 8), "x") if dimension == 2 else vg.Box((5, 5, 4 + count / 20), "xy")
    for method, options in (("digital", {"voxel_size": 1 / 16, "sweeps": 2000}), ("control_point", {"sweeps": 60})):
        # directions of the walk: nothing settles after it
        packing = vg.pack(shape, box, method=method, count=count, seed=1, settle=False, **options)
        normals = packing.contacts(near).normal
        bulk = float(vg.measure(packing, which=["density"])["/"].bulk_solid_fraction)
        ratio = near_axes(normals, dimension)
        print(
            f"{dimension}D {method:14s} grains {packing.count}  bulk {bulk:.4f}  normals near lattice directions "
            f"{ratio:.2f} of isotropic  verified {vg.verify(packing).ok}"
        )
        angle = np.arctan2(normals[:, dimension - 1], normals[:, 0])
        panels[row, 2].hist(angle % np.pi, bins=18, range=(0, np.pi), density=True, histtype="step", label=method)
    panels[row, 2].set(title=f"{dimension}D, angle of contact normals", xlabel="radians", ylabel="density")
    panels[row, 2].margins(y=0.35)
    panels[row, 2].legend(frameon=False, ncols=2, loc="upper center")
folder.mkdir(parents=True, exist_ok=True)
# Picture: Positions after random steps in eight, 26 and any directions, round clouds in all cases, and histograms of
#   the angles of contact normals by both methods.
figure.savefig(folder / "directions.svg")
