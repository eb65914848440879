"""Close-ups of one grain: among its neighbours with the contact points, alone as it lies there, and its numbers."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.contacts.model import Contacts
from voxgran.containers.model import periods_of
from voxgran.measures.describe import describe
from voxgran.measures.registered.coordination import WIDEST_GAP, mean_diameter, touching_contacts
from voxgran.packing.model import Packing
from voxgran.report.colors import coloring, colors_of
from voxgran.report.creases import creased, shaded
from voxgran.report.facts import Fact, number
from voxgran.report.figures import FORM
from voxgran.report.scenes import drawings_of
from voxgran.report.stage import MATERIAL, Picture, add_scale_bar, beads, look_at, shot, stage_of, view_axes

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
    # triangles of the far side would be mixed in before and after those of the near side
    culling = "back" if opacity < 1 and shape.dimension == 3 and not shape.is_open else None
    look = {"opacity": opacity, "culling": culling, "smooth_shading": True, **MATERIAL}
    stage.add_mesh(shaded(vertices, faces), color=color, **look)
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
