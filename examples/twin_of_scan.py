"""
A twin of a scanned sample
==========================

A compressed specimen of polyhedra becomes an image, which is cut, segmented and labelled as a scan is. The twin is made
of the labels alone. The script prints the measures of the specimen and of the twin, with the ratio of their difference
to its standard error, writes the page that compares the labels with the twin, and draws both.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.scenes import picture_cut

folder, count = arguments(__doc__, folder=Path("out/twin_of_scan"), count=250)
folder.mkdir(parents=True, exist_ok=True)
VOXEL = 0.06
rocks = vg.make_shapes("convex_polyhedron", count=40, seed=1)
sizes = vg.sizes.lognormal(median=1.0, sigma=0.2)
box = vg.Box((8.5, 8.5, 8.5), periodic="xyz")
specimen = vg.pack(rocks, box, "compress", count=count, sizes=sizes, friction=0.2, seed=3)

# %%
# **The image, cut, segmented and labelled**
image = vg.to_image(specimen, VOXEL, labels=False)[6:-6, 6:-6, 6:-6]
labels = vg.segment(image.astype(float), threshold=0.5, voxel_size=VOXEL).labels
scan = vg.packing_of_labels(np.asarray(labels), voxel_size=VOXEL, gravity="none")

# %%
# **The twin, and both against the specimen that the scan has seen a part of**
twin = vg.twin(scan, count=count, forms=60, seed=5)
twin.report(folder / "twin.html", overwrite=True)
true = twin.compared_with(specimen)
for name in true.measure.values:
    row = true.sel(measure=name)
    print(
        f"{name}  specimen {float(row['sample']):.4g}  twin {float(row['twin']):.4g}  ratio {float(row['ratio']):.1f}"
    )


def side_by_side(pictures):
    """Return a figure of packings side by side, cut."""
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    for panel, (title, packing) in zip(figure.subplots(1, 2), pictures.items(), strict=True):
        panel.imshow(picture_cut(packing))
        panel.set_title(title)
        panel.axis("off")
    return figure


# %%
# **Scan and twin**
pair = side_by_side({"labels of the scan": scan, "twin": twin.packing})
# Picture: On the left the labels of a scanned box, cut flat by its border; on the right as many whole grains in a
#   periodic box.
pair.savefig(folder / "twin_of_scan.png", dpi=110)

# %%
# **What a twin does not keep**
#
# A bed of two layers becomes a bed with the same spheres and the same solid fraction, in which they are mixed.
layers = [
    {"shapes": vg.shapes.sphere(diameter=diameter), "count": many}
    for diameter, many in ((0.7, count), (1.3, count // 5))
]
bed = vg.pack_layers(layers, vg.Box((5, 5, 20), periodic="xy"), friction=0.1)
mixed = vg.twin(bed)
for name, packing in (("bed", bed), ("twin", mixed.packing)):
    related = np.corrcoef(packing.position[:, 2], packing.diameters)[0, 1]
    print(f"correlation of height and diameter in the {name} {related:.2f}")
pair = side_by_side({"bed of two layers": bed, "twin": mixed.packing})
# Picture: On the left small spheres below large ones; on the right both sizes at all heights.
pair.savefig(folder / "twin_mixes.png", dpi=110)
