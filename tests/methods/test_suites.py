"""The suites of `voxgran.testing` hold for what voxgran registers itself: families, measures, containers, engines."""

import pytest

import voxgran as vg
from voxgran.measures.model import measure_registry, measures
from voxgran.testing import ContainerSuite, EngineSuite, MeasureSuite, ShapeFamilySuite

pytestmark = pytest.mark.usefixtures("forked_readers")

CONTAINERS = {
    "Box": vg.Box((3, 4, 5), "x", origin=(1, 0, 0)),
    "Cylinder": vg.Cylinder(2.0, 3.0),
    "Sphere": vg.Sphere(2.0, origin=(5, 0, 0)),
    "ClosedMesh": vg.ClosedMesh(vg.make_shape("convex_polyhedron", seed=2, diameter=4.0)),
    "Hopper": vg.Hopper(radius=4, outlet=1.5, angle=55, bin_height=1, origin=(1, 0, 2)),
    "Wedge": vg.Hopper(radius=4, outlet=1.5, angle=55, length=3, bin_height=1),
    "Funnel": vg.Funnel(radius=1, outlet=2, height=3),
    "Drum": vg.Drum(radius=2, length=3, axis="y", origin=(0, 1, 0)),
    "Planes": vg.Planes([(-1, 0, 0), (0, -1, 0), (0, 0, -1), (1, 1, 1)], [(0, 0, 0)] * 3 + [(6, 0, 0)]),
    "Walls": vg.Walls(
        [
            {"kind": "cylinder", "radius": 2, "axis": (1, 0, 2)},
            {"kind": "sphere", "radius": 3, "point": (0, 0.5, 0)},
            {"kind": "plane", "normal": (0.2, 0, 1), "point": (0, 0, 1.5)},
            {"kind": "cone", "radius": 2, "angle": 60, "point": (0, 0, -1)},
        ]
    ),
    "Rectangle": vg.Rectangle((3, 4), "x"),
    "Disk": vg.Disk(2.0, origin=(5, 1)),
    "Polygon": vg.Polygon([(0, 0), (6, 0), (6, 4), (0, 4)], holes=[[(2, 1), (3, 1), (3, 2), (2, 2)]]),
}
#: a packing without forces has none to measure
MEASURES = [name for name in measures() if measure_registry().get(name).applies(MeasureSuite.packing())]

for name in vg.shape_families():
    needs = {"model": vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=10))} if name == "learned" else {}
    made = {"family": name, "parameters": needs}
    globals()[f"TestFamily{name.title()}"] = type(f"TestFamily{name.title()}", (ShapeFamilySuite,), made)
for name in MEASURES:
    globals()[f"TestMeasure{name.title()}"] = type(f"TestMeasure{name.title()}", (MeasureSuite,), {"name": name})
for name in vg.engines():
    globals()[f"TestEngine{name.title()}"] = type(f"TestEngine{name.title()}", (EngineSuite,), {"engine": name})
for name, where in CONTAINERS.items():
    made = {"container": lambda self, where=where: where}
    globals()[f"TestContainer{name}"] = type(f"TestContainer{name}", (ContainerSuite,), made)
