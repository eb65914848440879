"""
Grains that deform at their contacts
====================================

A bed that was packed with some overlap becomes a bed of deformed bodies that only touch. Spheres and ellipsoids are
packed by control points that may penetrate other grains to a small depth. Then the grains are deformed, with spheres
stiffer than ellipsoids. The script prints the volumes, the overlaps before and after (by exact booleans of manifold3d)
and the contacts; it writes the surfaces for ParaView and a section through the bed.
"""

from pathlib import Path

import manifold3d
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments

[folder] = arguments(__doc__, folder=Path("out/deformed_grains"))
shapes = [vg.make_shape("sphere"), vg.make_shape("ellipsoid", aspect=(1.3, 1.0, 0.8))]
box = vg.Box((2.4, 2.4, 4.0), periodic="xy")
walk = {"spacing": 0.2, "overlap": 0.04, "rate": 0.01, "sweeps": 300, "cycles": 2}
# grains that settle do not overlap
packing = vg.pack(shapes, box, method="control_point", count=16, seed=4, settle=False, **walk)
stiffness = np.where(packing.shape_id == 0, 4.0, 1.0)
soft = vg.deform(packing, stiffness=stiffness, spacing=0.2)


# %%
# **Checks by an independent library**
def common_volume(bodies):
    """Return the sum of the common volumes of neighbouring grains."""
    total, lengths = 0.0, box.bounds[1] - box.bounds[0]
    for i, j, image in zip(soft.i, soft.j, soft.image, strict=True):
        total += (bodies[i] ^ bodies[j].translate((image * lengths).tolist())).volume()
    return total


def solid(vertices, faces):
    """Return a solid for boolean operations."""
    return manifold3d.Manifold(manifold3d.Mesh64(np.ascontiguousarray(vertices), faces.astype(np.uint64)))


def cut(vertices, faces, level):
    """Return the intersections of triangles with the plane y = level as line segments, (n, 2, 2) in x and z."""
    corners = vertices[faces] - [0, level, 0]
    above = (corners[..., 1] > 0).sum(axis=1)
    corners = corners[(above > 0) & (above < 3)]
    ends = []
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        crosses = (a[:, 1] > 0) != (b[:, 1] > 0)
        share = a[:, 1] / np.where(crosses, a[:, 1] - b[:, 1], 1.0)
        ends.append(np.where(crosses[:, None], a + share[:, None] * (b - a), np.nan))
    ends = np.stack(ends, axis=1)[..., [0, 2]]
    return ends[~np.isnan(ends[..., 0])].reshape(-1, 2, 2)


# %%
# **Overlaps before and after**
before = [packing.world_vertices(g) for g in range(packing.count)]
meshes = [shapes[k].faces for k in packing.shape_id]
overlap = common_volume([solid(*mesh) for mesh in zip(before, meshes, strict=True)])
left = common_volume([solid(*mesh) for mesh in zip(soft.vertices, soft.faces, strict=True)])
print(f"grains {packing.count}  contacts {len(soft.i)}  deepest overlap {soft.depth.max():.3f} diameters")
print(f"overlapping volume {overlap:.2e} before, {left:.2e} after, {left / overlap:.1e} of it")
print(f"volume of a grain changed by {soft.volume_error:.0e} at the most")
print(f"area of a contact {soft.area.mean():.4f} mean, force {soft.force.mean():.2e} mean")
folder.mkdir(parents=True, exist_ok=True)
vg.save_deformed(soft, folder / "deformed.vtp", overwrite=True)

# %%
# **A section through the bed, and through one contact**
# the deepest contact of a sphere and an ellipsoid within the box
unlike = (packing.shape_id[soft.i] != packing.shape_id[soft.j]) & ~soft.image.any(axis=1)
i, j = (grains[np.where(unlike, soft.depth, 0.0).argmax()] for grains in (soft.i, soft.j))
middle = soft.vertices[i][np.linalg.norm(soft.vertices[i] - packing.position[j], axis=1).argmin()]
figure = Figure(figsize=(9, 5), layout="constrained")
for panel, half in zip(figure.subplots(1, 2), (np.inf, 0.25), strict=True):
    for grain in range(packing.count):
        surfaces = [((soft.vertices[grain], soft.faces[grain]), f"C{packing.shape_id[grain]}", 1.4)]
        if np.isfinite(half):
            surfaces.append(((before[grain], meshes[grain]), "0.6", 0.8))
        for surface, color, width in surfaces:
            lines = cut(*surface, middle[1])
            seen = np.abs(lines - middle[[0, 2]]).max(axis=(1, 2)) < half + 0.1
            panel.add_collection(LineCollection(lines[seen], colors=color, linewidths=width))
    panel.set(aspect="equal", xlabel="x", ylabel="z", title="section through the bed")
    panel.autoscale()
    if np.isfinite(half):
        panel.set(xlim=middle[0] + np.array([-half, half]), ylim=middle[2] + np.array([-half, half]))
        panel.set(title="one contact; grey: before")
# Picture: Outlines of a section through touching grains, spheres blue and ellipsoids orange, and one contact
#   magnified: the common boundary is curved into the softer grain.
figure.savefig(folder / "deformed_grains.svg")
