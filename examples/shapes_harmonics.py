"""
A scan and its siblings
=======================

Random grains with the power spectrum of a scan, grains of a power law, and Gaussian random spheres, in rows. Each
sibling has the power of the scan on all length scales; the table shows that other descriptors scatter around it.

Arguments: folder, number of siblings.
"""

from pathlib import Path

import voxgran as vg
from benchmarks.model import arguments

folder, count = arguments(__doc__, folder=Path("out/shapes_harmonics"), count=8)
folder.mkdir(parents=True, exist_ok=True)

scan = vg.load_shape(vg.data_file("itokawa_lp.obj"))
siblings = vg.make_shapes("spherical_harmonics", like=scan, count=count, seed=2)
rough = vg.make_shapes("spherical_harmonics", count=count + 1, seed=1, roughness=(0.08, 0.25), exponent=(2, 4))
smooth = vg.make_shapes("noise_star", count=count + 1, seed=1, correlation_angle=(20, 60))
for name, shapes in (("scan", [scan]), ("siblings", siblings), ("power law", rough), ("Gaussian", smooth)):
    form = vg.describe(shapes, ["elongation", "flatness", "sphericity"]).mean()
    print(f"{name:10}", *(f"{key} {float(value):.3f}" for key, value in form.items()), sep="  ")
# Picture: The scanned asteroid Itokawa and siblings of similar elongation, grains from smooth to rough, and smooth
#   rounded grains.
vg.save_gallery(
    [scan.scaled(1 / scan.diameter), *siblings, *rough, *smooth],
    folder / "shapes_harmonics.png",
    columns=count + 1,
    overwrite=True,
)
print(f"picture in {folder}")
