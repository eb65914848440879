"""
From a CT scan to a packing
===========================

A bed of rocks becomes a grey image with blur and noise, whose voxels are higher than wide, as a scanner would give it.
From there on only the image is used: grey values become labels, labels become grains with true surfaces, and the
packing of these is checked and measured. Its solid fraction and its grains are compared with those of the bed, which
are unknown for a real scan.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.scenes import picture_packing

folder, count = arguments(__doc__, folder=Path("out/scan_to_packing"), count=200)
edges = (0.05, 0.05, 0.08)

# %%
# **A scan of the inner part of a bed**
rocks = vg.make_shapes("polyhedron", count=20, seed=1, rounding=0.2)
box = vg.Box((6, 6, 9))
bed = vg.pack(rocks, box, "gravity", count=count, sizes=vg.sizes.lognormal(1.0, 0.15), unit="mm", seed=1)
true = vg.to_image(bed, edges)[10:-10, 10:-10, 5 : 5 + round(0.28 * count)]
noise = np.random.Generator(np.random.PCG64(1)).normal(0, 8, true.shape)
grey = 60 + 120 * gaussian_filter((true > 0).astype(float), 0.8) + noise
folder.mkdir(parents=True, exist_ok=True)
vg.save_image(grey.astype(np.uint8), folder / "grey.tif", voxel_size=edges, unit="mm", overwrite=True)

# %%
# **Grey values, labels, grains**
image = vg.load_image(folder / "grey.tif")
labels = vg.segment(image)
scan = vg.packing_of_labels(labels, voxel_size=image.voxel_size, unit=image.unit, gravity="none")
vg.save(scan, folder / "scan.vtp", overwrite=True)
window = np.array(true.shape) * edges
lower = box.bounds[0] + np.array([10, 10, 5]) * edges
exact = vg.window_solid_fraction(bed, lower, lower + window)
print(f"grains {scan.count} of {len(np.unique(true)) - 1}  verified {vg.verify(scan).ok}")
print(f"solid fraction {scan.solid_fraction:.4f}, of the bed {exact:.4f}")
print(f"surface {scan.surface_areas.sum():.1f} mm2")

# %%
# **A slice of the image, its labels, and the grains**
figure = Figure(figsize=(12, 4), layout="constrained")
panels = figure.subplots(1, 3)
extent = (0, window[0], 0, window[2])
panels[0].imshow(image.values[:, 50].T, cmap="gray", origin="lower", extent=extent)
shown = np.where(labels > 0, 1 + labels % 19, np.nan)
panels[1].imshow(shown[:, 50].T, cmap="tab20", origin="lower", extent=extent, interpolation="nearest")
panels[2].imshow(picture_packing(scan, window=(700, 700), legend=False))
panels[2].axis("off")
for panel, title in zip(panels, ("grey values", "labels", "packing"), strict=True):
    panel.set_title(title)
# Picture: A slice of a grey image of rocks, the same slice with a colour for each label, and the rocks as solids whose
#   faces at the border of the image are flat.
figure.savefig(folder / "scan_to_packing.png", dpi=100)
