"""What the app shows of a packing: a scene of PyVista that is turned, cut and coloured, and the numbers of a grain."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.packing.model import Packing
from voxgran.report.colors import COLOR_BY, coloring
from voxgran.report.creases import surface_of
from voxgran.report.force_chains import TUBES, force_tubes
from voxgran.report.legend import legend_of
from voxgran.report.scenes import GRAIN_COLOR, SMOOTH, add_grains
from voxgran.report.stage import add_container, add_scale_bar, add_spheres, look_at, open_stage
from voxgran.shapes.model import Shape

#: size of the scene before a browser says its own
WINDOW = (900, 700)
#: grains above which a bed that grows is drawn as points
MANY = 300


def colors_of(packing: Packing | None) -> list[str]:
    """Return what the grains of a packing can be coloured by."""
    known = packing is not None and packing.forces is not None
    return [name for name in COLOR_BY if known or name != "force"]


@dataclass(slots=True, eq=False)
class Look:
    """A scene with one packing or shape.

    Attributes
    ----------
    stage : pyvista.Plotter
        The scene.
    packing : Packing or None
        What it shows.
    """

    stage: Any = field(default_factory=lambda: open_stage(WINDOW))
    packing: Packing | None = None

    def show(self, packing: Packing, *, color_by: str = "diameter", forces: bool = False) -> None:
        """Show a packing in its container, or in place of its grains the forces between them."""
        fresh = self.packing is None or self.packing.container is not packing.container
        self.packing = packing
        self.stage.clear_actors()
        colors = coloring(packing, color_by)
        tubes = force_tubes(packing) if forces else None
        if tubes is not None:
            self.stage.add_mesh(tubes[0], **TUBES)
        elif packing.count:
            add_grains(self.stage, packing, np.arange(packing.count), colors)
        add_container(self.stage, packing.container)
        add_scale_bar(self.stage, packing.unit)
        strip = legend_of(colors, tuple(self.stage.window_size)) if packing.count else None
        if strip is not None and tubes is None:
            strip.add_to(self.stage)
        if fresh:
            look_at(self.stage, packing.container.mesh()[0], flat=packing.dimension == 2)

    def show_growing(self, packing: Packing) -> None:
        """Show a packing that is computed: many grains as spheres of their size, which are drawn as points."""
        if packing.count <= MANY:
            self.show(packing)
            return
        fresh, self.packing = self.packing is None, packing
        self.stage.clear_actors()
        shades = np.full((packing.count, 3), 0.6)
        add_spheres(self.stage, np.asarray(packing.position), 0.5 * packing.diameters, shades)
        add_container(self.stage, packing.container)
        if fresh:
            look_at(self.stage, packing.container.mesh()[0], flat=packing.dimension == 2)

    def show_shapes(self, shapes: list[Shape]) -> None:
        """Show shapes in a row."""
        self.packing = None
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
        if self.packing is None:
            return
        low, high = self.packing.container.bounds
        planes = load("vtkmodules.vtkCommonDataModel").vtkPlaneCollection()
        for axis, share in enumerate(shares[: len(low)]):
            if share < 1:
                plane = load("vtkmodules.vtkCommonDataModel").vtkPlane()
                origin = np.zeros(3)
                origin[axis] = low[axis] + share * (high[axis] - low[axis])
                plane.SetOrigin(*origin)
                plane.SetNormal(*(-1.0 if k == axis else 0.0 for k in range(3)))
                planes.AddItem(plane)
        for actor in self.stage.renderer.actors.values():
            mapper = getattr(actor, "mapper", None)
            if mapper is not None and hasattr(mapper, "SetClippingPlanes"):
                mapper.SetClippingPlanes(planes)


def numbers_of(packing: Packing, grain: int) -> dict[str, str]:
    """Return the numbers of a grain, as a page shows them."""
    told = {
        "grain": str(grain),
        "shape": str(packing.shapes[packing.shape_id[grain]].name),
        "equivalent diameter": f"{packing.diameters[grain]:.5g}",
        "centroid": _point(packing.position[grain]),
        "neighbours": str(int((packing.contacts().i == grain).sum() + (packing.contacts().j == grain).sum())),
    }
    if packing.forces is not None:
        told["largest force"] = f"{packing.forces.largest_force()[grain]:.4g} {packing.forces.unit}"
        told["residual"] = f"{packing.forces.residual[grain]:.2g}"
    return told


def _point(point: Floats) -> str:
    """Return coordinates as text."""
    return ", ".join(f"{value:.4g}" for value in point)
