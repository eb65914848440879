"""What `voxgran doctor --warm` does: compile the kernels of usual scenes, or of the demo, by computing tiny ones."""

import time
import warnings
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import wait
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from voxgran._base.errors import InputError, PackingWarning
from voxgran._base.kernels import cache_folder
from voxgran._base.machine import processor_count
from voxgran._base.progress import OnStep, Step
from voxgran._base.stopping import heed
from voxgran.clumps.fit import fit_clump
from voxgran.contacts.deformation.deform import deform
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.kinds.sphere import Sphere
from voxgran.containers.model import Container
from voxgran.geometry import morton
from voxgran.io.image import to_image
from voxgran.lattice.segment import segment
from voxgran.measures.describe import describe
from voxgran.measures.model import measure
from voxgran.packing.method import method_registry, packing_methods
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.packing.settle import settle
from voxgran.packing.transform.from_labels import packing_of_labels
from voxgran.scene import demo
from voxgran.scene.processes import TICK, Process, compute, start
from voxgran.settling import projected_gradient
from voxgran.settling.equilibrium import equilibrium
from voxgran.shapes.family import default_families, make_shape
from voxgran.shapes.files import load_shape, save_shape
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.repair import repair
from voxgran.shapes.roughness.roughen import roughen
from voxgran.shapes.sizes import lognormal
from voxgran.voxels.occupy import voxelize
from voxgran.voxels.signed_distance import signed_distance

#: a sphere, a convex polyhedron and a mesh that is not convex: kernels differ by the kind of shape
FAMILIES = ("solid_union", "convex_polyhedron", "sphere")
#: kinds of shapes whose contacts are found by kernels of their own: a sphere, convex solids with flat and with round
#: faces, a mesh that is not convex, and outlines
SETTLED = ("solid_union", "convex_polyhedron", "ellipsoid", "sphere", "polygon", "disk")
#: a box of few grains
BOX = Box((3, 3, 4), periodic=(True, True, False))
#: what makes a method quick; grains settle in a scene of their own
QUICK: dict[str, dict[str, Any]] = {name: {"sweeps": 100, "settle": False} for name in ("control_point", "digital")}
#: what methods are asked for of which they have kernels of their own
ASKED: dict[str, dict[str, Any]] = {
    "rsa": {"until": "saturated", "tries": 20, "count": 80},
    "digital_fill": {"place": "contact"},
    "voronoi_fill": {"fill": "cells"},
}
#: kinds of shapes whose overlaps are found by kernels of their own, those that are compared together
OVERLAPPING = (("cylinder", "solid_union", "ellipsoid"), ("shell", "shell"), ("polygon", "polygon", "disk"))
#: methods with kernels of their own for grains that are there before, and what is asked of them
ADDING: dict[str, dict[str, Any]] = {
    "control_point": {"distance": 0.05, "lid": True},
    "digital": {},
    "digital_fill": {},
    "gravity": {},
    "growth": {},
}
#: scenes whose kernels are compiled, and grains of the demo then
CHOICES, FEW = ("all", "demo"), 12
#: number of kernels that all scenes use, of which a package that was built by `make dist` brings all
KERNELS = 161
#: processes at the most: of more, most wait for the largest kernels
PROCESSES = 8


@dataclass(frozen=True, slots=True)
class Warmed:
    """Number of kernels that were compiled, and the seconds that all took."""

    kernels: int
    seconds: float


def warm(on_step: OnStep | None = None, which: str = "all") -> Warmed:
    """Compile the kernels of usual scenes, or of the demo, that are not yet in the cache.

    Parameters
    ----------
    on_step : callable, optional
        Told of each scene.
    which : {"all", "demo"}
        Those of which scenes.
    """
    began, before = time.monotonic(), _count()
    tasks = scenes() if which == "all" else [partial(_show, method) for method in demo.PARAMETERS]
    waiting = [partial(_compute, task) for task in reversed(tasks)]
    with ExitStack() as stack:
        pool = {}
        for _ in range(min(PROCESSES, processor_count(), len(tasks))):
            process = stack.enter_context(start(compute, Process))
            pool[process.connection] = process
            process.connection.send(waiting.pop())
        for done in range(1, len(tasks) + 1):
            while not (answered := wait(pool, timeout=TICK)):
                heed()
            process = next(pool[connection] for connection in pool if connection in answered)
            process.receive()
            if waiting:
                process.connection.send(waiting.pop())
            if on_step is not None:
                most = f" of at most {KERNELS}" * (which == "all")
                text = f"kernels (once per machine), {_count() - before}{most}"
                on_step(Step(stage="compiling", done=done, total=len(tasks), text=text))
    return Warmed(_count() - before, time.monotonic() - began)


def scenes() -> list[Callable[[], None]]:
    """Return the scenes, those that compile most first: settling and each method with each kind of shape in turn, so
    that two processes compile different kernels, then solids and each family of shapes.
    """
    packed = [partial(pack_few, method, family) for family in FAMILIES for method in _methods()]
    settled = [partial(settle_few, family) for family in SETTLED]
    made = [partial(make_few, family) for family in default_families()]
    in_turn = [task for pair in zip(settled, packed, strict=False) for task in pair]
    asked = [partial(pack_few, method, family, **more) for method, more in ASKED.items() for family in FAMILIES]
    added = [partial(add_few, method, **more) for method, more in ADDING.items()]
    few = [settle_many, overlap_few, measure_few, read_few, deform_few, use_solids]
    return [*in_turn, *packed[len(settled) :], *asked, *added, *few, *made]


def _show(method: str) -> None:
    """Pack a few grains as the demo does."""
    demo.packed(method, FEW)


def _methods() -> list[str]:
    """Return the names of the methods; the one with most kernels first."""
    return sorted(packing_methods(), key=lambda name: name != "control_point")


def pack_few(method: str, family: str, **more: Any) -> None:
    """Pack a few grains by a method, with more that is asked of it, check, measure and voxelize them."""
    container: Container = Sphere(2.0) if method == "apollonian" else BOX
    sizes = None if method_registry().get(method).sizing == "made" else lognormal(1.0, 0.1)
    asked = {"count": 4} | QUICK.get(method, {}) | more
    packing = pack(make_shape(family), container, method, sizes=sizes, seed=1, **asked)
    verify(packing)
    measure(packing)
    to_image(packing, voxel_size=0.1)


def add_few(method: str, **more: Any) -> None:
    """Pack a grain by a method beside two that are there, and one in a container of triangles."""
    sphere, rock = make_shape("sphere"), make_shape("solid_union")
    few = QUICK.get(method, {}) | more
    start = Packing.of(sphere, BOX, position=[(0.6, 0.6, 0.6), (1.8, 1.8, 0.6)])
    pack(rock, BOX, method, count=1, start=start, seed=1, **few)
    tank = make_shape("box", lengths=(3, 3, 4))
    pack(rock, ClosedMesh(Shape.from_mesh(tank.vertices, tank.faces)), method, count=1, seed=1, **few)


def overlap_few() -> None:
    """Check grains that overlap."""
    for families in OVERLAPPING:
        shapes = [make_shape(family) for family in families]
        box: Container = Rectangle((3, 3)) if shapes[0].dimension == 2 else BOX
        position = [(1.2 + 0.4 * k, 1.5, 1.5 * (box.dimension - 2)) for k in range(len(shapes))]
        verify(Packing.of(shapes, box, position=position, shape_id=range(len(shapes))))


def measure_few() -> None:
    """Take all measures of spheres and of solids."""
    for family in ("sphere", "solid_union"):
        measure(pack(make_shape(family), BOX, "rsa", count=4, seed=1), "all")


def read_few() -> None:
    """Find the grains of an image of voxels, and make grains like them."""
    packing = pack(make_shape("ellipsoid"), BOX, "rsa", count=4, seed=1)
    grey = 100.0 * to_image(packing, voxel_size=0.1, labels=False)
    packing_of_labels(segment(grey, threshold=50.0, voxel_size=0.1))


def settle_few(family: str) -> None:
    """Let a few grains settle, shaken, with friction and without, and prove that they rest."""
    shape = make_shape(family)
    box: Container = Rectangle((3, 4)) if shape.dimension == 2 else Box((2, 2, 4))
    bed = pack(shape, box, "gravity", count=4, seed=1, shaking={"duration": 1.0})
    equilibrium(bed)
    settle(bed, friction=0.0, fall_time=1.0, lid={"weight": 1.0})


def settle_many() -> None:
    """Let a few spheres settle as many do: contacts are visited in rounds, and rows and bodies are divided into blocks.

    The numbers from which on that is so are lowered meanwhile; no kernel reads them.
    """
    with patch.multiple(morton, MANY=1, LEAST=1), patch.object(projected_gradient, "MANY", 1):
        settle_few("sphere")


def deform_few() -> None:
    """Deform a few grains."""
    deform(pack(make_shape("solid_union"), Box((2, 2, 3)), "digital", count=4, seed=1, sweeps=50, settle=False))


def use_solids() -> None:
    """Keep, load, voxelize, repair and fit one solid."""
    solid = make_shape("solid_union")
    with TemporaryDirectory() as folder:
        save_shape(solid, f"{folder}/solid.obj")
        load_shape(f"{folder}/solid.obj")
    voxelize(solid, voxel_size=0.1)
    signed_distance(solid, voxel_size=0.1)
    repair(solid.vertices, solid.faces)
    fit_clump(solid, max_spheres=5)
    roughen(solid)


def make_few(family: str) -> None:
    """Make a shape of a family, and describe it."""
    describe(make_shape(family))


def _compute(task: Callable[[], None]) -> None:
    """Compute a scene; a method that does not pack such shapes has no kernels for them."""
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        try:
            task()
        except InputError:
            return


def _count() -> int:
    """Return how many compiled kernels the cache holds."""
    return sum(1 for _ in cache_folder().glob("*.kernel"))
