"""
Polyhedra, superquadrics, fragments and Fourier grains
======================================================

Polyhedra, smooth solids, fragments and grains from Fourier descriptors: numbers and a picture. The script prints, for
solids with a closed formula, the triangles and how far the volume of the mesh is from that of the true solid, and the
sum of the cells of a box.
"""

import math
from pathlib import Path

import numpy as np
from matplotlib.image import imsave

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.gallery import picture_shapes
from voxgran.shapes.families.random.polyhedron import sphere_swept, steiner_volume
from voxgran.shapes.families.regular.superquadric import volume_of
from voxgran.shapes.families.regular.tablet import volume_of as tablet_volume
from voxgran.shapes.generating.regular_solids import corners_of

[folder] = arguments(__doc__, folder=Path("out/shapes_polyhedra"))
folder.mkdir(parents=True, exist_ok=True)


def show(name, volume, solid):
    """Print a line about a shape and how far its volume is from that of the true solid."""
    error = abs(solid.volume / volume - 1)
    print(f"{name:18s} triangles {len(solid.faces):5d}  error of the volume {error:.1e}")


snub = corners_of("snub_cube")
snub = snub / np.linalg.norm(snub[0])
show("polyhedron", steiner_volume(snub, 0.2), sphere_swept(snub, 0.2, 0.004))
semi_axes, e = (1.0, 2.0, 3.0), 0.5
show(
    "superquadric", volume_of(e, e, np.array(semi_axes)), vg.make_shape("superquadric", e1=e, e2=e, semi_axes=semi_axes)
)
show("tablet", tablet_volume(4.0, 3.0, 0.5), vg.make_shape("tablet", radius=4, height=3, cap_height=0.5))
show("torus", 2 * math.pi**2 * 0.16, vg.make_shape("torus", major_radius=1, minor_radius=0.4))
cells = [vg.make_shape("voronoi_fragment", seed=1, cell=k, lengths=(1, 1, 1)) for k in range(64)]
print(f"voronoi_fragment   cells of one box, their sum: 1 {sum(cell.volume for cell in cells) - 1:+.0e}")

# %%
# **All families in one picture**
archimedean = ["truncated_tetrahedron", "cuboctahedron", "truncated_octahedron", "rhombicuboctahedron"]
archimedean += ["truncated_icosahedron", "icosidodecahedron"]
rows = [
    *vg.make_shapes("polyhedron", count=4, seed=4),
    *vg.make_shapes("polyhedron", count=4, seed=4, rounding=(0.05, 0.2)),
    *(vg.make_shape("polyhedron", solid=solid) for solid in archimedean),
    *(vg.make_shape("polyhedron", solid="snub_cube", mirror=mirror, rounding=0.05) for mirror in (False, True)),
    *(vg.make_shape("superquadric", e1=e, e2=e) for e in (0.1, 0.5, 1.0, 1.5, 2.0, 3.0)),
    *(vg.make_shape("superquadric", e1=e1, e2=e2) for e1, e2 in ((0.1, 1.0), (1.0, 3.0))),
    *(vg.make_shape("spherocylinder", aspect=aspect) for aspect in (1.2, 1.5, 2.0, 3.0)),
    *(
        vg.make_shape("tablet", aspect=aspect, cap=cap)
        for aspect, cap in ((0.5, 0.05), (0.5, 0.2), (0.3, 0.15), (1, 0.1))
    ),
    *(vg.make_shape("ring", aspect=aspect, bore=bore) for aspect, bore in ((1, 0.8), (0.4, 0.6))),
    *(vg.make_shape("hollow_cylinder", holes=holes) for holes in (4, 7)),
    *(vg.make_shape("torus", aspect=aspect) for aspect in (0.2, 0.4, 0.6, 0.9)),
    *vg.make_shapes("voronoi_fragment", count=4, seed=2),
    *vg.make_shapes("voronoi_fragment", count=2, seed=2, process="jittered", jitter=0.5),
    *vg.make_shapes("voronoi_fragment", count=2, seed=2, aspect=(1, 1, 0.4)),
    *vg.make_shapes("mollon_zhao", count=4, seed=3, d_2=(0.05, 0.2), d_8=0.01),
    *vg.make_shapes("mollon_zhao", count=4, seed=3, d_3=0.08, d_8=0.022),
]
picture = picture_shapes(rows, columns=8)
# half the size, each pixel the mean of four
height, width = (length // 2 * 2 for length in picture.shape[:2])
small = picture[:height, :width].reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))
# Picture: Rows of grains: polyhedra, rounded polyhedra, Archimedean solids, superquadrics from boxes to stars, rods,
#   tablets, rings, hollow cylinders, tori, fragments, and grains from Fourier descriptors.
imsave(folder / "shapes_polyhedra.png", small.round().astype(np.uint8))
