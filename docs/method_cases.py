"""The example of each method and family: what its page packs, when to take it, and the figure of its bench.

Examples are written once, as the tables of a scene; the page shows them as Python and as a scene, and draws the result.
When to take a packing method stands in the table of guide/choosing.md, from which the pages take it.
"""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Case:
    """What the page of one entry shows beside what the registry holds."""

    guide: str  # page of docs/guide, with its heading
    bench: str = ""  # name of the bench that measures it, whose figure is docs/figures/NAME.svg; "" if none does
    when: str = ""  # when to take it, where guide/choosing.md does not say it
    options: dict[str, Any] = field(default_factory=dict)  # parameters of the example
    shape: dict[str, Any] = field(default_factory=lambda: {"family": "sphere"})
    container: dict[str, Any] = field(default_factory=lambda: {"kind": "box", "lengths": [6, 6, 6]})
    sizes: dict[str, Any] = field(default_factory=dict)


GRADED = {"kind": "uniform", "low": 0.6, "high": 1.2}
ROCKS = {"family": "convex_polyhedron", "seed": 3, "points": 14}
COLUMN = {"kind": "box", "lengths": [4, 4, 8], "periodic": ["x", "y"]}
SQUARE = {"kind": "rectangle", "lengths": [12, 12]}
DISK = {"family": "disk"}

PACKING = {
    "advancing_front": Case("front.md", "front", options={"mode": "dense"}, sizes=GRADED),
    "apollonian": Case(
        "spheres.md", "exponents", options={"count": 300}, shape=DISK, container={"kind": "disk", "radius": 6}
    ),
    "compress": Case(
        "specimens.md",
        "compression",
        options={"count": 150, "friction": 0.3},
        container={"kind": "box", "lengths": [5, 5, 5], "periodic": ["x", "y", "z"]},
    ),
    "control_point": Case("control.md", "contact", options={"count": 60, "sweeps": 20}, shape=ROCKS, container=COLUMN),
    "deposition": Case("spheres.md", "deposits", options={"count": 150}, container=COLUMN),
    "digital": Case("digital.md", "digital", options={"count": 60, "sweeps": 200}, shape=ROCKS, container=COLUMN),
    "digital_fill": Case(
        "digital.md", "density", options={"count": 50}, shape=ROCKS, container={"kind": "box", "lengths": [4, 4, 5]}
    ),
    "digital_rsa": Case("digital.md", "rsa", options={"count": 60}, shape=ROCKS),
    "expand": Case("spheres.md", "jamming", options={"solid_fraction": 0.5}, sizes=GRADED),
    "gravity": Case("settling.md", "settle", options={"count": 60}, shape=ROCKS, container=COLUMN),
    "growth": Case("spheres.md", "exponents", options={"count": 300}, shape=DISK, container=SQUARE),
    "jam": Case("spheres.md", "jamming", options={"count": 300}, container={"kind": "box", "lengths": [7, 7, 7]}),
    "multilayer": Case("spheres.md", "spheres", options={"solid_fraction": 0.55, "layers": 4}, sizes=GRADED),
    "random_apollonian": Case("spheres.md", "exponents", options={"count": 300}, shape=DISK, container=SQUARE),
    "rsa": Case("rsa.md", "rsa", options={"count": 120}, shape=ROCKS),
    "tetrahedral": Case("spheres.md", "spheres", options={"count": 600}),
    "voronoi_fill": Case("spheres.md", "tessellation", options={"count": 120}, shape=ROCKS, sizes=GRADED),
}

CLUMPS = {
    "cluster": Case("clumps.md", "clumps", "All spheres shall be equal or lie on a lattice, as in breakable clusters."),
    "dynamic": Case("clumps.md", "clumps", "A close surface is wanted at once, with spheres of similar radii."),
    "four_point": Case("clumps.md", "clumps", "A good fit in tenths of a second, for very many different shapes."),
    "inner_normal": Case("clumps.md", "clumps", "The surface shall be within a given distance, at the cost of volume."),
    "inscribed": Case("clumps.md", "clumps", "No sphere may protrude, and few large spheres shall carry the volume."),
    "optimal": Case("clumps.md", "clumps", "The usual choice: the least error of volume, surface and inertia."),
}

_ROUND = "Bodies of closed formula, against which other shapes and methods are checked."
FAMILIES = {
    "box": Case("shapes.md", when="Cubes, bricks and plates: contacts between faces, edges and corners."),
    "cone": Case("shapes.md", when=_ROUND, options={"aspect": 1.5}),
    "convex_polyhedron": Case("shapes.md", when="Crushed rock and ballast: angular grains at the least cost."),
    "crumpled": Case("shapes.md", when="Crumpled paper and foil: folded sheets that are not stretched."),
    "cube_rain": Case("shapes.md", when="Angular aggregates of cubes that sank into each other."),
    "cylinder": Case("shapes.md", when="Pellets, rods and catalyst bodies.", options={"aspect": 2.0}),
    "disk": Case("shapes.md", when="Grains of two-dimensional studies."),
    "ellipsoid": Case("shapes.md", when="Smooth grains longer than wide.", options={"aspect": (1.5, 1.0, 0.7)}),
    "hollow_cylinder": Case("shapes.md", when="Catalyst pellets with several holes."),
    "learned": Case("twins.md", "twins", "Grains like those of a scanned sample.", options={"model": "shapes.nc"}),
    "mollon_zhao": Case("shapes.md", "shapes", "Sand whose sections were measured as Fourier descriptors."),
    "mollon_zhao_2d": Case("shapes.md", when="Outlines of sand with measured Fourier descriptors."),
    "noise_star": Case("shapes.md", "shapes", "Pebbles and dust: smooth random grains of a correlation angle."),
    "platonic": Case("shapes.md", when="Dice: the five regular solids.", options={"solid": "dodecahedron"}),
    "polygon": Case("shapes.md", when="Angular grains of two-dimensional studies."),
    "polyhedron": Case("shapes.md", "shapes", "Angular or rounded polyhedra, random or regular."),
    "random_growth": Case("shapes.md", when="Porous to smooth aggregates of cubes."),
    "random_surface": Case("shapes.md", when="Flakes: open surfaces without thickness."),
    "ring": Case("shapes.md", when="Column packings and tubes: cylinders with one hole."),
    "rough_sheet": Case("shapes.md", when="Rough rock joints and walls with a measured roughness."),
    "sheet": Case("shapes.md", when="Plates and rolls without thickness.", options={"roll": 150}),
    "shell": Case("shapes.md", when="Broken hollow spheres: caps without thickness."),
    "sierpinski_sponge": Case("shapes.md", when="Porous bodies of a known fractal dimension."),
    "solid_union": Case("shapes.md", "shapes", "Concave rocks of any roundness: the general random solid."),
    "sphere": Case("shapes.md", when=_ROUND),
    "sphere_assembly": Case("shapes.md", when="Agglomerates of connected spheres."),
    "spherical_harmonics": Case("shapes.md", "shapes", "Siblings of a scan, with its power on all length scales."),
    "spherocylinder": Case("shapes.md", "shapes", "Rods and fibres with smooth ends.", options={"aspect": 2.5}),
    "superquadric": Case("shapes.md", "shapes", "Tablets, rounded boxes and stars by two exponents."),
    "superspherize": Case("shapes.md", "shapes", "Grains between a polyhedron and a sphere."),
    "tablet": Case("shapes.md", when="Pills and pellets with domed ends."),
    "torus": Case("shapes.md", "shapes", "Rings of circular section."),
    "voronoi_fragment": Case("shapes.md", when="Fragments that fill the body from which they broke."),
    "voxel_rain": Case("shapes.md", when="Columns of deposited cubes with rough surfaces."),
}
