"""What the app shows of a packing: a scene of PyVista that is turned, cut and coloured, and the numbers of a grain."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.containers.model import Container
from voxgran.packing.model import Packing
from voxgran.report.colors import COLORS, Coloring, coloring, legend_of
from voxgran.report.creases import surface_of
from voxgran.report.force_chains import COLORS as SHADES
from voxgran.report.force_chains import add_chains, add_contacts
from voxgran.report.scenes import GRAIN_COLOR, SMOOTH, add_grain, add_grains, closeups_of
from voxgran.report.stage import (
    SMOOTHING,
    add_container,
    add_scale_bar,
    add_spheres,
    cut_beyond,
    keep_written,
    look_at,
    open_stage,
    stage_of,
)
from voxgran.shapes.model import Shape

#: size of the scene before a browser says its own
WINDOW = (900, 700)
#: largest width and height of the scene, in pixels
LARGEST = 8192
#: grains above which a bed that grows is drawn as spheres of their size, which are points
MANY = 300
#: about the largest number of triangles of a bed, which turns smoothly
TRIANGLES = 150_000
#: ways to draw a packing, and the beginning of those to draw the picked grain alone
GRAINS, CONTACTS, CHAINS, SPHERES, ALONE = "grains", "contacts", "force chains", "spheres", "picked grain: "
#: share of the height that is left free for a legend, and colour of the picked grain
BELOW, PICKED = 0.16, "#d1495b"


@dataclass(slots=True, eq=False)
class Look:
    """A scene with one packing or shape.

    Attributes
    ----------
    stage : pyvista.Plotter
        The scene.
    packing : Packing or None
        What it shows.
    picked : int or None
        The grain that was picked.
    """

    stage: Any = field(default_factory=lambda: open_stage(WINDOW))
    packing: Packing | None = None
    picked: int | None = None
    #: the camera of the packing while a grain is alone
    camera: Any = None
    #: the camera when it had framed the container
    framed: Any = None
    #: what the colours mean, with their map
    colors: tuple[Coloring, str] | None = None

    def __post_init__(self) -> None:
        self.stage.disable_anti_aliasing()
        keep_written(self.stage, self._write)
        window, resize = self.stage.render_window, self.stage.render_window.SetSize

        def resize_in_limits(*size: Any) -> None:
            wide, high = size if len(size) == 2 else size[0]
            resize(*(min(max(int(length), 0), LARGEST) for length in (wide, high)))

        # a browser says the size, and graphics end the process where there is no memory for it
        window.SetSize = resize_in_limits

    @contextlib.contextmanager
    def smooth(self) -> Iterator[None]:
        """Smooth the edges of what is drawn (context manager)."""
        if SMOOTHING:
            self.stage.enable_anti_aliasing(SMOOTHING)
        try:
            yield
        finally:
            self.stage.disable_anti_aliasing()

    def ways(self) -> list[str]:
        """Return in which ways the packing, and the grain that is picked, can be drawn."""
        packing, made = self.packing, [GRAINS]
        if packing is not None:
            made += [CONTACTS, CHAINS] if packing.forces is not None else [CONTACTS]
            if self.picked is not None:
                made += [ALONE + name for name in closeups_of(packing, self.picked)]
        return made

    def alone(self, way: str) -> tuple[list[Any], Floats] | None:
        """Return actors and vertices of the picked grain in one of :meth:`ways`, made in any thread; None in others."""
        if self.packing is None or self.picked is None or not way.startswith(ALONE):
            return None
        with stage_of((8, 8)) as stage:
            corners = closeups_of(self.packing, self.picked)[way.removeprefix(ALONE)](stage)
            return list(stage.actors.values()), corners

    def show(self, packing: Packing, *, color_by: str = "diameter", way: str = GRAINS, alone: Any = None) -> None:
        """Show a packing in its container in one of :meth:`ways`, or what :meth:`alone` has made, as it lies in it."""
        bounds, flat = packing.container.bounds, packing.dimension == 2
        fresh = self.packing is None or not np.array_equal(self.packing.container.bounds, bounds)
        if packing is not self.packing:
            self.packing, self.picked = packing, None
        # the page renders
        self.stage.suppress_rendering, self.colors = True, None
        self.stage.clear_actors()
        if alone is not None:
            self.camera = self.camera or self.stage.camera.copy()
            for actor in alone[0]:
                self.stage.add_actor(actor, reset_camera=False)
            look_at(self.stage, alone[1], flat=flat)
            return
        if way == CHAINS:
            force = add_chains(self.stage, packing)
            self.colors = None if force is None else (force, SHADES)
        elif way == CONTACTS:
            add_contacts(self.stage, packing)
        elif way == SPHERES:
            shades = np.full((packing.count, 3), 0.6)
            add_spheres(self.stage, np.asarray(packing.position), 0.5 * packing.diameters, shades)
        elif packing.count:
            self.colors = coloring(packing, color_by), COLORS
            add_grains(self.stage, packing, np.arange(packing.count), self.colors[0], TRIANGLES)
            if self.picked is not None:
                add_grain(self.stage, packing, self.picked, color=PICKED, larger=1.01)
        add_container(self.stage, packing.container)
        if fresh:
            self._frame(packing.container)
        elif self.camera is not None:
            self.stage.camera = self.camera
        self.camera = None

    def _frame(self, container: Container) -> None:
        """Frame a container with the camera."""
        look_at(self.stage, container.mesh()[0], flat=container.dimension == 2, below=BELOW)
        self.framed = self.seen()

    def seen(self) -> Any:
        """Return place and scale of the camera."""
        return self.stage.camera.position, self.stage.camera.parallel_scale

    def fit(self, share: float) -> None:
        """Keep in sight what was, in a window that is narrower by a factor; what nobody has turned is framed anew."""
        if self.packing is not None and self.seen() == self.framed:
            self._frame(self.packing.container)
        else:
            self.stage.camera.parallel_scale *= share

    def _write(self) -> None:
        """Write the scale, and what the colours mean."""
        if self.packing is not None:
            add_scale_bar(self.stage, self.packing.unit)
        if self.colors is not None:
            strip = legend_of(self.colors[0], tuple(self.stage.window_size), shades=self.colors[1])
            if strip is not None:
                strip.add_to(self.stage)

    def show_shapes(self, shapes: list[Shape]) -> None:
        """Show shapes in a row."""
        self.packing = self.picked = self.camera = self.colors = None
        self.stage.clear_actors()
        at, corners = 0.0, []
        for shape in shapes:
            mesh = surface_of(shape)
            low, high = np.reshape(mesh.bounds, (3, 2)).T
            mesh = mesh.translate((at - low[0], 0.0, 0.0))
            at += 1.15 * float(high[0] - low[0])
            self.stage.add_mesh(mesh, color=GRAIN_COLOR, **SMOOTH)
            corners.append(np.asarray(mesh.points))
        if corners:
            look_at(self.stage, np.concatenate(corners), flat=shapes[0].dimension == 2)

    def grain_at(self, across: float, down: float) -> int | None:
        """Return the grain at a place of the picture, in shares of its width and height; None where there is none."""
        if self.packing is None or not self.packing.count:
            return None
        wide, high = self.stage.window_size
        picker = load("vtkmodules.vtkRenderingCore").vtkCellPicker()
        picker.SetTolerance(0.002)
        picker.PickFromListOn()
        for actor in self.stage.renderer.actors.values():
            mapper = getattr(actor, "mapper", None)
            data = getattr(mapper, "dataset", None)
            if data is not None and ("grain" in data.cell_data or "radius" in data.point_data):
                picker.AddPickList(actor)
        if not picker.Pick(across * wide, (1 - down) * high, 0, self.stage.renderer):
            return None
        known = picker.GetDataSet().GetCellData().GetArray("grain")
        if known is not None:
            return int(known.GetValue(picker.GetCellId()))
        # many spheres are points
        away = np.linalg.norm(self.packing.position - picker.GetPickPosition(), axis=1)
        return int((away / self.packing.bounding_radii).argmin())

    def cut(self, shares: tuple[float, float, float]) -> None:
        """Cut what lies beyond planes across the axes, at shares of the container."""
        if self.packing is not None:
            closed = self.packing.dimension == 3 and not any(shape.is_open for shape in self.packing.shapes)
            cut_beyond(self.stage, self.packing.container.bounds, shares, closed=closed)
