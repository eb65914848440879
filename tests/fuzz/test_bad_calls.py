"""Bad calls of every public function: each argument, in turn, becomes each of thirty values that break naive code.

A call gives a result or one sentence of an error of voxgran, never an error of Python or of a library. `GOOD` has a
call of each public function that is fine; a new function is added there.
"""

import functools
import inspect
import warnings
from decimal import Decimal
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import VoxgranError

DEEP = functools.reduce(lambda inner, _: [inner], range(100_000), [])

VALUES = {
    "None": None,
    "True": True,
    "text": "no",
    "empty text": "",
    "text with NUL": "a\0b",
    "surrogate": "\udcff",
    "nan": float("nan"),
    "inf": float("inf"),
    "5e-324": 5e-324,
    "1e308": 1e308,
    "-1": -1,
    "0": 0,
    "2.5": 2.5,
    "10**9": 10**9,
    "10**400": 10**400,
    "10**5000": 10**5000,
    "sNaN": Decimal("sNaN"),
    "complex": 1j,
    "bytes": b"no",
    "empty list": [],
    "list of texts": ["a", "b"],
    "ragged list": [[1, 2], [1, 2, 3]],
    "deep list": DEEP,
    "dict": {"a": 1},
    "set": {1, "a"},
    "generator": (item for item in ()),
    "function": lambda: None,
    "class": dict,
    "object": object(),
    "path": Path("/proc/self/mem"),
    "array of texts": np.array(["density", "b"]),
    "array of NaN": np.full((3, 3), np.nan),
    "empty array": np.zeros((0, 3)),
    "array of objects": np.array([None, {}], dtype=object),
    "masked array": np.ma.masked_all((2, 3)),
    "date": np.datetime64("2020-01-01"),
    "shape": vg.make_shape("sphere"),
}

SPHERE, BOX = VALUES["shape"], vg.Box((4, 4, 4))
ROCK = vg.Shape.of(vg.make_shape("box").geometry, name="rock")
MESH = vg.Shape.from_mesh(ROCK.vertices, ROCK.faces)
TANK = vg.Shape.from_mesh(
    np.concatenate([4 * MESH.vertices, 3 * MESH.vertices]), np.concatenate([MESH.faces, MESH.faces[:, ::-1] + 8])
)
DISK = vg.make_shape("disk")
BED = vg.Packing.of([SPHERE], BOX, position=[(1, 1, 0.5), (3, 3, 0.5)], gravity=(0.0, 0.0, -1.0))
OBSTACLE = vg.Packing.of([SPHERE], BOX, position=[(2, 2, 2)], unit="mm")
MASK = np.zeros((6, 6, 6), dtype=bool)
MASK[1:4, 2:5, 2:4] = True
LABELS = MASK.astype(int)
SAMPLE = vg.make_shapes("convex_polyhedron", count=10)
LEARNED = vg.learn_shapes(SAMPLE)
BEADS = [vg.shapes.sphere(diameter=size) for size in np.linspace(1, 1.2, 10)]
TWIN = vg.twin(BEADS, solid_fraction=0.4, protocol="expand")
SEGMENTED = vg.segment(MASK * 100.0, threshold=50, min_size=1)
CLOUD = vg.Cloud.of(np.random.Generator(np.random.Philox(1)).random((60, 3)))
SCAN = vg.Cloud.of(vg.sample_surface(ROCK, spacing=0.1))
CLUMP = vg.fit_clump(ROCK, max_spheres=2)
SCENE = {
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 2},
}
TETRAHEDRON = ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
ROUGH = {"method": "spectral", "rms": 0.01, "correlation_length": 0.3, "shortest": 0.1, "hurst": 0.8, "seed": 0}

LONG = {"correlation_length": 2.0, "shortest": 1.0}


def periodic_filter(function, **more):
    return function, {"mask": MASK, "periodic": False, **more}


#: a good call of each function: the function and its arguments; texts that begin with @ are files that are there,
#: those that begin with > files that are not
GOOD = {
    "Box": (vg.Box, {"lengths": (4, 4, 4), "periodic": "x", "origin": (0, 0, 0)}),
    "Box.with_periodic": (BOX.with_periodic, {"periodic": "x"}),
    "Box.scaled": (BOX.scaled, {"factor": 2}),
    "Box.signed_distance": (BOX.signed_distance, {"points": [(1, 1, 1)]}),
    "ClosedMesh": (vg.ClosedMesh, {"shape": MESH}),
    "ClosedMesh.scaled": (vg.ClosedMesh(MESH).scaled, {"factor": 2}),
    "ClosedMesh.signed_distance": (vg.ClosedMesh(MESH).signed_distance, {"points": [(1, 1, 1)]}),
    "ClosedMesh.to_unit": (vg.ClosedMesh(MESH.to_unit("mm")).to_unit, {"unit": "m"}),
    "ClosedMesh.from_file": (vg.ClosedMesh.from_file, {"path": "@mesh.stl"}),
    "Cylinder": (vg.Cylinder, {"radius": 1, "height": 2, "origin": (0, 0, 0)}),
    "Cylinder.scaled": (vg.Cylinder(1, 2).scaled, {"factor": 2}),
    "Cylinder.signed_distance": (vg.Cylinder(1, 2).signed_distance, {"points": [(1, 1, 1)]}),
    "Disk": (vg.Disk, {"radius": 1, "origin": (0, 0)}),
    "Disk.scaled": (vg.Disk(1).scaled, {"factor": 2}),
    "Disk.signed_distance": (vg.Disk(1).signed_distance, {"points": [(1, 1, 0)]}),
    "Polygon": (vg.Polygon, {"corners": [(0, 0), (4, 0), (0, 4)], "holes": [[(0.5, 0.5), (1, 0.5), (0.5, 1)]]}),
    "Polygon.from_image": (vg.Polygon.from_image, {"source": MASK[2] * 1.0, "pixel_size": 1.0, "min_area": 1.0}),
    "Rectangle": (vg.Rectangle, {"lengths": (4, 4), "periodic": "x", "origin": (0, 0)}),
    "Rectangle.with_periodic": (vg.Rectangle((4, 4)).with_periodic, {"periodic": "x"}),
    "Sphere": (vg.Sphere, {"radius": 1, "origin": (0, 0, 0)}),
    "Sphere.scaled": (vg.Sphere(1).scaled, {"factor": 2}),
    "Sphere.signed_distance": (vg.Sphere(1).signed_distance, {"points": [(1, 1, 1)]}),
    "Hopper": (vg.Hopper, {"radius": 3, "outlet": 1, "angle": 60, "length": 2, "bin_height": 1, "origin": (0, 0, 0)}),
    "Funnel": (vg.Funnel, {"radius": 3, "outlet": 1, "height": 2, "origin": (0, 0, 0)}),
    "Drum": (vg.Drum, {"radius": 1, "length": 2, "axis": "x", "origin": (0, 0, 0)}),
    "Drum.scaled": (vg.Drum(1, 2).scaled, {"factor": 2}),
    "Drum.doubt": (vg.Drum(1, 2).doubt, {"diameter": 1}),
    "Planes": (vg.Planes, {"normals": [*np.eye(3), *-np.eye(3)], "points": [*np.eye(3), *-np.eye(3)]}),
    "Walls": (vg.Walls, {"wall": [{"kind": "sphere", "radius": 1, "point": (0, 0, 0)}]}),
    "Walls.scaled": (vg.Walls([{"kind": "sphere", "radius": 1}]).scaled, {"factor": 2}),
    "Vessel": (vg.Vessel, {"wall": TANK, "lid": 2.5, "floor": 0.5, "point": (0, 0, 1), "gravity": "-z", "unit": "mm"}),
    "make_container": (vg.make_container, {"mapping": {"kind": "sphere", "radius": 1}}),
    "rough_walls": (vg.rough_walls, {"container": vg.Box((4, 4, 4)), **ROUGH, **LONG}),
    "Cloud.of": (
        vg.Cloud.of,
        {"points": np.eye(3), "normals": np.eye(3), "grain": [0, 1, 1], "name": "c", "unit": "m"},
    ),
    "Cloud.chosen": (CLOUD.chosen, {"mask": np.arange(60) < 9}),
    "Cloud.clusters": (CLOUD.clusters, {"distance": 0.1, "min_points": 3}),
    "Cloud.cropped": (CLOUD.cropped, {"lower": (0, 0, 0), "upper": (1, 1, 1)}),
    "Cloud.thinned": (CLOUD.thinned, {"spacing": 0.1}),
    "Cloud.with_normals": (CLOUD.with_normals, {"neighbours": 9}),
    "Cloud.without_outliers": (CLOUD.without_outliers, {"deviations": 2.0, "neighbours": 9}),
    "Inlet": (vg.Inlet, {"radius": 1.0, "center": (2.0, 2.0, 0.0), "height": 1.0}),
    "Lid": (vg.Lid, {"weight": 1.0}),
    "Shaking": (vg.Shaking, {"acceleration": 1.0, "duration": 1.0}),
    "Material": (
        vg.Material,
        {
            "law": "linear",
            "density": 1.0,
            "stiffness": 1e5,
            "poisson_ratio": 0.2,
            "restitution": 0.3,
            "friction": 0.5,
            "rolling_friction": 0.0,
            "cohesion": 0.0,
            "bond_strength": 1.0,
        },
    ),
    "Materials": (
        vg.Materials,
        {
            "materials": {"sand": vg.Material(), "steel": {"friction": 0.3}},
            "pairs": {("sand", "steel"): {"friction": 0.2}},
            "shapes": ["sand"],
            "walls": {"others": "steel"},
        },
    ),
    "Packing.of": (
        vg.Packing.of,
        {
            "shapes": [SPHERE],
            "container": BOX,
            "position": [(1, 1, 1)],
            "scale": [1.0],
            "shape_id": [0],
            "orientation": [(1, 0, 0, 0)],
            "density": 1.0,
            "unit": "m",
            "gravity": (0.0, 0.0, -1.0),
            "contact_gap": 0.0,
            "fixed": [True],
        },
    ),
    "Packing.bonds": (BED.bonds, {"strength": 1.0, "shear_strength": 1.0, "tolerance": 1e-3, "least_area": 0.1}),
    "Packing.contacts": (BED.contacts, {"gap": 0.1}),
    "Packing.measure": (BED.measure, {"which": "density"}),
    "Packing.save": (BED.save, {"path": ">bed.vtp", "overwrite": False}),
    "Packing.tiled": (
        vg.Packing.of(SPHERE, vg.Box((2, 2, 2), periodic="xy"), position=[(1, 1, 1)]).tiled,
        {"repeats": (2, 1, 1)},
    ),
    "Packing.to_unit": (vg.Packing.of([SPHERE], BOX, position=[(1, 1, 1)], unit="mm").to_unit, {"unit": "m"}),
    "Packing.verify": (BED.verify, {"tolerance": 1e-9}),
    "Packing.with_clumps": (BED.with_clumps, {"clumps": CLUMP}),
    "Packing.world_vertices": (BED.world_vertices, {"grain": 0}),
    "Scene.from_mapping": (vg.Scene.from_mapping, {"mapping": SCENE}),
    "Scene.from_toml": (vg.Scene.from_toml, {"path": "@scene.toml"}),
    "Scene.run": (vg.Scene.from_mapping(SCENE).run, {"folder": ">out", "resume": False, "overwrite": False}),
    "Series": (vg.Series, {"path": ">run.pvd", "max_snapshots": 5, "every": 10, "resume": False, "overwrite": False}),
    "Series.record": (
        lambda packing, done: vg.Series("r.pvd", overwrite=True).record(packing, done),
        {"packing": BED, "done": 1},
    ),
    "Shape.contains": (ROCK.contains, {"points": [(0, 0, 0)]}),
    "Shape.from_mesh": (
        vg.Shape.from_mesh,
        {"vertices": TETRAHEDRON[0], "faces": TETRAHEDRON[1], "name": "t", "unit": "m"},
    ),
    "Shape.from_surface": (
        vg.Shape.from_surface,
        {"vertices": TETRAHEDRON[0], "faces": TETRAHEDRON[1][:2], "name": "t", "unit": "m"},
    ),
    "Shape.rotated": (ROCK.rotated, {"quaternion": (1, 0, 0, 0)}),
    "Shape.scaled": (ROCK.scaled, {"factor": 2}),
    "Shape.signed_distance": (ROCK.signed_distance, {"points": [(0, 0, 0)]}),
    "Shape.to_unit": (ROCK.to_unit, {"unit": "m"}),
    "Shape.voxelize": (ROCK.voxelize, {"voxel_size": 0.2}),
    "Study": (vg.Study, {"base": SCENE, "axes": {"packing.count": [1, 2]}, "seeds": 1}),
    "clumps.Optimal": (vg.clumps.Optimal, {"overlap": True, "uniform": False, "match_volume": True}),
    "Clump.bonds": (CLUMP.bonds, {"strength": 1.0, "shear_strength": 1.0, "tolerance": 1e-3, "least_area": 0.1}),
    "Clump.mass_properties": (CLUMP.mass_properties, {"of": "true"}),
    "Clump.save": (CLUMP.save, {"path": ">clump.csv", "overwrite": False, "mass_properties": "true", "density": 1.0}),
    "Clump.to_shape": (CLUMP.to_shape, {"mass_properties": "true"}),
    "fit_clump": (
        vg.fit_clump,
        {"shape_or_voxels": ROCK, "method": "optimal", "max_spheres": 2, "target": "iou", "value": 0.3, "seed": 0},
    ),
    "closing": periodic_filter(vg.closing, radius=1, voxel_size=0.5, threads=1),
    "dilation": periodic_filter(vg.dilation, radius=1, voxel_size=0.5, threads=1),
    "erosion": periodic_filter(vg.erosion, radius=1, voxel_size=0.5, threads=1),
    "filter_image": (vg.filter_image, {"image": np.ones((4, 4, 4)), "function": np.sqrt, "depth": 1}),
    "opening": periodic_filter(vg.opening, radius=1, voxel_size=0.5, threads=1),
    "local_thickness": periodic_filter(vg.local_thickness, voxel_size=(1.0, 1.0, 2.0), threads=1),
    "connected_components": periodic_filter(vg.connected_components, connectivity=6),
    "distance_transform": periodic_filter(vg.distance_transform, voxel_size=0.5, squared=False, threads=1, out=None),
    "two_point_correlation": periodic_filter(vg.two_point_correlation, voxel_size=(1.0, 1.0, 2.0)),
    "chord_lengths": periodic_filter(vg.chord_lengths, voxel_size=(1.0, 1.0, 2.0)),
    "effective_diffusivity": (
        vg.effective_diffusivity,
        {"pores": ~MASK, "region": None, "voxel_size": (1.0, 1.0, 2.0), "periodic": "x", "block": 2},
    ),
    "crop": (vg.crop, {"image": MASK, "margin": 1}),
    "iso_surface": (vg.iso_surface, {"field": MASK * 1.0, "level": 0.5}),
    "iso_surface volume": (vg.iso_surface, {"field": MASK * 1.0, "volume": 8.0}),
    "resample factor": (vg.resample, {"image": MASK, "factor": 0.5, "method": "mean"}),
    "resample to": (vg.resample, {"image": MASK, "to": "cubic", "voxel_size": (1, 1, 2), "method": "nearest"}),
    "resample": (vg.resample, {"image": MASK, "shape": (3, 3, 3), "method": "mean"}),
    "segment": (
        vg.segment,
        {
            "image": MASK * 100.0,
            "threshold": 50,
            "dark_grains": False,
            "min_size": 1,
            "separation": 2.0,
            "voxel_size": (1.0, 1.0, 2.0),
        },
    ),
    "view": (vg.view, {"packing": BED, "color_by": "height", "most": 5.0, "widget": False}),
    "learn_shapes": (
        vg.learn_shapes,
        {"shapes": SAMPLE, "sizes": np.ones(10), "method": "warp", "strength": 0.05, "weights": np.ones(10), "seed": 0},
    ),
    "twin": (
        vg.twin,
        {
            "sample": BEADS,
            "container": vg.Box((3, 3, 3), periodic="xyz"),
            "count": 10,
            "solid_fraction": 0.4,
            "protocol": "expand",
            "model": None,
            "faces": 40,
            "forms": 2,
            "voxel_size": 0.2,
            "seed": 0,
            "seeds": 1,
        },
    ),
    "Twin.compared_with": (TWIN.compared_with, {"packing": TWIN.packing}),
    "Twin.report": (TWIN.report, {"path": ">twin.html", "overwrite": False}),
    "ShapeModel.sample": (LEARNED.sample, {"count": 2, "seed": 0}),
    "ShapeModel.report": (LEARNED.report, {"test": SAMPLE, "count": 10, "descriptors": False, "seed": 0}),
    "ShapeModel.save": (LEARNED.save, {"path": ">shapes.nc", "overwrite": False}),
    "save_slices": (
        vg.save_slices,
        {"segmentation": SEGMENTED, "path": ">slices.png", "image": None, "overwrite": False},
    ),
    "compress": (
        vg.compress,
        {
            "packing": BED,
            "stress": 1.0,
            "axes": "z",
            "friction": 0.5,
            "rate": 3e-3,
            "rest": 0.9,
            "checkpoint": ">compress.voxgran",
            "resume": False,
            "threads": 1,
            "on_step": None,
        },
    ),
    "data_file": (vg.data_file, {"name": "eros.obj"}),
    "deform": (vg.deform, {"packing": BED, "stiffness": 1.0, "spacing": 0.3, "reach": 1.0}),
    "describe": (vg.describe, {"what": ROCK, "which": "sphericity"}),
    "diagnose": (vg.diagnose, {"vertices": TETRAHEDRON[0], "faces": TETRAHEDRON[1]}),
    "diagnose shape": (vg.diagnose, {"vertices": MESH}),
    "equilibrium": (vg.equilibrium, {"packing": BED, "friction": 0.5, "gap": 1e-3, "tolerance": 0.01, "threads": 1}),
    "equilibrium stress": (vg.equilibrium, {"packing": BED, "stress": (None, None, 1.0), "tolerance": 0.01}),
    "expected_solid_fraction": (vg.expected_solid_fraction, {"sizes": vg.sizes.fixed(), "dimension": 3}),
    "grow": (vg.grow, {"packing": BED, "max_factor": 2.0}),
    "inscribe": (vg.inscribe, {"packing": BED, "shapes": ROCK, "weights": [1], "shape_id": None, "seed": 0}),
    "label_table": (vg.label_table, {"source": LABELS, "voxel_size": 1.0}),
    "load": (vg.load, {"path": "@bed.vtp"}),
    "load spheres": (vg.load, {"path": "@spheres.csv", "container": BOX, "unit": "mm", "periodic": "x", "frame": -1}),
    "load_cloud": (vg.load_cloud, {"path": "@cloud.ply", "unit": "mm"}),
    "load_image": (vg.load_image, {"path": "@labels.npz", "key": "labels"}),
    "open_image": (
        vg.open_image,
        {"source": "@labels.npz", "key": "labels", "voxel_size": 1.0, "unit": "mm", "block": 2},
    ),
    "load_labels": (
        vg.load_labels,
        {
            "source": LABELS,
            "voxel_size": 1.0,
            "border": "keep",
            "surface": "smooth",
            "smoothing": 1.0,
            "periodic": False,
            "unit": "mm",
        },
    ),
    "packing_of_labels": (
        vg.packing_of_labels,
        {
            "source": LABELS,
            "voxel_size": 1.0,
            "border": "keep",
            "surface": "smooth",
            "smoothing": 1.0,
            "periodic": False,
            "gravity": "-z",
            "unit": "mm",
        },
    ),
    "load_outlines": (
        vg.load_outlines,
        {"source": LABELS[2], "level": 0.5, "pixel_size": 1.0, "min_area": 1.0, "border": "keep"},
    ),
    "load_shape": (vg.load_shape, {"path": "@mesh.stl", "unit": "mm", "repair": False, "surface": False}),
    "load_statistics": (vg.load_statistics, {"path": "@statistics.nc"}),
    "make_shape": (vg.make_shape, {"family": "solid_union", "seed": 0, "solids": 2}),
    "make_shapes": (vg.make_shapes, {"family": "sphere", "count": 2, "seed": 0, "diameter": 1.0}),
    "seeds_of_shapes": (vg.seeds_of_shapes, {"seed": 0, "count": 2}),
    "measure": (vg.measure, {"packing": BED, "which": "density", "threads": 1}),
    "pack_layers": (
        vg.pack_layers,
        {"layers": [{"shapes": SPHERE, "count": 2}], "container": BOX, "method": "gravity", "seed": 0, "friction": 0.5},
    ),
    "pour": (
        vg.pour,
        {
            "shapes": SPHERE,
            "container": BOX,
            "count": 2,
            "inlet": vg.Inlet(radius=1.0),
            "batch": 1,
            "method": "gravity",
            "seed": 0,
            "start": None,
            "weights": [1],
        },
    ),
    "pack": (
        vg.pack,
        {
            "shapes": SPHERE,
            "container": BOX,
            "method": "rsa",
            "count": 2,
            "solid_fraction": 0.05,
            "sizes": vg.sizes.fixed(1.0),
            "weights": [1],
            "weights_by": "number",
            "seed": 0,
            "start": None,
            "obstacles": OBSTACLE,
            "unit": "mm",
            "density": 1.0,
            "checkpoint": ">pack.voxgran",
            "resume": False,
            "on_step": None,
            "settle": False,
            "tries": 50,
        },
    ),
    "register_clouds": (vg.register_clouds, {"cloud": CLOUD, "target": CLOUD, "distance": 0.1, "seed": 0}),
    "remove_grains": (vg.remove_grains, {"packing": BED, "solid_fraction": 0.01, "seed": 0}),
    "repair": (
        vg.repair,
        {
            "vertices": TETRAHEDRON[0],
            "faces": TETRAHEDRON[1],
            "max_hole": 0.25,
            "bodies": "refuse",
            "name": "t",
            "unit": "mm",
        },
    ),
    "roughen": (vg.roughen, {"shape": MESH, **ROUGH}),
    "sample_surface": (vg.sample_surface, {"shape": ROCK, "spacing": 0.3, "seed": 0, "method": "poisson"}),
    "save": (vg.save, {"packing": BED, "path": ">bed.vtp", "overwrite": False}),
    "save_cloud": (vg.save_cloud, {"cloud": CLOUD, "path": ">cloud.xyz", "overwrite": False}),
    "save_cloud packing": (vg.save_cloud, {"cloud": BED, "path": ">cloud.xyz", "spacing": 0.3}),
    "save_image": (
        vg.save_image,
        {"image": LABELS, "path": ">image.vti", "voxel_size": 1.0, "origin": (0, 0, 0), "overwrite": False},
    ),
    "save_image edges": (
        vg.save_image,
        {"image": LABELS, "path": ">image.tif", "voxel_size": (1.0, 1.0, 2.0), "unit": "mm"},
    ),
    "save_scene": (vg.save_scene, {"packing": BED, "path": ">scene.vtm", "gap": 0.0, "overwrite": False}),
    "save_shape": (vg.save_shape, {"shape": ROCK, "path": ">rock.stl", "overwrite": False}),
    "save_statistics": (vg.save_statistics, {"tree": BED.measure("coordination"), "path": ">s.nc", "overwrite": False}),
    "settle": (
        vg.settle,
        {
            "packing": BED,
            "friction": 0.5,
            "restitution": 0.0,
            "shaking": None,
            "lid": None,
            "container": BOX,
            "gravity": "-z",
            "seed": 0,
            "rest": 0.95,
            "parts": "exact",
            "checkpoint": ">settle.voxgran",
            "resume": False,
            "on_step": None,
        },
    ),
    "shape_of_cloud": (
        vg.shape_of_cloud,
        {"cloud": SCAN, "method": "alpha", "alpha": 0.3, "max_gap": 50.0, "name": "c"},
    ),
    "signed_distance": (
        vg.signed_distance,
        {"shape": MESH, "voxel_size": 0.3, "band": 3.0, "source": "mesh", "out": None},
    ),
    "simplify": (vg.simplify, {"shape": MESH, "faces": 12}),
    "sizes.discrete": (vg.sizes.discrete, {"diameters": [1, 2], "weights": [1, 1], "basis": "number"}),
    "sizes.fixed": (vg.sizes.fixed, {"diameter": 1.0}),
    "sizes.fuller": (vg.sizes.fuller, {"low": 1.0, "high": 2.0, "exponent": 0.5, "basis": "volume"}),
    "sizes.mixture": (vg.sizes.mixture, {"parts": [vg.sizes.fuller(1.0, 2.0)], "shares": [1.0], "basis": "volume"}),
    "sizes.openings": (vg.sizes.openings, {"series": "ASTM E11", "numbers": [4, 10]}),
    "sizes.rosin_rammler": (vg.sizes.rosin_rammler, {"size": 2.0, "spread": 1.5, "low": 0.5, "basis": "volume"}),
    "plan_sizes": (vg.plan_sizes, {"sizes": vg.sizes.fuller(1.0, 2.0), "count": 10, "dimension": 3, "seed": 0}),
    "sizes.lognormal": (vg.sizes.lognormal, {"median": 1.0, "sigma": 0.2, "basis": "number", "low": 0.5, "high": 2.0}),
    "sizes.make_sizes": (vg.sizes.make_sizes, {"mapping": {"kind": "fixed", "diameter": 1.0}}),
    "sizes.sieve": (vg.sizes.sieve, {"openings": [1, 2], "passing": [0, 1], "as_diameter": False, "basis": "volume"}),
    "sizes.uniform": (vg.sizes.uniform, {"low": 1.0, "high": 2.0, "basis": "number"}),
    "spherize": (
        vg.spherize,
        {"shape": MESH, "radius": 1.0, "center": (0, 0, 0), "amount": 0.5, "axis": (0, 0, 1), "half_angle": 180.0},
    ),
    "surface_statistics": (vg.surface_statistics, {"surface": np.eye(9), "spacing": 1.0, "shortest": 2.0}),
    "to_image": (vg.to_image, {"packing": BED, "voxel_size": 0.5, "labels": True}),
    "to_image blocks": (vg.to_image, {"packing": BED, "voxel_size": 0.5, "block": (2, 3, 4)}),
    "to_image edges": (vg.to_image, {"packing": BED, "voxel_size": (0.5, 0.5, 1.0), "labels": [3, 7]}),
    "verify": (vg.verify, {"packing": BED, "tolerance": 1e-9, "threads": 1, "on_step": None}),
    "voxelize": (
        vg.voxelize,
        {
            "shape": ROCK,
            "voxel_size": 0.2,
            "grid": None,
            "backend": None,
            "cover": "center",
            "fraction": False,
            "out": None,
            "overwrite": False,
            "threads": 1,
        },
    ),
    "voxelize_mesh": (vg.voxelize_mesh, {"vertices": MESH.vertices, "faces": MESH.faces, "voxel_size": 0.2}),
    "window_solid_fraction": (vg.window_solid_fraction, {"packing": BED, "lower": (1, 1, 1), "upper": (2, 2, 2)}),
    "write_deck": (
        vg.write_deck,
        {
            "packing": BED,
            "folder": ">deck",
            "engine": "lammps",
            "material": {"density": 1000.0},
            "clump": None,
            "grains": None,
            "acceleration": 9.81,
            "time_step": None,
            "overwrite": False,
        },
    ),
}


def outcome(function, arguments):
    """Call a function; return what it refused to do, and an empty text where it did not."""
    with warnings.catch_warnings(action="error"):
        # what voxgran and the libraries say of results
        warnings.simplefilter("ignore", UserWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            function(**arguments)
        except VoxgranError as error:
            return str(error)
    return ""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Return a folder with the files that calls read, which is the present one; memory is limited."""
    monkeypatch.chdir(tmp_path)
    vg.save_shape(ROCK, "mesh.stl")
    vg.save(BED, "bed.vtp")
    vg.save_cloud(CLOUD, "cloud.ply")
    vg.save_statistics(BED.measure("coordination"), "statistics.nc")
    np.savez("labels.npz", labels=LABELS)
    Path("spheres.csv").write_text("x,y,z,r\n1,1,1,0.5\n3,3,3,0.5\n")
    Path("scene.toml").write_text(
        '[[shape]]\nfamily = "sphere"\n[container]\nkind = "box"\nlengths = [4, 4, 4]\n'
        '[packing]\nmethod = "rsa"\ncount = 2\n'
    )
    return tmp_path


def given(arguments, folder, number):
    """Return arguments with the names of files made paths: those to be written are new ones for each number."""
    marks = {"@": lambda name: str(folder / name), ">": lambda name: str(folder / f"{number}_{name}")}
    return {
        key: marks[value[0]](value[1:]) if isinstance(value, str) and value[:1] in marks else value
        for key, value in arguments.items()
    }


def public_functions():
    """Return the names of the public functions and classes that take arguments, and of what makes sizes."""
    found = {name for name in vg.__all__ if inspect.isfunction(getattr(vg, name)) or inspect.isclass(getattr(vg, name))}
    sizes = {f"sizes.{name}" for name in vg.sizes.__all__ if name.islower()}
    plain = {"PackingWarning", "VoxgranError"}
    return {name for name in (found | sizes) - plain if inspect.signature(attrgetter(name)(vg)).parameters}


#: pictures and pages, of which each takes seconds, an engine that is not installed everywhere, and classes whose
#: objects are made by functions
ELSEWHERE = {
    *("plot", "save_clump_picture", "save_comparison", "save_gallery", "save_picture", "save_report"),
    *("save_turntable", "save_deformed", "relax", "Cloud", "Packing", "Scene", "Shape", "ShapeModel", "Twin"),
}


def test_all_public_functions_are_tried():
    tried = {name.partition(" ")[0] for name in GOOD}
    assert public_functions() - tried == ELSEWHERE


@pytest.mark.slow
@pytest.mark.parametrize("name", GOOD)
def test_bad_calls(name, place):
    function, arguments = GOOD[name]
    assert outcome(function, given(arguments, place, 0)) == ""
    number = 0
    for argument in arguments:
        for value in VALUES:
            # what is called raises what it raises
            if argument in ("on_step", "function") and value in ("function", "class"):
                continue
            number += 1
            try:
                said = outcome(function, given(arguments, place, number) | {argument: VALUES[value]})
            except Exception as error:
                raise AssertionError(f"{argument} = {value}") from error
            assert "\n" not in said, (argument, value)
            assert len(said) < 1000, (argument, value)
