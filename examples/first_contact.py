"""
The first contact of two bodies
===============================

Two random solids approach each other until they touch, and so do the clumps fitted to them, as in figures 8 and 9 of
Sajjadi & Khalili (2015). In each run one body starts at a random position and orientation and approaches the other by
small random translations and rotations until control points are too close; the last step is bisected to find the
contact. The script prints the gap that remains between the true surfaces, or their overlap, from the exact contacts of
the packing, and the direction of the contact point in the frame of the fixed body, which differs between runs. It
writes the poses as packings and a picture.

Arguments: folder, number of runs.
"""

import itertools
from pathlib import Path

import numpy as np
from matplotlib.image import imsave

import voxgran as vg
from benchmarks.encounter import Encounter
from benchmarks.model import arguments
from voxgran.geometry.rotation import normalized, product, rotation_matrices
from voxgran.report.scenes import picture_packing

folder, runs = arguments(__doc__, folder=Path("out/first_contact"), runs=2)
step, angle, bias = 0.05, 0.1, 0.5
folder.mkdir(parents=True, exist_ok=True)


# %%
# **One approach**
def unit(vector):
    """Return a vector of length 1."""
    return vector / np.linalg.norm(vector)


def walk(pair, generator, reach):
    """Return the offset and the orientations of two bodies at their first contact."""
    offset = reach * unit(generator.normal(size=3))
    orientations = normalized(generator.normal(size=(2, 4)))
    while True:
        direction = unit(generator.normal(size=3)) - bias * unit(offset)
        spin = normalized(np.array([[1.0, *(0.5 * angle * generator.normal(size=3))]]))[0]
        rotated = np.array([orientations[0], product(spin, orientations[1])])
        orientations = orientations if pair.is_refused(offset, rotated) else rotated
        if pair.is_refused(offset + step * direction, orientations):
            break
        offset = offset + step * direction
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (
            (low, middle) if pair.is_refused(offset + middle * step * direction, orientations) else (middle, high)
        )
    return offset + low * step * direction, orientations


# %%
# **Solids, and the clumps fitted to them**
solids = [vg.make_shape("solid_union", seed=seed) for seed in (3, 8)]
clumps = [vg.fit_clump(solid, max_spheres=40).to_shape() for solid in solids]
for name, bodies in (("solids", solids), ("clumps", clumps)):
    pair = Encounter(*bodies, spacing=0.06)
    sites = []
    for run in range(runs):
        offset, orientations = walk(
            pair, np.random.Generator(np.random.PCG64(run)), 1.2 * sum(b.bounding_radius for b in bodies)
        )
        wide = 1.05 * (np.linalg.norm(offset) + 2 * max(body.bounding_radius for body in bodies))
        centers = wide / 2 + np.outer([-0.5, 0.5], offset)
        packing = vg.Packing.of(
            bodies, vg.Box((wide,) * 3), position=centers, shape_id=[0, 1], orientation=orientations
        )
        contacts = packing.contacts(0.2)
        gap = float(contacts.gap[0]) / bodies[0].diameter
        site = rotation_matrices(orientations[:1])[0].T @ (contacts.point[0] - centers[0])
        sites.append(unit(site))
        what = f"{'overlap' if gap < 0 else 'gap'} at contact {abs(gap):.5f} diameters"
        print(f"{name} run {run}: {what}, touches towards {np.round(sites[-1], 2)}")
        vg.save(packing, folder / f"{name}_{run}.vtp", overwrite=True)
        # Picture: Two unions of solids that touch in one point.
        # Picture: The same bodies as clumps of spheres, which touch in one point.
        if run == 0:
            imsave(folder / f"{name}.png", picture_packing(packing))
    apart = [np.degrees(np.arccos(np.clip(a @ b, -1, 1))) for a, b in itertools.combinations(sites, 2)]
    print(
        f"{name}: {pair.points} control points, regions of contact {min(apart):.0f} to {max(apart):.0f} degrees apart"
    )
