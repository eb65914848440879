"""
A shape from two point clouds
=============================

The asteroid Eros is reconstructed from point clouds with noise. Two scans are simulated, the second in another pose and
of one side only. They are registered and joined, outliers are removed, and a closed surface is fitted. The script
writes the joined cloud and the shape, and prints the errors of the shape relative to the original body, which is
unknown for a real scan.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.gallery import picture_shapes

[folder] = arguments(__doc__, folder=Path("out/scan"))
eros = vg.load_shape(vg.data_file("eros.obj"))
size, generator = eros.diameter, np.random.Generator(np.random.PCG64(4))
noise = 0.002 * size


# %%
# **Two scans with noise**
def scan(count, seed):
    """Return points of the surface with noise."""
    points = np.asarray(vg.sample_surface(eros, spacing=0.06 * size, seed=seed, method="uniform"))
    chosen = points[generator.choice(len(points), size=min(count, len(points)), replace=False)]
    return chosen + noise * generator.normal(size=chosen.shape)


first = scan(15_000, 1)
first = vg.Cloud.of(np.concatenate([first, generator.uniform(-size, size, (40, 3))]), name="first scan")
second = scan(15_000, 2)
second = second[second[:, 0] > -0.2 * size]
angle = np.deg2rad(70)
turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
second = vg.Cloud.of(second @ turn.T + 3 * size, name="second scan")

# %%
# **Registration and a closed surface**
first = first.without_outliers(3.0)
motion = vg.register_clouds(second, first)
joined = vg.Cloud.of(np.concatenate([first.points, motion.moved(second).points]), name="eros").clusters()[0]
made = vg.shape_of_cloud(joined)
vg.save_cloud(joined, folder / "scan.ply", overwrite=True)
vg.save_shape(made.shape, folder / "eros.stl", overwrite=True)

distance = np.abs(vg.load_shape(folder / "eros.stl").volume / eros.volume - 1)
print(f"registered with a residual of {motion.residual / noise:.2f} noises, {100 * motion.overlap:.0f} % of the points")
print(f"{len(joined)} points, mean residual {made.mean_residual / noise:.2f} noises")
print(f"volume off by {100 * distance:.3f} %")

# %%
# **Points and surface**
#
# The points of both scans are drawn in the frame of the first one, beside the surface that was fitted to them.
figure = Figure(figsize=(11, 4), layout="constrained")
panel = figure.add_subplot(1, 2, 1, aspect="equal", title="points of both scans", xlabel="x", ylabel="y")
for cloud, name, marker in ((first, "first scan", "."), (motion.moved(second), "second scan, moved", "x")):
    panel.plot(*cloud.points[::8, :2].T, marker, markersize=2, label=name)
panel.legend(frameon=False, markerscale=4, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
panel = figure.add_subplot(1, 2, 2, title="fitted surface")
panel.imshow(picture_shapes([made.shape]))
panel.axis("off")
# Picture: Points of two scans that cover each other after registration, and the closed surface of the elongated
#   asteroid.
figure.savefig(folder / "scan_to_shape.png", dpi=100)
