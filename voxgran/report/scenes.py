"""Pictures of packings and grains, rendered off screen with PyVista.

The lightness of the colours increases evenly (viridis). Each function returns the picture as an (h, w, 3) array of
bytes. Grains of many triangles are simplified, see :func:`picture_faces`.

Close-ups of one grain show it among its neighbours with the contact points, and alone as it lies there, with its
numbers.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.clumps.fit import fit_clump
from voxgran.contacts.model import Contacts
from voxgran.contacts.surfaces import merged_surfaces
from voxgran.containers.kinds.box import Box
from voxgran.containers.model import periods_of
from voxgran.measures.describe import describe
from voxgran.measures.registered.coordination import WIDEST_GAP, mean_diameter, touching_contacts
from voxgran.packing.model import Packing
from voxgran.points.sample import sample_surface
from voxgran.report.colors import COLORS, Coloring, coloring, colors_of, legend_of
from voxgran.report.creases import creased, shaded, surface_of, vertex_normals
from voxgran.report.facts import Fact, number
from voxgran.report.figures import FORM
from voxgran.report.stage import (
    MATERIAL,
    Picture,
    add_container,
    add_outlines,
    add_scale_bar,
    add_spheres,
    beads,
    look_at,
    shot,
    stage_of,
    view_axes,
)
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import sphere
from voxgran.voxels.occupy import voxelize

#: approximate largest number of triangles in a picture of a packing
TRIANGLE_BUDGET = 600_000
#: smallest number of triangles to which a grain is simplified
FEWEST_FACES = 80
#: number of spheres above which they are drawn as shaded points
MOST_SPHERES = 10_000
#: number of grains of the middle that are drawn beside them
MIDDLE = 3_000
#: number of grains above which faces are flat: a grain is a few pixels wide, and normals take longer than the picture
FLAT_LIMIT = 5_000

GRAIN_COLOR = "#6d9fb5"
#: look of surfaces with normals
SMOOTH = {"smooth_shading": True, **MATERIAL}
#: colours of the outlines of flat grains that are dark, and of those that are bright
OUTLINES = ("#dfe5ea", "#22303a")


def picture_faces(packing: Packing, triangles: int | None = None) -> int:
    """Return the largest number of triangles of a grain in a picture of about so many, usually the budget."""
    return max(FEWEST_FACES, (triangles or TRIANGLE_BUDGET) // max(packing.count, 1))


def picture_packing(
    packing: Packing,
    *,
    color_by: str = "diameter",
    window: tuple[int, int] = (900, 900),
    turn: float = 0.0,
    legend: bool = True,
) -> Picture:
    """Draw the whole packing, coloured as by :func:`coloring` (dark is small, bright is large), seen from an angle
    around the vertical axis, in degrees; the window is in pixels. A legend says what the colours mean.

    Raises
    ------
    InputError
        If `color_by` is unknown, or it is "force" or "residual" and no forces are known.
    """
    return _picture(packing, np.arange(packing.count), coloring(packing, color_by), window, turn=turn, legend=legend)


def picture_cut(
    packing: Packing, *, color_by: str = "diameter", window: tuple[int, int] = (900, 900), legend: bool = True
) -> Picture:
    """Draw the packing without the grains whose centroids lie in the quarter that faces the viewer; in 2D all grains.

    Raises
    ------
    InputError
        If `color_by` is unknown, or it is "force" or "residual" and no forces are known.
    """
    middle = packing.container.bounds.mean(axis=0)
    near = (packing.position[:, 0] > middle[0]) & (packing.position[:, 1] < middle[1])
    kept = np.flatnonzero(~near | (packing.dimension == 2))
    return _picture(packing, kept, coloring(packing, color_by), window, legend=legend)


def middle_of(packing: Packing) -> Packing:
    """Return the grains of a cube in the middle of a large packing, of which so many are seen as surfaces."""
    middle = np.median(packing.position, axis=0)
    away = np.abs(packing.position - middle).max(axis=1)
    kept = np.sort(np.argpartition(away, min(MIDDLE, packing.count - 1))[:MIDDLE])
    half = float(away[kept].max() + packing.bounding_radii[kept].max())
    cube = Box((2.0 * half,) * 3, origin=middle - half)
    return replace(replace(packing, forces=None)[kept], container=cube, gravity=None, lid=None)


def picture_grain(shape: Shape, *, window: tuple[int, int] = (400, 300), spheres: int = 30) -> dict[str, Picture]:
    """Draw a shape, its voxels, its control points and its clump from the same side.

    Return pictures under ``surface``, ``voxels``, ``points`` and ``clump``; in 2D there is no clump, and for an open
    surface neither voxels nor a clump. The window of each is in pixels; `spheres` is the largest number of spheres of
    the clump.
    """
    pictures = {}
    with stage_of(window) as stage:
        look_at(stage, 1.06 * shape.vertices, flat=shape.dimension == 2)
        for name, draw in drawings_of(shape, spheres).items():
            # what is added to a stage that was shown is rendered otherwise
            stage.suppress_rendering = True
            stage.clear_actors()
            draw(stage)
            pictures[name] = shot(stage)
    return pictures


def drawings_of(shape: Shape, spheres: int = 30) -> dict[str, Callable[[Any], Any]]:
    """Return the functions that draw a shape on a stage, by what they draw, as :func:`picture_grain` says."""
    made: dict[str, Callable[[Any], Any]] = {
        "surface": lambda stage: stage.add_mesh(surface_of(shape), color=GRAIN_COLOR, **SMOOTH),
        "voxels": partial(_add_voxels, shape=shape),
        "points": partial(_add_points, shape=shape),
        "clump": partial(_add_clump, shape=shape, spheres=spheres),
    }
    absent = {"voxels", "clump"} if shape.is_open else {"clump"} if shape.dimension == 2 else set()
    return {name: draw for name, draw in made.items() if name not in absent}


def _picture(
    packing: Packing,
    grains: Integers,
    colors: Coloring,
    window: tuple[int, int],
    *,
    turn: float = 0.0,
    legend: bool = True,
) -> Picture:
    """Draw some grains, the container, a scale bar and a legend."""
    strip = legend_of(colors, window) if legend else None
    with stage_of(window) as stage:
        add_grains(stage, packing, grains, colors, uncut=True)
        add_container(stage, packing.container)
        below, flat = 0.0 if strip is None else strip.height, packing.dimension == 2
        look_at(stage, packing.container.mesh()[0], flat=flat, turn=turn, below=below)
        add_scale_bar(stage, packing.unit)
        if strip is not None:
            strip.add_to(stage)
        return shot(stage)


def add_grains(
    stage: Any,
    packing: Packing,
    grains: Integers,
    colors: Coloring,
    triangles: int | None = None,
    *,
    uncut: bool = False,
) -> None:
    """Draw some grains of a packing: as surfaces, or as shaded points where there are very many spheres.

    Where no plane will cut them (`uncut`), the insides of surfaces are left out, which takes a quarter less time.
    """
    low, high = colors.limits
    round_ones = np.array([*(shape.is_sphere and shape.dimension == 3 for shape in packing.shapes), False])
    spheres = round_ones[packing.shape_id[grains]]
    as_points = grains[spheres] if spheres.sum() > MOST_SPHERES else grains[:0]
    as_meshes = np.setdiff1d(grains, as_points)
    if len(as_meshes):
        _add_meshes(stage, packing, as_meshes, colors, picture_faces(packing, triangles), uncut=uncut)
    if len(as_points):
        shades = load("matplotlib").colormaps[COLORS]((colors.values[as_points] - low) / (high - low))[:, :3]
        add_spheres(stage, packing.position[as_points], packing.bounding_radii[as_points], shades)


def _add_meshes(stage: Any, packing: Packing, grains: Integers, colors: Coloring, most: int, *, uncut: bool) -> None:
    """Draw grains as surfaces, flat ones with outlines."""
    many, flat = len(grains) > FLAT_LIMIT, packing.dimension == 2
    bodies = [drawn_surface(shape, most) for shape in packing.shapes]
    if not many:
        bodies = [creased(shape, *body) for shape, body in zip(packing.shapes, bodies, strict=True)]
    merged = merged_surfaces(packing, grains=grains, bodies=bodies)
    if many or flat:
        mesh = load("pyvista").PolyData.from_regular_faces(merged.vertices, merged.faces)
    else:
        # those of each shape, turned: grains share few shapes
        kind = packing.shape_id[grains]
        turns = {int(s): packing.matrices[grains[kind == s]] for s in np.unique(kind)}
        turned = [np.einsum("gij,vj->gvi", turn, vertex_normals(*bodies[s])) for s, turn in turns.items()]
        mesh = shaded(merged.vertices, merged.faces, np.concatenate([part.reshape(-1, 3) for part in turned]))
    mesh.cell_data["value"] = colors.values[merged.grain]
    mesh.cell_data["grain"] = merged.grain
    # the insides of closed surfaces are not seen; some triangles of reduced ones are turned, which shows on grains of
    # more than a few pixels
    closed = not flat and not any(shape.is_open for shape in packing.shapes)
    look = {"scalars": "value", "clim": colors.limits, "show_scalar_bar": False}
    whole = uncut and all(shape.is_sphere or len(shape.faces) <= most for shape in packing.shapes)
    culling = "back" if closed and (many or whole) else None
    stage.add_mesh(mesh, cmap=COLORS, culling=culling, **look, **(MATERIAL if many or flat else SMOOTH))
    if flat and not many:
        # grains of one colour that touch would be one
        add_outlines(stage, mesh, cmap=list(OUTLINES), **look)


def drawn_surface(shape: Shape, most: int) -> tuple[Floats, Integers]:
    """Return the surface of a shape with at most so many triangles.

    Vertices are clustered with quadric error metrics (Lindstrom 2000, doi:10.1145/344779.344912), which takes a tenth
    of the time of edge collapses; packings of hundreds of different shapes are common.
    """
    if shape.is_sphere and shape.dimension == 3:
        level = int(np.clip(np.log(most / 20) / np.log(4) + 1e-9, 0, 4))
        vertices, faces, _ = sphere(level)
        return vertices * shape.bounding_radius, faces
    vertices, faces = shape.vertices, shape.faces
    divisions = int(np.sqrt(most / 5)) + 1
    while len(faces) > most and divisions > 2 and shape.dimension == 3:
        cluster = load("vtkmodules.vtkFiltersCore").vtkQuadricClustering()
        cluster.SetInputData(shape.to_pyvista())
        cluster.AutoAdjustNumberOfDivisionsOff()
        cluster.SetNumberOfDivisions(divisions, divisions, divisions)
        cluster.Update()
        coarse = load("pyvista").wrap(cluster.GetOutput())
        vertices, faces = np.array(coarse.points, dtype=np.float64), coarse.regular_faces.astype(np.int64)
        divisions = divisions * 7 // 8
    return vertices, faces


def _add_voxels(stage: Any, shape: Shape) -> None:
    """Draw voxels of 1/24 of the diameter."""
    voxels = voxelize(shape, voxel_size=shape.diameter / 24)
    image = load("pyvista").ImageData(
        dimensions=tuple(n + 1 for n in voxels.mask.shape),
        spacing=(voxels.voxel_size,) * 3,
        origin=tuple(float(value) for value in voxels.origin),
    )
    image.cell_data["solid"] = voxels.mask.ravel(order="F").astype(np.uint8)
    solid = image.threshold(0.5, scalars="solid")
    stage.add_mesh(solid, color=GRAIN_COLOR, show_edges=True, edge_color="#46626f", line_width=0.6, **MATERIAL)


def _add_points(stage: Any, shape: Shape) -> None:
    """Draw control points with a spacing of a tenth of the diameter, on the translucent surface."""
    points = np.asarray(sample_surface(shape, spacing=shape.diameter / 10))
    stage.add_mesh(surface_of(shape), color="#d7dee3", **SMOOTH)
    stage.add_mesh(beads(points, 0.018 * shape.diameter, 1), color="#2f4b7c", **MATERIAL)


def _add_clump(stage: Any, shape: Shape, spheres: int) -> None:
    """Draw the clump of a shape, large spheres bright."""
    clump = fit_clump(shape, max_spheres=spheres)
    mesh = beads(clump.centers, clump.radii, 3)
    mesh.cell_data["radius"] = np.repeat(clump.radii, mesh.n_cells // len(clump.radii))
    limits = (0.0, float(clump.radii.max()))
    stage.add_mesh(mesh, scalars="radius", cmap=COLORS, clim=limits, show_scalar_bar=False, **SMOOTH)


_MIDDLE, _NEIGHBOUR, _POINT = "#2a9d8f", "#b9c3ca", "#d1495b"


def picture_contacts(packing: Packing, *, window: tuple[int, int] = (900, 900)) -> Picture | None:
    """Draw the grain with the most neighbours, these translucent, and the contact points; None if no two grains are
    close.
    """
    found = packing.contacts(WIDEST_GAP * mean_diameter(packing)) if packing.count else None
    if found is None or not found.count:
        return None
    with stage_of(window) as stage:
        corners = add_neighbours(stage, packing, _busiest(packing, found.i, found.j), found)
        look_at(stage, corners, flat=packing.dimension == 2)
        add_scale_bar(stage, packing.unit)
        return shot(stage)


def add_neighbours(stage: Any, packing: Packing, grain: int, found: Contacts) -> Floats:
    """Draw a grain, its partners in some contacts, translucent, and the contact points; return all vertices (n, 3)."""
    first, second = found.i == grain, (found.j == grain) & (found.i != grain)
    periods = periods_of(packing.container)
    others = np.concatenate([found.j[first], found.i[second]])
    shift = np.concatenate([found.image[first], -found.image[second]]) @ periods
    # those behind first: what is translucent is mixed with what is drawn already
    order = np.argsort((packing.position[others] + shift) @ view_axes(flat=packing.dimension == 2)[2])
    points = np.concatenate([found.point[first], found.point[second] - found.image[second] @ periods])
    extent = [add_grain(stage, packing, grain, color=_MIDDLE)]
    for other, way in zip(others[order].tolist(), shift[order], strict=True):
        extent.append(add_grain(stage, packing, other, color=_NEIGHBOUR, opacity=0.45, shift=way))
    if len(points):
        # visible through objects in front of them
        stage.add_mesh(beads(points, 0.04 * float(packing.diameters[grain]), 2), color=_POINT, **MATERIAL)
    return np.concatenate(extent)


def _busiest(packing: Packing, i: Integers, j: Integers) -> int:
    """Return the grain with the most neighbours; among several, the one nearest to the center."""
    count = np.bincount(np.concatenate([i, j]), minlength=packing.count)
    most = np.flatnonzero(count == count.max())
    middle = packing.container.bounds.mean(axis=0)
    return int(most[np.linalg.norm(packing.position[most] - middle, axis=1).argmin()])


def add_grain(
    stage: Any, packing: Packing, grain: int, *, color: str, opacity: float = 1.0, larger: float = 1.0, shift: Any = 0.0
) -> Floats:
    """Draw a grain as it lies, larger by a factor, or a periodic image of it; return its vertices."""
    shape = packing.shapes[packing.shape_id[grain]]
    corners, faces = creased(shape, shape.vertices, shape.faces)
    turned = corners @ packing.matrices[grain].T * (larger * packing.scale[grain])
    vertices: Floats = turned + packing.position[grain] + shift
    vertices[:, 2] += (larger - 1.0) * shape.diameter * packing.scale[grain]
    # triangles of the far side would be drawn before and after triangles of the near side
    culling = "back" if opacity < 1 and shape.dimension == 3 and not shape.is_open else None
    look = {"opacity": opacity, "culling": culling, "smooth_shading": True, **MATERIAL}
    mesh = shaded(vertices, faces)
    mesh.cell_data["grain"] = np.full(len(faces), grain)
    stage.add_mesh(mesh, color=color, **look)
    return vertices


def closeups_of(packing: Packing, grain: int) -> dict[str, Callable[[Any], Floats]]:
    """Return the functions that draw a grain alone on a stage, by what they draw: as :func:`drawings_of` says, at its
    place and turned as it lies, and ``"neighbours"``, the grain with those that touch it. Each returns vertices (n, 3).
    """
    shape, pose = packing.shapes[packing.shape_id[grain]], np.eye(4)
    pose[:3] = np.column_stack([packing.scale[grain] * packing.matrices[grain], packing.position[grain]])

    def placed(stage: Any, draw: Callable[[Any], Any]) -> Floats:
        draw(stage)
        for actor in stage.actors.values():
            actor.user_matrix = pose
        return np.asarray(shape.vertices @ pose[:3, :3].T + pose[:3, 3])

    made = {name: partial(placed, draw=draw) for name, draw in drawings_of(shape).items()}
    return made | {"neighbours": lambda stage: add_neighbours(stage, packing, grain, touching_contacts(packing))}


def numbers_of_grain(packing: Packing, grain: int) -> list[Fact]:
    """Return the numbers of a grain: its place, what grains are coloured by, and its form."""
    place = ", ".join(f"{value:.4g}" for value in packing.position[grain])
    told = [Fact("grain", str(grain)), Fact("centroid", place)]
    for name in colors_of(packing):
        shown = coloring(packing, name)
        value = float(shown.values[grain])
        told.append(Fact(shown.title, shown.names.get(value, number(value))))
    form = describe(packing.shapes[packing.shape_id[grain]], FORM)
    return told + [Fact(str(name), number(float(values[0]))) for name, values in form.items()]
