"""voxgran: packed assemblies of grains of true shape, checked, measured and ready for a simulation.

The public names are imported on first use (PEP 562), so that ``import voxgran`` loads no other library.
"""

import importlib
from typing import Any

__version__ = "0.1.0"

__all__ = [
    "Box",
    "ClosedMesh",
    "Cloud",
    "Cylinder",
    "Packing",
    "Rectangle",
    "Scene",
    "Series",
    "Shape",
    "Sphere",
    "VoxgranError",
    "__version__",
    "closing",
    "clump_methods",
    "connected_components",
    "crop",
    "diagnose",
    "dilation",
    "distance_transform",
    "erosion",
    "fit_clump",
    "iso_surface",
    "label_table",
    "load",
    "load_cloud",
    "load_labels",
    "load_outlines",
    "load_shape",
    "load_statistics",
    "local_thickness",
    "make_container",
    "make_shape",
    "measure",
    "opening",
    "pack",
    "packing_methods",
    "packing_of_labels",
    "read_image",
    "register_clouds",
    "repair",
    "resample",
    "sample_surface",
    "save",
    "save_cloud",
    "save_image",
    "save_scene",
    "save_shape",
    "save_statistics",
    "save_turntable",
    "segment",
    "shape_families",
    "shape_of_cloud",
    "signed_distance",
    "sizes",
    "to_image",
    "verify",
    "voxelize",
    "voxelize_mesh",
    "window_solid_fraction",
    "write_comparison",
    "write_report",
]

_PLACES = {
    "closing": "voxgran.lattice.morphology",
    "connected_components": "voxgran.lattice.label",
    "crop": "voxgran.lattice.resample",
    "dilation": "voxgran.lattice.morphology",
    "distance_transform": "voxgran.lattice.distance",
    "erosion": "voxgran.lattice.morphology",
    "iso_surface": "voxgran.lattice.surface",
    "local_thickness": "voxgran.lattice.thickness",
    "opening": "voxgran.lattice.morphology",
    "resample": "voxgran.lattice.resample",
    "signed_distance": "voxgran.voxels.signed_distance",
    "Box": "voxgran.containers.box",
    "ClosedMesh": "voxgran.containers.closed_mesh",
    "Cylinder": "voxgran.containers.cylinder",
    "Packing": "voxgran.packing.model",
    "Rectangle": "voxgran.containers.rectangle",
    "Sphere": "voxgran.containers.sphere",
    "Scene": "voxgran.scene.model",
    "Shape": "voxgran.shapes.model",
    "VoxgranError": "voxgran._base.errors",
    "clump_methods": "voxgran.clumps.fit",
    "diagnose": "voxgran.shapes.diagnose",
    "fit_clump": "voxgran.clumps.fit",
    "load": "voxgran.io.files",
    "load_shape": "voxgran.shapes.files",
    "load_statistics": "voxgran.io.netcdf",
    "label_table": "voxgran.shapes.labels",
    "load_labels": "voxgran.shapes.labels",
    "load_outlines": "voxgran.shapes.outline_images",
    "packing_of_labels": "voxgran.packing.from_labels",
    "read_image": "voxgran.shapes.image_files",
    "save_turntable": "voxgran.report.turntable",
    "segment": "voxgran.lattice.segment",
    "Series": "voxgran.io.series",
    "make_container": "voxgran.containers.make",
    "make_shape": "voxgran.shapes.family",
    "measure": "voxgran.measure.model",
    "pack": "voxgran.packing.pack",
    "packing_methods": "voxgran.packing.method",
    "repair": "voxgran.shapes.repair",
    "sample_surface": "voxgran.points.sample",
    "Cloud": "voxgran.points.cloud",
    "load_cloud": "voxgran.io.cloud_files",
    "save_cloud": "voxgran.io.cloud_files",
    "shape_of_cloud": "voxgran.points.cloud_surface",
    "register_clouds": "voxgran.points.register",
    "save": "voxgran.io.files",
    "save_image": "voxgran.io.image",
    "save_scene": "voxgran.io.vtk_files",
    "save_shape": "voxgran.shapes.files",
    "save_statistics": "voxgran.io.netcdf",
    "shape_families": "voxgran.shapes.family",
    "to_image": "voxgran.io.image",
    "verify": "voxgran.packing.verify",
    "voxelize": "voxgran.voxels.occupy",
    "voxelize_mesh": "voxgran.voxels.open_mesh",
    "window_solid_fraction": "voxgran.measure.density",
    "write_comparison": "voxgran.report.compare",
    "write_report": "voxgran.report.page",
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name == "sizes":
        return importlib.import_module("voxgran.shapes.sizes")
    if name not in _PLACES:
        raise AttributeError(f"module 'voxgran' has no attribute {name!r}")
    return getattr(importlib.import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
