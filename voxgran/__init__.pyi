"""Public names: the table that `voxgran._base.lazy_names` reads, and the types that users get."""

from voxgran import clumps as clumps
from voxgran import containers as containers
from voxgran import shapes as shapes
from voxgran._base.errors import VoxgranError as VoxgranError
from voxgran.clumps.fit import clump_methods as clump_methods
from voxgran.contacts.verify import verify as verify
from voxgran.containers.box import Box as Box
from voxgran.containers.closed_mesh import ClosedMesh as ClosedMesh
from voxgran.containers.cylinder import Cylinder as Cylinder
from voxgran.containers.disk import Disk as Disk
from voxgran.containers.make import make_container as make_container
from voxgran.containers.polygon import Polygon as Polygon
from voxgran.containers.rectangle import Rectangle as Rectangle
from voxgran.containers.rough_walls import rough_walls as rough_walls
from voxgran.containers.sphere import Sphere as Sphere
from voxgran.decks.engine import engines as engines
from voxgran.decks.material import Material as Material
from voxgran.decks.relax import relax as relax
from voxgran.decks.write import write_deck as write_deck
from voxgran.deformation.deform import deform as deform
from voxgran.io.cloud_files import load_cloud as load_cloud
from voxgran.io.cloud_files import save_cloud as save_cloud
from voxgran.io.data_files import data_file as data_file
from voxgran.io.deformed_files import save_deformed as save_deformed
from voxgran.io.files import load as load
from voxgran.io.files import save as save
from voxgran.io.image import save_image as save_image
from voxgran.io.image import to_image as to_image
from voxgran.io.netcdf import load_statistics as load_statistics
from voxgran.io.netcdf import save_statistics as save_statistics
from voxgran.io.series import Series as Series
from voxgran.io.vtk_files import save_scene as save_scene
from voxgran.lattice.distance import distance_transform as distance_transform
from voxgran.lattice.label import connected_components as connected_components
from voxgran.lattice.morphology import closing as closing
from voxgran.lattice.morphology import dilation as dilation
from voxgran.lattice.morphology import erosion as erosion
from voxgran.lattice.morphology import opening as opening
from voxgran.lattice.resample import crop as crop
from voxgran.lattice.resample import resample as resample
from voxgran.lattice.segment import segment as segment
from voxgran.lattice.surface import iso_surface as iso_surface
from voxgran.lattice.thickness import local_thickness as local_thickness
from voxgran.measures.describe import describe as describe
from voxgran.measures.model import measure as measure
from voxgran.measures.registered.density import window_solid_fraction as window_solid_fraction
from voxgran.packing import methods as methods
from voxgran.packing.jamming.expected import expected_solid_fraction as expected_solid_fraction
from voxgran.packing.method import packing_methods as packing_methods
from voxgran.packing.model import Packing as Packing
from voxgran.packing.settle import settle as settle
from voxgran.packing.transform.from_labels import packing_of_labels as packing_of_labels
from voxgran.packing.transform.grow import grow as grow
from voxgran.packing.transform.inscribe import inscribe as inscribe
from voxgran.packing.transform.remove import remove_grains as remove_grains
from voxgran.points.cloud import Cloud as Cloud
from voxgran.points.cloud_surface import shape_of_cloud as shape_of_cloud
from voxgran.points.register import register_clouds as register_clouds
from voxgran.points.sample import sample_surface as sample_surface
from voxgran.report.clumps import save_clump_picture as save_clump_picture
from voxgran.report.compare import save_comparison as save_comparison
from voxgran.report.gallery import save_gallery as save_gallery
from voxgran.report.page import save_report as save_report
from voxgran.report.plot import plot as plot
from voxgran.report.turntable import save_turntable as save_turntable
from voxgran.scene.scene import Scene as Scene
from voxgran.settling.equilibrium import equilibrium as equilibrium
from voxgran.settling.parameters import Lid as Lid
from voxgran.settling.parameters import Shaking as Shaking
from voxgran.shapes import families as families
from voxgran.shapes import sizes as sizes
from voxgran.shapes.family import seeds_of_shapes as seeds_of_shapes
from voxgran.shapes.family import shape_families as shape_families
from voxgran.shapes.files import load_shape as load_shape
from voxgran.shapes.files import save_shape as save_shape
from voxgran.shapes.generating.inflation import spherize as spherize
from voxgran.shapes.images.image_files import load_image as load_image
from voxgran.shapes.images.labels import label_table as label_table
from voxgran.shapes.images.labels import load_labels as load_labels
from voxgran.shapes.images.outline_images import load_outlines as load_outlines
from voxgran.shapes.model import Shape as Shape
from voxgran.shapes.repairing.diagnose import diagnose as diagnose
from voxgran.shapes.repairing.repair import repair as repair
from voxgran.shapes.roughness.measuring import surface_statistics as surface_statistics
from voxgran.shapes.roughness.roughen import roughen as roughen
from voxgran.study.study import Study as Study
from voxgran.typed_calls import fit_clump as fit_clump  # voxgran.clumps.fit
from voxgran.typed_calls import make_shape as make_shape  # voxgran.shapes.family
from voxgran.typed_calls import make_shapes as make_shapes  # voxgran.shapes.family
from voxgran.typed_calls import pack as pack  # voxgran.packing.pack
from voxgran.voxels.occupy import voxelize as voxelize
from voxgran.voxels.open_mesh import voxelize_mesh as voxelize_mesh
from voxgran.voxels.signed_distance import signed_distance as signed_distance

__version__: str
__all__: list[str]
