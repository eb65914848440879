"""
Rocks under gravity
===================

Random solids are packed under gravity and settle, the packing is verified against the true meshes, and saved.
"""

from pathlib import Path

import voxgran as vg
from benchmarks.model import arguments

[folder] = arguments(__doc__, folder=Path("out/rocks"))
rocks = [vg.make_shape("solid_union", seed=seed, solids=(3, 5)) for seed in range(3)]
box = vg.Box((4, 4, 10), periodic=(True, True, False))
packing = vg.pack(
    rocks, box, method="digital", count=60, sizes=vg.sizes.lognormal(1.0, 0.2), voxel_size=1 / 16, sweeps=4000
)
proof = vg.verify(packing)
vg.save(packing, folder / "packing.vtp", overwrite=True)
bottom = vg.window_solid_fraction(packing, (0, 0, 0.5), (4, 4, 2.5))
print(f"grains {packing.count}  verified {proof.ok}  solid fraction between 0.5 and 2.5: {bottom:.4f}")

# %%
# **The packing, coloured by size**

# Picture: A bed of 60 rounded rocks in a tall box, small ones dark and large ones bright.
vg.save_picture(packing, folder / "pack_rocks.png", overwrite=True)
