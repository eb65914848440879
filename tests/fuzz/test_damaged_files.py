"""Damaged files of every format that voxgran reads: an error of voxgran or a good result, soon, and nothing printed.

Each format has one small well-formed file. Mutations are drawn from a generator that is keyed by format, seed and
number, so that a failure names the mutation that caused it.
"""

import gzip
import json
import random
import re
import resource
import struct
import time
import warnings
import zlib

import numpy as np
import pytest
from kit import dicom_slice, slow

import voxgran as vg
from voxgran._base.checkpoint import load_checkpoint, save_checkpoint
from voxgran._base.errors import DirtyMeshWarning, PackingWarning, VoxgranError
from voxgran._base.lazy import load
from voxgran.io.series import listed_times
from voxgran.packing.tessellation.method import read_cells
from voxgran.shapes.tessellate import unit_box

#: CPU seconds within which a file of a few kilobytes must be read or refused
SOON = 5.0
#: most bytes of a damaged file
LARGEST = 300_000

VERTICES, FACES, _ = unit_box()
QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
SPHERES = np.array([[1.0, 1.0, 1.0, 0.5], [2.5, 1.0, 1.0, 0.25], [1.0, 2.5, 1.125, 0.5], [3.0, 3.0, 1.0, 0.75]])
LABELS = np.zeros((7, 7, 7), dtype=np.uint16)
LABELS[1:4, 1:4, 1:4], LABELS[4:6, 4:6, 2:6] = 1, 2
ROWS = "\n".join(" ".join(map(repr, row)) for row in SPHERES.tolist()) + "\n"
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in VERTICES.tolist())
OBJ += "".join("f " + " ".join(f"{k + 1}//{k + 1}" for k in face) + "\n" for face in QUADS.tolist())
OFF = "OFF\n8 6 0\n" + "".join(f"{x} {y} {z}\n" for x, y, z in VERTICES.tolist())
OFF += "".join("4 " + " ".join(map(str, face)) + "\n" for face in QUADS.tolist())
TEXT_STL = "solid cube\n" + "".join(
    "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners) + "endloop\nendfacet\n"
    for corners in VERTICES[FACES].tolist()
)
TEXT_STL += "endsolid cube\n"
PLY_HEAD = (
    "ply\nformat {} 1.0\nelement vertex 8\nproperty float x\nproperty double y\nproperty float z\n"
    "element face 6\nproperty list uchar int vertex_indices\nproperty uchar red\nend_header\n"
)
POINT_PLY = (
    "ply\nformat binary_little_endian 1.0\nelement vertex 8\n"
    "property double x\nproperty double y\nproperty double z\nproperty int grain\nend_header\n"
)
PCD = (
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z normal_x normal_y normal_z\nSIZE 8 8 8 8 8 8\nTYPE F F F F F F\n"
    "COUNT 1 1 1 1 1 1\nWIDTH 8\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 8\nDATA {}\n"
)
NORMALS = np.tile([0.0, 0.0, 1.0], (8, 1))
MSH_2 = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n"
MSH_2 += "".join(f"{k + 1} {x} {y} {z}\n" for k, (x, y, z) in enumerate(VERTICES.tolist()))
MSH_2 += "$EndNodes\n$Elements\n12\n"
MSH_2 += "".join(f"{k + 1} 2 2 0 1 {a + 1} {b + 1} {c + 1}\n" for k, (a, b, c) in enumerate(FACES.tolist()))
MSH_2 += "$EndElements\n"
LAMMPS_DATA = (
    "LAMMPS data file\n\n4 atoms\n1 atom types\n\n0 4 xlo xhi\n0 4 ylo yhi\n0 4 zlo zhi\n\nAtoms # sphere\n\n"
    + "".join(f"{k + 1} 1 {2 * r} 2500 {x} {y} {z} 0 0 0\n" for k, (x, y, z, r) in enumerate(SPHERES.tolist()))
    + "\nVelocities\n\n1 0 0 0 0 0 0\n"
)
CLUMP = "x,y,z,r\n" + ROWS.replace(" ", ",") + "# unit = mm\n# volume = 2.5\n# centroid = 1.5, 1.5, 1\n"
CLUMP += "# inertia = 1.0, 1.5, 2.0, 0.0, 0.125, 0.0\n"
MOLECULE = "# clump\n\n4 atoms\n5.0 mass\n1.5 1.5 1 com\n2 3 4 0 0.25 0 inertia\n\nCoords\n\n"
MOLECULE += "".join(f"{k + 1} {x} {y} {z}\n" for k, (x, y, z, _) in enumerate(SPHERES.tolist()))
MOLECULE += "\nTypes\n\n1 1\n2 1\n3 1\n4 1\n\nDiameters\n\n"
MOLECULE += "".join(f"{k + 1} {2 * r}\n" for k, (_, _, _, r) in enumerate(SPHERES.tolist()))
LAMMPS_DUMP = "".join(
    f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n4\nITEM: BOX BOUNDS pp pp ff\n0 4\n0 4\n0 4\n"
    "ITEM: ATOMS id type x y z radius\n"
    + "".join(f"{k + 1} 1 {x} {y} {z} {r}\n" for k, (x, y, z, r) in enumerate(SPHERES.tolist()))
    for step in (0, 100)
)
PVD = (
    '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
    + "".join(f'    <DataSet timestep="{t}" group="" part="0" file="s/{t}.vtp" />\n' for t in (0, 1000, 2000))
    + "  </Collection>\n</VTKFile>\n"
)
SCENE = """[scene]
seed = 1
unit = "mm"
[[shape]]
family = "solid_union"
share = 0.6
solids = [3, 6]
kinds = ["sphere", "ellipsoid"]
[[shape]]
family = "box"
share = 0.4
[sizes]
kind = "lognormal"
median = 1.0
sigma = 0.2
basis = "number"
[container]
kind = "box"
lengths = [8, 8, 14]
periodic = ["x", "y"]
[packing]
method = "digital"
count = 400
voxel_size = 0.03
gravity = "-z"
[measure]
which = ["density", "coordination"]
[output]
vtk = true
report = false
"""


MERCURY = "4 0 0 0 0 4 4 4\n" + "".join(f"{x} {y} {z} 0 0 0 {r} 0 0 0 0 0 0 0\n" for x, y, z, r in SPHERES.tolist())
EXTENDED = '4\nLattice="4 0 0 0 4 0 0 0 4" Properties=species:S:1:pos:R:3:radius:R:1 pbc="T T F"\n'
EXTENDED += "".join(f"C {x} {y} {z} {r}\n" for x, y, z, r in SPHERES.tolist())
STUDY = """seeds = 2
combine = "cross"
[axes]
"packing.count" = [3, 5]
shape = [{ family = "sphere", label = "a" }, { family = "box", label = "b" }]
[experiments]
a = { low = 0.1, high = 0.2, source = "none" }
[base.scene]
unit = "mm"
[base.container]
kind = "box"
lengths = [8, 8, 8]
[base.packing]
method = "rsa"
"""
LEGACY = "# vtk DataFile Version 2.0\nmade by a test\nASCII\nDATASET POLYDATA\nPOINTS 4 double\n"
LEGACY += "".join(f"{x} {y} {z}\n" for x, y, z, _ in SPHERES.tolist())
LEGACY += (
    "VERTICES 4 8\n1 0\n1 1\n1 2\n1 3\nPOINT_DATA 4\nSCALARS radius double 1\nLOOKUP_TABLE default\n.5\n.25\n.5\n.75\n"
)
UNITS = "x [um],y [um],z [mm],radius [mm]\n1000,2000,3,1\n5000,2000,3,1\n"


def binary_stl():
    records = np.zeros(len(FACES), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("", "<u2")])
    records["corners"] = VERTICES[FACES]
    return bytes(80) + struct.pack("<I", len(FACES)) + records.tobytes()


def ply(order, mark):
    if not mark:
        rows = [*VERTICES.tolist(), *([4, *face, 255] for face in QUADS.tolist())]
        return PLY_HEAD.format(order).encode() + "\n".join(" ".join(map(str, row)) for row in rows).encode()
    body = b"".join(struct.pack(f"{mark}fdf", *row) for row in VERTICES.tolist())
    body += b"".join(struct.pack(f"{mark}B4iB", 4, *face, 255) for face in QUADS.tolist())
    return PLY_HEAD.format(order).encode() + body


def sphere_packing(container=None):
    shape = vg.make_shape("sphere")
    box = container or vg.Box((4, 4, 4), periodic="xy")
    return vg.Packing.of((shape,), box, position=SPHERES[:, :3], scale=2 * SPHERES[:, 3])


def saved(save, path):
    """Return the bytes that a writer writes."""
    path.unlink(missing_ok=True)
    save(path)
    return path.read_bytes()


def own_packing(path):
    return saved(lambda p: vg.save(sphere_packing(), p), path)


def rewritten_packing(path):
    """Return what ParaView makes of a packing: the same arrays, as text, without the seal."""
    own_packing(path)
    xml = load("vtkmodules.vtkIOXML")
    reader, writer = xml.vtkXMLPolyDataReader(), xml.vtkXMLPolyDataWriter()
    reader.SetFileName(str(path))
    writer.SetInputConnection(reader.GetOutputPort())
    writer.SetFileName(str(path))
    writer.SetDataModeToAscii()
    reader.Update()
    writer.Write()
    return path.read_bytes()


def vtk_points(kind, mode):
    def write(path):
        pyvista, xml = load("pyvista"), load("vtkmodules.vtkIOXML")
        data = pyvista.PolyData(SPHERES[:, :3])
        data.point_data["radius"] = SPHERES[:, 3]
        if kind == "UnstructuredGrid":
            data = data.cast_to_unstructured_grid()
        return vtk_written(getattr(xml, f"vtkXML{kind}Writer")(), data, mode, path)

    return write


def vtk_written(writer, data, mode, path):
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    getattr(writer, f"SetDataModeTo{mode.removesuffix('Raw')}")()
    if mode.endswith("Raw"):
        writer.EncodeAppendedDataOff()
        writer.SetCompressorTypeToNone()
    assert writer.Write() == 1
    return path.read_bytes()


def vtk_surface(writer, mode):
    def write(path):
        cube = load("pyvista").PolyData.from_regular_faces(VERTICES, QUADS)
        data = cube.cast_to_unstructured_grid() if writer.endswith("GridWriter") else cube
        module = "vtkmodules.vtkIOXML" if "XML" in writer else "vtkmodules.vtkIOLegacy"
        made = getattr(load(module), writer)()
        if "XML" in writer:
            return vtk_written(made, data, mode, path)
        made.SetFileName(str(path))
        made.SetInputData(data)
        getattr(made, f"SetFileTypeTo{mode}")()
        assert made.Write() == 1
        return path.read_bytes()

    return write


def vti(mode):
    def write(path):
        grid = load("pyvista").ImageData(dimensions=(8, 8, 8))
        grid.cell_data["labels"] = LABELS.ravel(order="F")
        return vtk_written(load("vtkmodules.vtkIOXML").vtkXMLImageDataWriter(), grid, mode, path)

    return write


def msh(**options):
    cells = [("quad", QUADS)]
    return lambda p: saved(lambda q: load("meshio").write_points_cells(q, VERTICES, cells, **options), p)


def cells(suffix):
    blocks = [("tetra", np.array([(0, 1, 3, 7), (0, 1, 5, 7), (0, 2, 3, 7)]))]
    return lambda p: saved(lambda q: load("meshio").write_points_cells(q, VERTICES, blocks), p.with_suffix(suffix))


def tiff(compression):
    module = pytest.importorskip("tifffile")
    return lambda p: saved(lambda q: module.imwrite(q, LABELS, compression=compression), p)


def nrrd(encoding):
    module = pytest.importorskip("nrrd")
    head = {"spacings": [1.0, 1.0, 1.0], "encoding": encoding}
    return lambda p: saved(lambda q: module.write(str(q), LABELS, head), p)


def mha(*, packed):
    body = LABELS.ravel(order="F").tobytes()
    told = f"CompressedData = True\nCompressedDataSize = {len(zlib.compress(body))}\n" if packed else ""
    head = (
        f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n{told}DimSize = 7 7 7\n"
        "ElementSpacing = 0.5 0.5 0.25\nOffset = 0 0 0\nElementType = MET_USHORT\nElementDataFile = LOCAL\n"
    )
    return head.encode() + (zlib.compress(body) if packed else body)


def png(path):
    pixels = np.kron(LABELS[:, :, 2].astype(np.uint8), np.ones((4, 4), np.uint8)) * 100
    return saved(lambda p: load("matplotlib.image").imsave(p, pixels, cmap="gray"), path)


def statistics(path):
    xarray = load("xarray")
    grains = xarray.Dataset({"diameter": (("grain",), SPHERES[:, 3])}, attrs={"flag": True, "list": [1, 2]})
    tree = xarray.DataTree.from_dict({"/": xarray.Dataset({"solid_fraction": 0.5}), "/grains": grains}, name="measures")
    return saved(lambda p: vg.save_statistics(tree, p), path)


def checkpoint(path):
    return saved(lambda p: save_checkpoint(p, {"done": 3}, {"a": np.arange(20)}), path)


def run_of(path, *, resume):
    """Pack a few spheres, with a checkpoint."""
    box = vg.Box((4, 4, 4))
    return vg.pack(vg.shapes.sphere(), box, "rsa", count=9, seed=1, checkpoint=path, resume=resume)


def resealed(path):
    """Go on from a checkpoint with another header, sealed as if voxgran had written it."""
    good = path.with_name("run.checkpoint")
    try:
        header = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        header = {}
    save_checkpoint(path.with_suffix(".sealed"), header if isinstance(header, dict) else {}, load_checkpoint(good)[1])
    return run_of(path.with_suffix(".sealed"), resume=True)


def header_of_a_run(path):
    good = path.with_name("run.checkpoint")
    saved(lambda p: run_of(p, resume=False), good)
    return saved(lambda p: p.write_text(json.dumps(load_checkpoint(good)[0])), path)


def laser(path):
    laspy = pytest.importorskip("laspy")
    data = laspy.LasData(laspy.LasHeader(point_format=0))
    data.x, data.y, data.z = VERTICES.T
    return saved(lambda p: data.write(str(p)), path)


def constant(content):
    return lambda _: content if isinstance(content, bytes) else content.encode()


def as_labels(path):
    return vg.load_labels(path, voxel_size=1.0, border="keep")


def as_slice(path):
    """Read a file as the only slice of a folder."""
    folder = path.with_suffix("")
    folder.mkdir(exist_ok=True)
    (folder / "slice.dcm").write_bytes(path.read_bytes())
    return vg.load_labels(folder, voxel_size=1.0)


def as_opened(path, **options):
    """Read what a lazily opened image holds, of a large one a corner."""
    values = vg.open_image(path, **options).values
    return (values if values.size < 1e6 else values[:2, :2, :2]).compute()


def hdf5(path):
    def write(place):
        with pytest.importorskip("h5py").File(place, "w") as file:
            file.create_dataset("labels", data=LABELS, chunks=(4, 4, 4), compression="gzip")

    return saved(write, path)


def ome_zarr(folder):
    """Write an image of OME-Zarr of one scale, without compression of the metadata."""
    group = pytest.importorskip("zarr").open_group(folder, mode="w")
    group.create_array("0", data=LABELS, chunks=(4, 4, 4))
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    steps = [{"type": "scale", "scale": [0.5, 0.25, 0.25]}]
    scales = [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": steps}]}]
    group.attrs["ome"] = {"version": "0.5", "multiscales": scales}


def part_of_zarr(part):
    """Return what writes a file of a zarr directory, and what reads the directory with this file in it."""

    def write(path):
        ome_zarr(path.with_suffix(""))
        return (path.with_suffix("") / part).read_bytes()

    def read(path):
        folder = path.with_suffix("")
        if not folder.exists():
            ome_zarr(folder)
        (folder / part).write_bytes(path.read_bytes())
        return as_opened(folder)

    return ".part", write, read


def as_sieve(path):
    return vg.sizes.sieve(path, unit="mm", smallest=0.01).strata(10, np.random.default_rng(0))


def as_list(path):
    """Pack a list of grains, which has a few grains in a large box."""
    return vg.pack(grains=path, container=vg.Box((1e3, 1e3, 1e3)), method="rsa", unit="mm", tries=100)


def as_mended(path):
    return vg.load_shape(path, repair=True)


def as_cells(path):
    return read_cells(path, 3)


def as_plan(path):
    return vg.Scene.from_toml(path)


def as_study(path):
    return vg.Study(path).cells()


#: suffix, what writes a well-formed file, and what reads it
FORMATS = {
    "own packing": (".vtp", own_packing, vg.load),
    "rewritten packing": (".vtp", rewritten_packing, vg.load),
    "text points": (".vtp", vtk_points("PolyData", "Ascii"), vg.load),
    "raw points": (".vtp", vtk_points("PolyData", "AppendedRaw"), vg.load),
    "grid points": (".vtu", vtk_points("UnstructuredGrid", "Binary"), vg.load),
    "spheres": (".txt", constant(ROWS), vg.load),
    "own spheres": (".xyzr", lambda p: saved(lambda q: vg.save(sphere_packing(), q), p), vg.load),
    "named spheres": (".csv", constant("x[mm];y;z;diameter;name\n1,5;2;3;1;a\n2;4;3;0,5;b\n"), vg.load),
    "clumps": (".txt", constant("#format x_y_z_r_clumpId\n1 1 1 .5 0\n1.5 1 1 .5 0\n3 3 3 1 -1\n"), vg.load),
    "clump table": (".csv", constant(CLUMP), vg.load_shape),
    "clump lines": (".txt", constant("#format x_y_z_r_clumpId\n1 1 1 .5 0\n1.5 1 1 .5 0\n"), vg.load_shape),
    "molecule": (".mol", constant(MOLECULE), vg.load_shape),
    "atoms": (".data", constant(LAMMPS_DATA), vg.load),
    "dump": (".dump", constant(LAMMPS_DUMP), vg.load),
    "text stl": (".stl", constant(TEXT_STL), vg.load_shape),
    "stl": (".stl", constant(binary_stl()), vg.load_shape),
    "obj": (".obj", constant(OBJ), vg.load_shape),
    "mended obj": (".obj", constant(OBJ), as_mended),
    "off": (".off", constant(OFF), vg.load_shape),
    "text ply": (".ply", constant(ply("ascii", "")), vg.load_shape),
    "ply": (".ply", constant(ply("binary_little_endian", "<")), vg.load_shape),
    "big ply": (".ply", constant(ply("binary_big_endian", ">")), vg.load_shape),
    "old msh": (".msh", constant(MSH_2), vg.load_shape),
    "text msh": (".msh", msh(file_format="gmsh", binary=False), vg.load_shape),
    "msh": (".msh", msh(file_format="gmsh"), vg.load_shape),
    "text vtk": (".vtk", vtk_surface("vtkPolyDataWriter", "ASCII"), vg.load_shape),
    "vtk": (".vtk", vtk_surface("vtkUnstructuredGridWriter", "Binary"), vg.load_shape),
    "vtp": (".vtp", vtk_surface("vtkXMLPolyDataWriter", "Appended"), vg.load_shape),
    "vtu": (".vtu", vtk_surface("vtkXMLUnstructuredGridWriter", "Ascii"), vg.load_shape),
    "cells vtu": (".vtu", cells(".vtu"), as_cells),
    "cells msh": (".msh", cells(".msh"), as_cells),
    "cells inp": (".inp", cells(".inp"), as_cells),
    "cloud ply": (
        ".ply",
        constant(POINT_PLY.encode() + b"".join(struct.pack("<3di", *row, 0) for row in VERTICES.tolist())),
        vg.load_cloud,
    ),
    "text pcd": (
        ".pcd",
        constant(
            PCD.format("ascii") + "\n".join(" ".join(map(str, r)) for r in np.hstack([VERTICES, NORMALS]).tolist())
        ),
        vg.load_cloud,
    ),
    "pcd": (".pcd", constant(PCD.format("binary").encode() + np.hstack([VERTICES, NORMALS]).tobytes()), vg.load_cloud),
    "cloud text": (".xyz", constant(ROWS.replace("0.25", "1").replace("0.5", "0").replace("0.75", "2")), vg.load_cloud),
    "cloud csv": (".csv", constant("x,y,z,nx,ny,nz,grain\n0,0,1,0,0,1,0\n1,0,1,0,0,1,1\n"), vg.load_cloud),
    "las": (".las", laser, vg.load_cloud),
    "npy": (".npy", lambda p: saved(lambda q: np.save(q, LABELS), p), as_labels),
    "npz": (".npz", lambda p: saved(lambda q: np.savez_compressed(q, labels=LABELS), p), as_labels),
    "tif": (".tif", lambda p: tiff(None)(p), as_labels),
    "packed tif": (".tif", lambda p: tiff("zlib")(p), as_labels),
    "vti": (".vti", vti("AppendedRaw"), as_labels),
    "text vti": (".vti", vti("Ascii"), as_labels),
    "nrrd": (".nrrd", lambda p: nrrd("raw")(p), as_labels),
    "packed nrrd": (".nrrd", lambda p: nrrd("gzip")(p), as_labels),
    "mha": (".mha", constant(mha(packed=False)), as_labels),
    "packed mha": (".mha", constant(mha(packed=True)), as_labels),
    "dicom": (".dcm", constant(dicom_slice(LABELS[:, :, 2], 2, 0.5)), as_slice),
    "opened tif": (".tif", lambda p: tiff(None)(p), as_opened),
    "opened packed tif": (".tif", lambda p: tiff("zlib")(p), as_opened),
    "opened nrrd": (".nrrd", lambda p: nrrd("raw")(p), as_opened),
    "opened mha": (".mha", constant(mha(packed=False)), as_opened),
    "opened npy": (".npy", lambda p: saved(lambda q: np.save(q, LABELS), p), as_opened),
    "hdf5": (".h5", hdf5, as_opened),
    "zarr group": part_of_zarr("zarr.json"),
    "zarr array": part_of_zarr("0/zarr.json"),
    "zarr chunk": part_of_zarr("0/c/0/0/0"),
    "sieve sheet": (".csv", constant("opening [mm];passing [%]\n16;100\n8;80,5\n4;40\n2;10\n1;0\n"), as_sieve),
    "sieve masses": (".csv", constant("opening [um],retained [g]\n16,0\n8,310\n4,520\n2,405\n0,75\n"), as_sieve),
    "list of grains": (".csv", constant("shape,diameter [mm],density,count\nbox,9,2650,2\ntorus,6,7e3,3\n"), as_list),
    "list of masses": (".csv", constant("mass [g];density [g/cm3]\n1,5;2,65\n0,25;2,65\n"), as_list),
    "png": (".png", png, vg.load_outlines),
    "statistics": (".nc", statistics, vg.load_statistics),
    "checkpoint": (".checkpoint", checkpoint, load_checkpoint),
    "scene": (".toml", constant(SCENE), as_plan),
    "series": (".pvd", constant(PVD), listed_times),
    "study": (".toml", constant(STUDY), as_study),
    "run": (".checkpoint", header_of_a_run, resealed),
    "mercury": (".data", constant(MERCURY), vg.load),
    "extended xyz": (".xyz", constant(EXTENDED), vg.load),
    "xyzd": (".xyzd", constant((SPHERES * [1, 1, 1, 2]).astype("<f8").tobytes()), vg.load),
    "legacy points": (".vtk", constant(LEGACY), vg.load),
    "units": (".csv", constant(UNITS), vg.load),
    "units of a clump": (".csv", constant(UNITS.replace("5000", "1500")), vg.load_shape),
    "packed": (".csv.gz", constant(gzip.compress(UNITS.encode(), mtime=0)), vg.load),
    "packed shape": (".obj.gz", constant(gzip.compress(OBJ.encode(), mtime=0)), vg.load_shape),
}

NUMBERS = [b"0", b"-1", b"nan", b"inf", b"-inf", b"1e160", b"1e300", b"-1e300", b"1e-300", b"1e400", b"5e-324", b"1e59"]
NUMBERS += [b"2147483647", b"4294967296", b"99999999999999999999", b"1" + b"0" * 400, b"1e999999999", b"60000", b"1_0"]
NESTED = [b"[" * 20000, b'{"a":' * 20000, b"<a>" * 20000, b"<DataArray>" * 5000, b"(" * 20000, b"[[0]," * 5000]
TOKENS = [b"a" * 100_000, b"1 " * 60_000, b"\n" * 50_000, b"9" * 50_000, b"\0" * 1000, b'"', b"'", b"#", b"\xff\xfe"]
WORDS = [struct.pack("<q", v) for v in (-1, 0, 1, 2**31 - 1, 2**31, 2**62)]
WORDS += [struct.pack(k, v) for k in ("<d", ">d") for v in (float("nan"), float("inf"), 1e160, 1e300, -1e300, 1e-300)]
WORDS += [struct.pack(k, v) for k in ("<I", ">I", "<H") for v in (0, 1, 2**16 - 1)]
WORDS += [struct.pack(k, v) for k in ("<I", ">I") for v in (2**31 - 1, 2**31, 2**32 - 1)]


def replaced(raw, start, end, new):
    return raw[:start] + new + raw[end:]


def some(draw, raw, longest):
    """Draw a slice."""
    start = draw.randrange(len(raw) + 1)
    return start, min(len(raw), start + draw.randint(1, longest))


def flip(draw, raw):
    body = bytearray(raw)
    for _ in range(draw.randint(1, 8)):
        body[draw.randrange(len(body))] = draw.randrange(256)
    return bytes(body)


def overwrite(draw, raw):
    word, start = draw.choice(WORDS), draw.randrange(len(raw))
    return replaced(raw, start, start + len(word), word)


def cut(draw, raw):
    return raw[: draw.randrange(len(raw))]


def drop(draw, raw):
    return replaced(raw, *some(draw, raw, 200), b"")


def copy(draw, raw):
    start, end = some(draw, raw, 1000)
    return replaced(raw, *[draw.randrange(len(raw) + 1)] * 2, raw[start:end] * draw.choice([1, 2, 100]))


def number(draw, raw):
    found = list(re.finditer(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?", raw))
    if not found:
        return overwrite(draw, raw)
    chosen = draw.choice(found)
    return replaced(raw, *chosen.span(), draw.choice(NUMBERS))


def count(draw, raw):
    """Change a whole number a little, or to what another one is."""
    found = list(re.finditer(rb"\d+", raw))
    if not found:
        return flip(draw, raw)
    chosen = draw.choice(found)
    new = draw.choice([str(int(chosen[0][:18]) + draw.choice([-1, 1, 1000, 10**9])).encode(), draw.choice(found)[0]])
    return replaced(raw, *chosen.span(), new)


def line(draw, raw):
    """Remove, empty, repeat, or shuffle the words of a line."""
    lines = raw.splitlines(keepends=True)
    k = draw.randrange(len(lines))
    words = lines[k].split()
    draw.shuffle(words)
    lines[k] = draw.choice([b"", b"\n", lines[k] * 2, lines[k].rstrip() * 3 + b"\n", b" ".join(words) + b"\n"])
    return b"".join(lines)


def word(draw, raw):
    """Remove or repeat a word, up to very often."""
    found = list(re.finditer(rb"\S{1,100}", raw))
    if not found:
        return flip(draw, raw)
    chosen = draw.choice(found)
    return replaced(raw, *chosen.span(), (chosen[0] + b" ") * draw.choice([0, 2, 20_000]))


def insert(draw, raw):
    return replaced(raw, *[draw.randrange(len(raw) + 1)] * 2, draw.choice(TOKENS))


def nest(draw, raw):
    return replaced(raw, *[draw.randrange(len(raw) + 1)] * 2, draw.choice(NESTED))


CHANGES = [flip, overwrite, cut, drop, copy, number, number, count, line, word, insert, nest]


def mutated(name, seed, k, raw):
    """Return a damaged file."""
    draw = random.Random(f"{name}/{seed}/{k}")
    for _ in range(draw.choice([1, 1, 1, 2, 3])):
        raw = draw.choice(CHANGES)(draw, raw)[:LARGEST] if raw else raw
    return raw


def used():
    """Return the CPU time of this process and of its children that have ended."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def outcome(read, path, *, again=True):
    """Return what is wrong with how a file is read; None if nothing is."""
    start = used()
    try:
        with warnings.catch_warnings(action="error"):
            warnings.simplefilter("ignore", PackingWarning)
            warnings.simplefilter("ignore", DirtyMeshWarning)
            read(path)
    except VoxgranError as error:
        if "\n" in str(error) or len(str(error)) > 1000:
            return f"a message of {len(str(error))} characters: {str(error)[:300]!r}"
    except BaseException as error:  # noqa: BLE001  (whatever it is, it is told)
        return f"{type(error).__name__}: {str(error)[:300]}"
    if (taken := used() - start) < SOON:
        return None
    # the first time kernels may have been compiled
    return outcome(read, path, again=False) if again else f"{taken:.1f} s"


def tried(name, folder, seed, numbers):
    """Return what is wrong, by the number of the mutation."""
    suffix, write, read = FORMATS[name]
    good, path = folder / f"good{suffix}", folder / f"damaged{suffix}"
    good.unlink(missing_ok=True)
    raw = write(good)
    good.write_bytes(raw)
    found = {}
    if wrong := outcome(read, good):
        found["none"] = wrong
    for k in numbers:
        path.write_bytes(mutated(name, seed, k, raw))
        if wrong := outcome(read, path):
            found[k] = wrong
    return found


@pytest.mark.parametrize("name", [name if name in ("vtu", "tif") else slow(name) for name in FORMATS])
def test_readers_find_their_libraries_in_a_process_of_their_own(name, tmp_path, capfd):
    assert tried(name, tmp_path, 0, range(1)) == {}
    assert capfd.readouterr() == ("", "")


@pytest.mark.usefixtures("forked_readers")
@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files_are_refused_soon_and_in_silence(name, tmp_path, capfd):
    assert tried(name, tmp_path, 0, range(1, 6)) == {}
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
@pytest.mark.usefixtures("forked_readers")
@pytest.mark.parametrize("name", FORMATS)
def test_a_thousand_damaged_files_of_each_format(name, tmp_path, capfd):
    assert tried(name, tmp_path, 1, range(1000)) == {}
    assert capfd.readouterr() == ("", "")
