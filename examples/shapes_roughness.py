"""
Rough grains, rough sheets and crumpled paper
=============================================

What is measured on rough surfaces is compared with what was asked for. For each random field the script prints the
mean, over seeds, of what is measured on sheets of 15 by 15 correlation lengths, and of the volume of rough spheres
against its second-order formula; for crumpled sheets the largest relative change of a length.

Arguments: folder, number of seeds (10 in the documentation).
"""

import math
from pathlib import Path

import numpy as np
from matplotlib.image import imsave

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.gallery import picture_shapes

folder, seeds = arguments(__doc__, folder=Path("out/shapes_roughness"), seeds=3)
folder.mkdir(parents=True, exist_ok=True)

FIELDS = {
    "spectral, H = 0.3": {"method": "spectral", "hurst": 0.3},
    "spectral, H = 0.8": {"method": "spectral", "hurst": 0.8},
    "patir": {"method": "patir"},
    "patir, skewness -1": {"method": "patir", "skewness": -1.0, "kurtosis": 4.5},
    "whitehouse": {"method": "whitehouse"},
    "midpoint, H = 0.8": {"method": "midpoint", "hurst": 0.8},
}
NAMES = ("rms", "skewness", "kurtosis", "correlation_length", "hurst")
for name, field in FIELDS.items():
    sizes = {"lengths": (15, 15), "rms": 0.1, "correlation_length": 1.0, "shortest": 0.5}
    sheets = [vg.make_shape("rough_sheet", **sizes, **field, seed=seed) for seed in range(seeds)]
    found = {key: np.nanmean([sheet.record[f"roughness_{key}"] for sheet in sheets]) for key in NAMES}
    print(f"{name:20s} {'  '.join(f'{key} {value:.3f}' for key, value in found.items())}")

# %%
# **Rough spheres and crumpled sheets**
sphere, ratio = vg.make_shape("sphere"), 0.02 / 0.5
smooth = vg.roughen(sphere, rms=0.0)
for shortest in (0.4, 0.2, 0.1):
    changes = []
    for seed in range(seeds):
        rough = vg.roughen(sphere, rms=0.02, correlation_length=0.25, shortest=shortest, seed=seed)
        flat = vg.roughen(sphere, rms=0.0, correlation_length=0.25, shortest=shortest)
        changes.append(rough.volume / flat.volume - 1.0)
    error = np.mean(changes) / (3 * ratio**2) - 1.0
    deviation = np.std(changes) / (3 * ratio**2) / math.sqrt(len(changes))
    print(
        f"rough sphere         triangles {len(rough.faces):6d}  change of the volume against 3 s^2 / R^2: {error:+.3f} "
        f"+- {deviation:.3f}"
    )
crumpled = [vg.make_shape("crumpled", fold_length=0.25, seed=seed) for seed in range(seeds)]
folds, error = (np.array([one.record[key] for one in crumpled]) for key in ("folds", "isometry_error"))
print(f"crumpled             folds {folds.mean():.1f}  change of a length at most {error.max():.0e}")

# %%
# **All fields in one picture**
fine = {"correlation_length": 0.2, "shortest": 0.08}
rows = [
    *(vg.roughen(vg.make_shape("sphere"), **field, **fine, rms=0.02, seed=1) for field in list(FIELDS.values())[1:]),
    *(
        vg.roughen(vg.make_shape(family, seed=2), **fine, rms=0.012, seed=2)
        for family in ("box", "cylinder", "cone", "convex_polyhedron", "polyhedron")
    ),
    *(
        vg.make_shape("rough_sheet", **field, rms=0.06, correlation_length=0.2, shortest=0.08, seed=1)
        for field in list(FIELDS.values())[1:]
    ),
    *(vg.make_shape("crumpled", fold_length=length, seed=4) for length in (0.5, 0.35, 0.25, 0.2, 0.15)),
]
picture = picture_shapes(rows, columns=5)
# half the size, each pixel the mean of four
height, width = (length // 2 * 2 for length in picture.shape[:2])
small = picture[:height, :width].reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))
# Picture: Rough spheres, rough boxes, cylinders, cones and polyhedra, rough sheets, and sheets crumpled more and
#   more.
imsave(folder / "shapes_roughness.png", small.round().astype(np.uint8))
