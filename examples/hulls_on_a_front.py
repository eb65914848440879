"""
Many polyhedra, each of its own shape
=====================================

Each sphere of a dense advancing front gets a convex hull of its own. The script prints and writes the CPU seconds
after each stage, and the solid fractions. All stages are run on a few grains beforehand, so that kernels are compiled
and libraries loaded.

Arguments: folder, number of spheres (64,000 in the documentation).
"""

import time
from pathlib import Path

from matplotlib.image import imsave

import voxgran as vg
from benchmarks.model import arguments, write_rows
from voxgran.report.scenes import picture_cut

folder, count = arguments(__doc__, folder=Path("out/hulls_on_a_front"), count=5000)


# %%
# **The stages**
def packed(count: int) -> tuple[vg.Packing, list[tuple[str, float, float]]]:
    """Return hulls in a cube, and the name, the seconds and the solid fraction of each stage."""
    edge = (count * 0.7) ** (1 / 3)
    box, sizes, rows = vg.Box((edge, edge, edge)), vg.sizes.uniform(0.7, 1.2), []
    began = time.process_time()
    spheres = vg.pack(vg.make_shape("sphere"), box, "advancing_front", mode="dense", sizes=sizes, seed=1)
    rows.append(("spheres on the front", time.process_time() - began, spheres.solid_fraction))
    hulls = vg.make_shapes("polyhedron", count=spheres.count, points=(8, 20), seed=1)
    rows.append(("hulls", time.process_time() - began, 0.0))
    packing = vg.inscribe(spheres, hulls, shape_id=range(spheres.count), seed=1)
    rows.append(("hulls in the spheres", time.process_time() - began, packing.solid_fraction))
    proof = vg.verify(packing)
    rows.append((f"verified {proof.ok}", time.process_time() - began, packing.solid_fraction))
    return packing, rows


# %%
# **Times and solid fractions**
packed(50)
packing, rows = packed(count)
folder.mkdir(parents=True, exist_ok=True)
lines = []
print(f"{packing.count} polyhedra, each of its own shape")
for name, seconds, fraction in rows:
    print(f"{name:22s} {seconds:7.2f} s  solid fraction {fraction:.4f}")
    lines.append((name, f"{seconds:.2f}", f"{fraction:.4f}"))
head = "stage,cpu_seconds_so_far,solid_fraction"
write_rows(folder / "hulls_on_a_front.csv", head, [*lines, (f"{packing.count} grains", "", "")])
vg.save(packing, folder / "hulls.vtp", overwrite=True)

# %%
# **The packing, cut open**

# Picture: A cut box of several thousand polyhedra, coloured by their size.
imsave(folder / "hulls_on_a_front.png", picture_cut(packing))
