"""What several test files need: tasks of packing methods, lattices of points, meshes, and the reference values."""

import contextlib
import faulthandler
import os
import re
import signal
import struct
import subprocess
import sys
import tomllib
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import ConvexHull

import voxgran as vg
from voxgran._base import guarded
from voxgran.contacts.forces import ContactForces
from voxgran.containers.kinds.box import Box
from voxgran.packing.draw import Request
from voxgran.packing.driver import Drive, drive
from voxgran.packing.method import method_registry
from voxgran.packing.model import Packing
from voxgran.packing.pack import prepare_task
from voxgran.scene import processes
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.tessellate import unit_box

REFERENCES = Path(__file__).parent / "reference" / "references.toml"


def references(table):
    """Return a table of published values; the file says where each comes from."""
    return tomllib.loads(REFERENCES.read_text())[table]


def wanted(reasons):
    """Return what reasons of skipped tests say is not installed, with how often, the most frequent first."""
    found = (re.search(r"could not import '(\w+)|(\S+) is not installed", reason) for reason in reasons)
    return Counter(match[1] or match[2] for match in found if match).most_common()


def slow(*values):
    """Return the values of a case that is run by `make test-slow` only."""
    return pytest.param(*values, marks=pytest.mark.slow)


#: what methods of the plane need to be asked, or what makes them quick
ASKED_IN_PLANE = {
    "advancing_front": {"mode": "dense"},
    "control_point": {"sweeps": 40, "settle": False},
    "deposition": {"toward": "center"},
    "digital": {"sweeps": 40, "settle": False},
    "expand": {"solid_fraction": 0.7},
}


def methods_of_the_plane():
    """Return the methods that fill a region of the plane with given sizes, as cases; the longest one is slow.

    Layers lie on a flat floor, and specimens take another size.
    """
    known = map(method_registry().get, vg.packing_methods())
    fill = [one.name for one in known if 2 in one.dimensions and one.sizing != "made"]
    return [slow(name) if name == "digital_fill" else name for name in fill if name not in ("multilayer", "compress")]


@contextlib.contextmanager
def dask_cluster(folder):
    """Start a Dask cluster of two processes with one thread each, in a process of its own; yield it and the address."""
    pytest.importorskip("distributed")
    code = (
        "import sys, time, distributed\n"
        "if __name__ == '__main__':\n"
        "    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:\n"
        "        print(cluster.scheduler_address, flush=True)\n"
        "        sys.stdin.read()\n"
    )
    path = folder / "cluster.py"
    path.write_text(code)
    libraries = os.pathsep.join(entry for entry in sys.path if entry)
    process = subprocess.Popen(
        [sys.executable, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": libraries},
        text=True,
        start_new_session=True,
    )
    try:
        yield process, process.stdout.readline().strip()
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def small_scene(family="sphere", count=3):
    """Return the tables of a scene that is packed in no time: [[shape]], [container] and, last, [packing]."""
    return f"""
[[shape]]
family = "{family}"
[container]
kind = "box"
lengths = [4, 4, 4]
[packing]
method = "rsa"
count = {count}
"""


def task_of(method, shapes, container, *, count=None, sizes=None, seed=0, start=None, settle=False, **parameters):
    """Return the task of packing so many grains, ready to run, with parameters of the method; they do not settle."""
    options = {"count": count, "sizes": sizes, "seed": seed, "start": start, "settle": settle}
    return prepare_task(Request(shapes, container, method, parameters=parameters, **options))


def run(task, chunk=None):
    """Run a task to its end; return the state and the packing."""
    state = drive(task.method, task.problem, Drive(chunk=chunk))
    return state, task.method.finish(task.problem, state)


def lattice(*counts):
    """Return the centers of unit cells, the last axis fastest: (n, 3) for three counts."""
    axes = [np.arange(count) + 0.5 for count in counts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(counts))


def grey_beads(centers, radius, side):
    """Return a grey image (side, side, side) of spheres with centers in voxels, blurred and with noise."""
    places = np.stack(np.meshgrid(*[np.arange(side) + 0.5] * 3, indexing="ij"), axis=-1)
    solid = np.any([((places - center) ** 2).sum(axis=-1) < radius**2 for center in centers], axis=0)
    noise = np.random.default_rng(1).normal(0, 6, solid.shape)
    return (ndimage.gaussian_filter(60 + 120.0 * solid, 0.8) + noise).clip(0, 255).astype(np.uint8)


def mesh_box(lengths):
    """Return a box as a triangulated shape."""
    vertices, faces, _ = unit_box()
    return Shape.from_mesh(vertices * np.array(lengths), faces, name="box")


def fixed_shape(vertices, faces):
    """Return a shape that stays where it is: its frame is that of the lattice."""
    return Shape(Mesh(np.ascontiguousarray(vertices, dtype=float), np.ascontiguousarray(faces)), "body")


def column(count, **more):
    """Return spheres of diameter 1 on top of each other at rest: each bears the weight of those above it."""
    above = np.arange(count - 1, -1, -1.0)
    place = np.column_stack([np.ones((count, 2)), np.arange(count) + 0.5])
    up = np.array([0.0, 0.0, 1.0])
    forces = ContactForces(
        i=np.append(np.arange(1, count), 0),
        j=np.append(np.arange(count - 1), -1),
        point=np.append(place[1:], place[:1], axis=0) - 0.5 * up,
        normal=np.tile(-up, (count, 1)),
        force=-up * np.append(above[1:] + 1, count)[:, None],
        gap=np.zeros(count),
        residual=np.zeros(count),
        rattler=np.zeros(count, dtype=bool),
        friction=0.5,
    )
    sphere = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
    return Packing.of([sphere], Box((2, 2, count + 1)), position=place, forces=forces, **more)


def hull(points):
    """Return vertices and outward faces of a convex hull, and its half-spaces."""
    found = ConvexHull(points)
    corners = points[found.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fi,fi->f", normals, found.equations[:, :3]) < 0
    faces = np.where(inward[:, None], found.simplices[:, ::-1], found.simplices)
    return points, faces.astype(np.int64), found.equations


def install(folder, name, groups):
    """Write what pip would write beside the modules of a package, so that its entry points are found."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    sections = (
        f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in rows.items()) for group, rows in groups.items()
    )
    (info / "entry_points.txt").write_text("".join(sections))


class Forked:
    """A process that is forked from this one, which has its libraries loaded, and not started anew."""

    def __init__(self, work):
        self.returncode = None
        with warnings.catch_warnings():
            # of threads, none of which holds a lock that is asked for there
            warnings.filterwarnings("ignore", "This process .* multi-threaded", DeprecationWarning)
            self.pid = os.fork()
        if not self.pid:
            try:
                # a crash of a library is an end like others
                faulthandler.disable()
                work()
            finally:
                os._exit(70)

    def wait(self, timeout=None):
        if self.returncode is None:
            self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self.returncode

    def send_signal(self, number):
        if self.returncode is None:
            os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)


class ForkedReader(Forked):
    """A process that reads a file, and the pipe that it answers through."""

    def __init__(self, request):
        there, here = os.pipe()

        def read():
            os.dup2(here, 1)
            os.dup2(os.open(os.devnull, os.O_RDWR), 2)
            # those that pytest put there lead elsewhere
            sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
            guarded.serve(request)

        super().__init__(read)
        os.close(here)
        self.stdout = os.fdopen(there, "rb")


class ForkedWorker(Forked):
    """Stands in for `subprocess.Popen` in `scene.processes`: the same from the first message on."""

    def __init__(self, words, *, pass_fds, env, **_):
        number, module, name = words[4:7]

        def compute():
            os.setsid()
            os.environ.update(env)
            # what is open here would keep others from seeing the end of what they are connected to
            sys.modules["voxgran._base.compiling.kernel_files"]._claims.cache_clear()
            os.closerange(3, pass_fds[0])
            os.closerange(pass_fds[0] + 1, os.sysconf("SC_OPEN_MAX"))
            processes.serve(int(number), module, name)

        super().__init__(compute)


@contextlib.contextmanager
def forked(request):
    """Stand in for `guarded._process`: a hundred times faster, the same from the request on."""
    process = ForkedReader(request)
    try:
        yield process
    finally:
        process.stdout.close()
        process.send_signal(signal.SIGKILL)
        process.wait()


def dicom_slice(values, k, thickness):
    """Return a file of one slice, (columns, rows), with explicit value representations, little endian."""

    def element(group, number, kind, content):
        content += (b" " if kind in (b"DS", b"CS", b"IS") else b"\0") * (len(content) % 2)
        size = struct.pack("<HI", 0, len(content)) if kind in (b"OW", b"OB") else struct.pack("<H", len(content))
        return struct.pack("<HH", group, number) + kind + size + content

    short = lambda number: struct.pack("<H", number)  # noqa: E731
    syntax = element(2, 0x10, b"UI", b"1.2.840.10008.1.2.1")
    body = [
        element(0x18, 0x50, b"DS", str(thickness).encode()),
        element(0x20, 0x0E, b"UI", b"1.2.3"),
        element(0x20, 0x13, b"IS", str(k + 1).encode()),
        element(0x20, 0x32, b"DS", f"0\\0\\{k * thickness}".encode()),
        element(0x20, 0x37, b"DS", b"1\\0\\0\\0\\1\\0"),
        element(0x28, 0x02, b"US", short(1)),
        element(0x28, 0x04, b"CS", b"MONOCHROME2"),
        element(0x28, 0x10, b"US", short(values.shape[1])),
        element(0x28, 0x11, b"US", short(values.shape[0])),
        element(0x28, 0x30, b"DS", b"0.2\\0.1"),
        element(0x28, 0x100, b"US", short(16)),
        element(0x28, 0x101, b"US", short(16)),
        element(0x28, 0x102, b"US", short(15)),
        element(0x28, 0x103, b"US", short(0)),
        element(0x7FE0, 0x10, b"OW", values.T.astype("<u2").tobytes()),
    ]
    length = element(2, 0, b"UL", struct.pack("<I", len(syntax)))
    return b"\0" * 128 + b"DICM" + length + syntax + b"".join(body)
