"""Close-up of contacts: one grain among its neighbours, with the contact points."""

from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.containers.model import periods_of
from voxgran.measures.registered.coordination import WIDEST_GAP, mean_diameter
from voxgran.packing.model import Packing
from voxgran.report.creases import creased, shaded
from voxgran.report.stage import MATERIAL, Picture, add_scale_bar, beads, look_at, shot, stage_of

_MIDDLE, _NEIGHBOUR, _POINT = "#2a9d8f", "#b9c3ca", "#d1495b"


def picture_contacts(packing: Packing, *, window: tuple[int, int] = (900, 900)) -> Picture | None:
    """Draw the grain with the most neighbours, these translucent, and the contact points; None if no two grains are
    close.
    """
    found = packing.contacts(WIDEST_GAP * mean_diameter(packing)) if packing.count else None
    if found is None or not found.count:
        return None
    grain = _busiest(packing, found.i, found.j)
    first, second = found.i == grain, (found.j == grain) & (found.i != grain)
    periods = periods_of(packing.container)
    others = np.concatenate([found.j[first], found.i[second]])
    shift = np.concatenate([found.image[first], -found.image[second]]) @ periods
    points = np.concatenate([found.point[first], found.point[second] - found.image[second] @ periods])
    extent = []
    with stage_of(window) as stage:
        extent.append(_add_grain(stage, packing, grain, np.zeros(3), color=_MIDDLE, opacity=1.0))
        for other, way in zip(others.tolist(), shift, strict=True):
            extent.append(_add_grain(stage, packing, other, way, color=_NEIGHBOUR, opacity=0.45))
        # visible through objects in front of them
        stage.add_mesh(beads(points, 0.04 * float(packing.diameters[grain]), 2), color=_POINT, **MATERIAL)
        stage.enable_depth_peeling(8)
        look_at(stage, np.concatenate(extent), flat=packing.dimension == 2)
        add_scale_bar(stage, packing.unit)
        return shot(stage)


def _busiest(packing: Packing, i: Integers, j: Integers) -> int:
    """Return the grain with the most neighbours; among several, the one nearest to the center."""
    count = np.bincount(np.concatenate([i, j]), minlength=packing.count)
    most = np.flatnonzero(count == count.max())
    middle = packing.container.bounds.mean(axis=0)
    return int(most[np.linalg.norm(packing.position[most] - middle, axis=1).argmin()])


def _add_grain(stage: Any, packing: Packing, grain: int, shift: Floats, *, color: str, opacity: float) -> Floats:
    """Draw a periodic image of a grain; return its vertices."""
    shape = packing.shapes[packing.shape_id[grain]]
    corners, faces = creased(shape, shape.vertices, shape.faces)
    turned = corners @ packing.matrices[grain].T * packing.scale[grain]
    vertices: Floats = turned + packing.position[grain] + shift
    stage.add_mesh(shaded(vertices, faces), color=color, opacity=opacity, smooth_shading=True, **MATERIAL)
    return vertices
