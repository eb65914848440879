"""
From a scan to a settled bed, a report and a deck
=================================================

A scanned asteroid becomes a bed of 150 rocks at rest, with a proof of rest, measures, a report and the input of LAMMPS.
The tutorial explains each step and shows the same at the prompt; this script is its code.
"""

from pathlib import Path

from matplotlib.image import imsave

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.force_chains import picture_forces

[folder] = arguments(__doc__, folder=Path("out/tutorial"))
folder.mkdir(parents=True, exist_ok=True)

# %%
# **A scan**
rock = vg.load_shape(vg.data_file("itokawa_lp.obj"))
form = vg.describe([rock], ["elongation", "flatness", "sphericity"])
print(f"{len(rock.faces)} triangles, elongation {float(form.elongation[0]):.2f}")

# %%
# **A clump of spheres for it**
#
# The engine that receives the bed computes with spheres; the clump shows how well 20 of them stand for the rock.
clump = vg.fit_clump(rock, max_spheres=20)
print(f"{clump.count} spheres, overlap {clump.errors.iou:.2f}")
# Picture: The scanned asteroid beside its clump of 20 spheres, coloured by the distance from the true surface.
vg.save_clump_picture([clump], folder / "tutorial_clump.png", overwrite=True)

# %%
# **A bed at rest**
sizes = vg.sizes.lognormal(1.0, 0.2)
box = vg.Box((5, 5, 10), periodic="xy")
packing = vg.pack(rock, box, method="gravity", count=150, friction=0.5, sizes=sizes, seed=1, unit="mm")
print(packing)
# Picture: A bed of 150 elongated rocks in the lower part of a tall box, small ones dark and large ones bright.
vg.save_picture(packing, folder / "tutorial_bed.png", window=(700, 700), overwrite=True)

# %%
# **Two proofs: nothing overlaps, and the bed rests**
print(vg.verify(packing).ok)
print(f"{vg.equilibrium(packing, friction=0.5).attrs['share_at_rest']:.2f} of the grains rest")
# Picture: The forces between the rocks as tubes between their centers, thick near the floor.
imsave(folder / "tutorial_forces.png", picture_forces(packing, window=(700, 700)))

# %%
# **Numbers**
statistics = vg.measure(packing)
print(f"bulk solid fraction {float(statistics['bulk_solid_fraction']):.3f}")
print(f"mean coordination number {float(statistics['mean_coordination_number']):.2f}")

# %%
# **Files: the packing, a report, and the input of LAMMPS**
vg.save(packing, folder / "bed.vtp", overwrite=True)
vg.save_report(packing, folder / "report.html", statistics=statistics, overwrite=True)
deck = vg.write_deck(packing, folder / "deck", engine="lammps", overwrite=True)
print(f"{len(deck.files)} files; run them by: {deck.command}")
