"""Flags of each command, and how they are read."""

import argparse
import contextlib
import json
from typing import Any

from voxgran._base.errors import InputError

Flag = tuple[tuple[str, ...], dict[str, Any]]


def _flag(*names: str, **keywords: Any) -> Flag:
    """Return the arguments of :meth:`argparse.ArgumentParser.add_argument`."""
    return names, keywords


def _refuse_again(namespace: argparse.Namespace, dest: str, flag: str | None) -> None:
    """Note that a flag sets `dest`, and refuse it where one has set it before, whose value would be lost silently."""
    given = vars(namespace).setdefault("given", {})
    if flag and dest in given:
        former = "twice" if given[dest] == flag else f"beside {given[dest]}"
        raise InputError(f"{flag} is given {former}: it takes effect once; leave one of them out")
    given[dest] = flag


class Once(argparse.Action):
    """A flag whose value is stored, and which may be given once."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        """Store the value."""
        _refuse_again(namespace, self.dest, option_string)
        setattr(namespace, self.dest, values)


class _Switch(argparse.BooleanOptionalAction):
    """A flag with its opposite, of which one may be given once."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        """Store True or False."""
        _refuse_again(namespace, self.dest, option_string)
        super().__call__(parser, namespace, values, option_string)


def as_value(text: str) -> Any:
    """Read a flag's value as TOML would, lists with or without brackets; anything else is text."""
    for candidate in (text, f"[{text}]" if "," in text else text):
        # a number of more than 4300 digits is a ValueError too, and deep brackets recurse too far
        with contextlib.suppress(ValueError, RecursionError):
            return json.loads(candidate)
    return text.split(",") if "," in text else text


#: edges of a voxel of an image
VOXEL_SIZE = _flag(
    "--voxel-size", type=as_value, help="edge of a voxel, or its three edges: x,y,z; default: as the file says"
)
#: an image, and what is said of one without a header
IMAGE: tuple[Flag, ...] = (
    _flag(
        "file",
        help="image: .npy, .npz, .tif, .png, .vti, .nrrd, .mha, .mhd, .mat, .raw, .zarr, .h5, or a folder of slices",
    ),
    _flag("--key", help="which array of an .npz, .vti, .mat or HDF5 file"),
    _flag("--shape", type=as_value, help="voxels along x, y and z of a file without a header (.raw): nx,ny,nz"),
    _flag("--dtype", help="type of its numbers, such as uint16, or '>u2' with the highest byte first"),
)
#: where to compute
DASK = _flag("--dask", help="address of a Dask scheduler, such as tcp://127.0.0.1:8786, to compute there")
#: whether a page has a view beside its pictures
INTERACTIVE = _flag("--interactive", action=_Switch, default=True, help="a view to turn and cut in a browser")
#: a packing, and what may be said of a file of another program
PACKING: tuple[Flag, ...] = (
    _flag("file", help="a saved packing, or spheres of another program: text, CSV, LAMMPS, VTK points"),
    _flag("--periodic", help="axes along which the box of such spheres is periodic, such as xy"),
    _flag("--unit", help="unit of lengths of such spheres"),
    _flag("--shrink", action="store_true", help="make such spheres smaller by one factor, until none overlap"),
)
#: engine, and what a simulation needs beside its material
ENGINE = _flag("--engine", default="lammps", help="engine; 'voxgran engines' lists them")
DECK: tuple[Flag, ...] = (
    _flag("--clump", type=int, help="spheres of a clump in place of each shape that is no sphere"),
    _flag("--time-step", type=float, help="time step in s; default: by the contact law"),
    _flag("--stress", type=as_value, help="mean stress of a periodic cell in Pa: 1e5, or NaN,NaN,1e5 along the axes"),
)
#: a mesh file that is read, and one that is written
SURFACE = _flag("file", help="mesh file: STL, OBJ, PLY, OFF, VTP, VTU, VTK or MSH")
MESH = _flag("-o", "--output", help="mesh file for the result: STL, OBJ, PLY, OFF or VTP")
#: what a run that moves grains goes on from
GOES_ON: tuple[Flag, ...] = (
    _flag("--checkpoint", help="file to go on from after an interrupt; default: beside the output"),
    _flag("--resume", action="store_true", help="go on from the checkpoint"),
)
#: choices and a default of other rooms, written here too, since these import NumPy and half of the package: `ColorBy`,
#: `KINDS` and `LONGEST`, which tests compare
COLORS = ("diameter", "height", "shape", "density", "coordination", "distance", "force", "residual")
KINDS = ("clump", "polyhedron", "mesh", "level_set", "convex_parts")
LONGEST = 200.0
RESUME = _flag("--resume", action="store_true", help="go on from the checkpoint in the folder")
TARGETS = ("iou", "volume", "inertia", "surface")
COLORED = _flag("--color-by", choices=COLORS, default="diameter", help="what the grains are coloured by")

#: flags of each command beside --json and --overwrite
FLAGS: dict[str, tuple[Flag, ...]] = {
    "init": (_flag("file", nargs="?", default="scene.toml"),),
    "plan": (_flag("file", help="scene file"),),
    "run": (
        _flag("file", help="scene file"),
        _flag("-o", "--output", default="out", help="folder for the results"),
        RESUME,
    ),
    "verify": (*PACKING, _flag("--tolerance", type=float, default=1e-9, help="in mean diameters")),
    "settle": (
        *PACKING,
        _flag("-o", "--output", required=True, help="file for the settled packing: .vtp"),
        _flag("--gravity", type=as_value, help="its direction: -z or x,y,z; default: as the packing says"),
        _flag("--seed", type=int, default=0, help="seed of the random accelerations of shaking"),
        *GOES_ON,
    ),
    "compress": (
        *PACKING,
        _flag("-o", "--output", required=True, help="file for the compressed packing: .vtp"),
        *GOES_ON,
    ),
    "tile": (
        *PACKING,
        _flag("-o", "--output", required=True, help="file for all copies: .vtp"),
        _flag(
            "--repeats", type=as_value, required=True, help="copies along each axis: 4,4,1, or 4 where it is periodic"
        ),
    ),
    "equilibrium": (
        *PACKING,
        _flag("--friction", type=float, help="coefficient of friction; default: as the packing was settled, or 0.5"),
        _flag("--gap", type=float, default=1e-3, help="up to which grains touch, in median diameters"),
        _flag("--tolerance", type=float, default=0.01, help="net force, in weights, up to which a grain rests"),
        _flag("--rest", type=float, default=0.95, help="share of the grains that must rest for exit status 0"),
        _flag("--stress", type=as_value, help="mean stress that is borne without gravity: 1, or 1,1,2 along the axes"),
        _flag("--gravity", type=as_value, help="its direction: -z or x,y,z; default: as the packing says"),
    ),
    "measure": (
        *PACKING,
        _flag("--which", action="append", help="a measure, or all; may be repeated"),
        _flag("-o", "--output", help="netCDF file"),
    ),
    "report": (
        *PACKING,
        _flag("-o", "--output", help="HTML file; the numbers go beside it as JSON"),
        COLORED,
        _flag("--turntable", action="store_true", help="add a picture that turns"),
        INTERACTIVE,
    ),
    "picture": (
        *PACKING,
        _flag("-o", "--output", help="PNG file; default: of the same name"),
        COLORED,
        _flag("--cut", action="store_true", help="leave out the grains in the quarter that faces the viewer"),
        _flag("--window", type=as_value, default="900,900", help="width and height, in pixels"),
        _flag("--legend", action=_Switch, default=True, help="say what the colours mean"),
    ),
    "compare": (
        _flag(
            "file",
            nargs="+",
            help="packings, or folders that 'voxgran run' wrote, with one packing or one for each seed; "
            "NAME=PATH names a group, and the same name again adds packings to it",
        ),
        _flag("-o", "--output", default="comparison.html", help="HTML file; the numbers go beside it as JSON"),
        INTERACTIVE,
    ),
    "image": (_flag("what", choices=("info",), help="info: voxels, lengths, values and labels"), *IMAGE),
    "twin": (
        *PACKING,
        _flag("--count", type=int, help="number of grains; default: as many as the sample has whole"),
        _flag("--solid-fraction", type=float, help="of the twin; default: that of the sample"),
        _flag("--protocol", choices=("gravity", "compress", "expand"), help="default: by the gravity of the sample"),
        _flag("--faces", type=int, help="most triangles of a grain; default 200"),
        _flag("--forms", type=int, help="most different shapes; default 100"),
        _flag("--voxel-size", type=float, help="edge of the voxels on which both are compared"),
        _flag("--seed", type=int, default=0, help="seed of the grains and of the packing"),
        _flag("--seeds", type=int, help="number of packings, whose scatter is then known"),
        _flag("-o", "--output", required=True, help="folder for the packing, the shapes and the page"),
        RESUME,
    ),
    "labels": (
        *IMAGE,
        VOXEL_SIZE,
        _flag("--segment", action="store_true", help="the image holds grey values, of which labels are made first"),
        _flag("--border", choices=("keep", "drop"), default="keep", help="grains that the image cuts"),
        _flag("--surface", choices=("smooth", "voxel"), default="smooth", help="smooth, or faces of voxels"),
        _flag("--smoothing", type=float, default=1.0, help="over how many voxels their steps are rounded"),
        _flag("--periodic", default="", help="axes along which the image repeats, such as xy"),
        _flag("--gravity", type=as_value, help="where gravity acts in the sample: -z or x,y,z; default: nowhere"),
        _flag("--min-size", type=int, help="voxels of the smallest labels; default: 1, with --segment 64"),
        _flag("--unit", help="unit of the voxel size"),
        DASK,
        _flag("-o", "--output", help="file for the packing that the sample is: .vtp"),
    ),
    "segment": (
        *IMAGE,
        VOXEL_SIZE,
        _flag("--threshold", type=as_value, default="otsu", help="grey value above which a voxel is solid, or otsu"),
        _flag("--dark-grains", action="store_true", help="grains are darker than the void"),
        _flag("--min-size", type=int, default=64, help="voxels of the smallest grains, bodies and holes"),
        _flag(
            "--separation",
            type=float,
            help="decrease of the distance to the void between two grains; default: a tenth of that in the smaller",
        ),
        DASK,
        _flag("--picture", help="PNG file: slices with the outlines of the grains, those in doubt marked"),
        _flag("-o", "--output", help="file for the labels: .vti, .tif, .zarr or .npy"),
    ),
    "learn": (
        _flag("files", nargs="+", help="packing, such as that of labels (.vtp), or mesh files, one a grain"),
        _flag("--method", choices=("warp", "bend"), help="how grains are made; default: chosen from the sample"),
        _flag("--strength", type=float, help="by how much new grains differ from their donors; default: chosen"),
        _flag("--seed", type=int, default=0, help="seed of the choice and of the comparison"),
        _flag("--descriptors", action="store_true", help="compare roundness and smallest boxes too, which take longer"),
        _flag("--picture", help="PNG file: grains of the sample, each beside one that was made of it"),
        _flag("-o", "--output", required=True, help="file for the distribution: .nc"),
    ),
    "repair": (
        SURFACE,
        MESH,
        _flag(
            "--max-hole", type=float, default=0.25, help="widest hole that is closed, in diagonals of the bounding box"
        ),
        _flag(
            "--bodies", choices=("refuse", "largest", "all"), default="refuse", help="what becomes of several solids"
        ),
    ),
    "simplify": (
        SURFACE,
        _flag("--faces", type=int, required=True, help="largest number of triangles"),
        _flag("--repair", action="store_true", help="mend the surface first, as 'voxgran repair' does"),
        MESH,
    ),
    "cloud": (
        _flag("file", help="point cloud: .ply, .pcd, .xyz, .csv or .las"),
        _flag("--method", choices=("poisson", "alpha"), default="poisson", help="smooth, or through the points"),
        _flag("--outliers", type=float, help="drop points this many standard deviations from their neighbours"),
        _flag("--spacing", type=float, help="thin the cloud to one point for each cube of this edge"),
        _flag(
            "--max-gap", type=float, default=5.0, help="how far the surface may be from the nearest point, in spacings"
        ),
        MESH,
    ),
    "clump": (
        _flag("file", help="mesh file"),
        _flag(
            "--spheres",
            "--max-spheres",
            dest="max_spheres",
            type=int,
            help="number of spheres, with a target the largest that is tried; default: 50, or 1000 with a target",
        ),
        _flag("--target", choices=TARGETS, help="error that is to be reached with the fewest spheres"),
        _flag("--value", type=float, help="value of the target"),
        _flag("--method", default="optimal", help="clump method; 'voxgran methods' lists them"),
        _flag("--seed", type=int, default=0, help="random seed"),
        _flag("-o", "--output", help="file for the spheres: .csv (x,y,z,r), .txt (YADE) or .mol (LAMMPS molecule)"),
        _flag("--picture", help="PNG file: the shape beside its clump, coloured by the distance from the true surface"),
    ),
    "export": (
        *PACKING,
        ENGINE,
        _flag("-o", "--output", required=True, help="folder for the files"),
        _flag("--grains", choices=KINDS, help="what grains that are no spheres become; default: what the engine has"),
        *DECK,
    ),
    "relax": (
        *PACKING,
        ENGINE,
        _flag("-o", "--output", required=True, help="file for the relaxed packing: .vtp"),
        _flag("--history", help="netCDF file for the course of the run"),
        _flag("--folder", help="folder where the files of the engine stay"),
        _flag("--until", type=float, help="mean kinetic energy at rest, in m g d, under a stress s in s d^3"),
        _flag("--longest", type=float, default=LONGEST, help="longest time, in sqrt(d / g), or sqrt(m / (s d))"),
        *DECK,
    ),
    "methods": (_flag("name", nargs="?", help="one method, family or measure; default: all of them"),),
    "study": (
        _flag("file", help="study file"),
        _flag("-o", "--output", default="out", help="folder for the results; what is finished there is kept"),
        _flag("--dry-run", action="store_true", help="say what would be computed, and what is done"),
        _flag("--workers", type=int, help="processes, one thread each; default: one for each processor"),
        _flag("--memory", help="memory that they may take, such as 8GB or 50%%; default: 80%%"),
        DASK,
        _flag("--resume", action="store_true", help="accepted: a study goes on where it was, also without this flag"),
        _flag("--retry", action="store_true", help="compute runs that failed again"),
        _flag("--zarr", action="store_true", help="write the dataset as zarr, too"),
    ),
    "doctor": (
        _flag(
            "--warm",
            nargs="?",
            const="all",
            choices=("all", "demo"),
            help="compile the kernels of usual scenes, which takes minutes, or those of the demo",
        ),
    ),
    "data": (
        _flag("name", nargs="?", help="such as eros.obj or itokawa_lp.obj; default: the files are listed"),
        _flag("-o", "--output", help="file; default: of the same name, in this folder"),
    ),
    "demo": (_flag("-o", "--output", default="out/demo", help="folder for the results"),),
    "app": (
        _flag("file", nargs="?", help="scene file to begin with"),
        _flag("-o", "--output", help="folder for the runs; default: app, beside the scene"),
        _flag("--port", type=int, default=0, help="port; default: a free one"),
        _flag("--no-browser", action="store_true", help="print the address only"),
    ),
}
