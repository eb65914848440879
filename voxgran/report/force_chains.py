"""Picture of the force chains: contacts as tubes from centroid to centroid, as thick as their forces."""

from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.contacts.forces import chain_ends
from voxgran.packing.model import Packing
from voxgran.report.colors import Coloring
from voxgran.report.legend import legend_of
from voxgran.report.stage import MATERIAL, Picture, add_container, add_outlines, add_scale_bar, look_at, shot, stage_of

#: colours from weak to strong forces; the weakest differ from the background
COLORS = "viridis_r"
#: radius of the tube of the largest forces, in median diameters; that of the others is in proportion to the force
THICKEST = 0.2
#: share of the contacts with smaller forces than those that count as largest: a few may be far larger than all others
LARGEST = 0.99
#: smallest radius, as a share of the thickest one
THINNEST = 0.03
#: sides of a tube, and largest number of tubes: the weakest are left out
SIDES, MOST = 10, 60_000

#: how tubes are drawn
TUBES = {"scalars": "strength", "cmap": COLORS, "clim": (0.0, 1.0), "show_scalar_bar": False, **MATERIAL}

_GRAIN, _OUTLINE = "#d3dae0", "#aab5be"


def picture_forces(packing: Packing, *, window: tuple[int, int] = (900, 900)) -> Picture | None:
    """Draw the contacts that carry a force as tubes with radii in proportion to it, in 2D in front of the grains.

    Bright is weak and dark is strong. A tube runs between the centroids of the two grains, at a wall or the lid to the
    contact point; at periodic sides it leaves the container. The largest hundredth have the colour of the end of the
    colour bar. Return None where no forces are known or none is carried.
    """
    found = force_tubes(packing)
    if found is None or packing.forces is None:
        return None
    mesh, limit = found
    strip = legend_of(Coloring(np.array([0.0, limit]), "contact force", packing.forces.unit), window, shades=COLORS)
    flat = packing.dimension == 2
    with stage_of(window) as stage:
        if flat:
            # behind the tubes, which lie in the plane
            grains = packing.to_pyvista().translate((0.0, 0.0, -float(packing.diameters.max())))
            stage.add_mesh(grains, color=_GRAIN, lighting=False)
            add_outlines(stage, grains, color=_OUTLINE)
        stage.add_mesh(mesh, **TUBES)
        add_container(stage, packing.container)
        look_at(stage, packing.container.mesh()[0], flat=flat, below=0.0 if strip is None else strip.height)
        add_scale_bar(stage, packing.unit)
        if strip is not None:
            strip.add_to(stage)
        return shot(stage)


def force_tubes(packing: Packing) -> tuple[Any, float] | None:
    """Return the contacts that carry a force as tubes, with a strength from 0 to 1, and the force of strength 1; None
    where no forces are known or none is carried.
    """
    forces = packing.forces
    if forces is None or not forces.carries.any():
        return None
    kept = np.flatnonzero(forces.carries)
    kept = kept[np.argsort(-forces.magnitude[kept], kind="stable")][:MOST]
    start, end = (ends[kept] for ends in chain_ends(packing, forces))
    force = forces.magnitude[kept]
    limit = float(np.quantile(force, LARGEST))
    strength = np.minimum(force / limit, 1.0)
    radius = THICKEST * float(np.median(packing.diameters)) * np.maximum(strength, THINNEST)
    vertices, faces = tubes(start, end, radius)
    mesh = load("pyvista").PolyData.from_regular_faces(vertices, faces)
    mesh.cell_data["strength"] = np.repeat(strength, len(faces) // len(force))
    return mesh, limit


def tubes(start: Floats, end: Floats, radius: Floats) -> tuple[Floats, Integers]:
    """Return closed prisms from start (m, 3) to end (m, 3) with radii (m,) as vertices and triangles, all with the same
    number of triangles.
    """
    along = end - start
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    # across the axis to which the tube is least parallel
    least = np.eye(3)[np.abs(along).argmin(axis=1)]
    first = np.cross(along, least)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-300)
    second = np.cross(along, first)
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    ring *= radius[:, None, None]
    vertices = np.concatenate([start[:, None] + ring, end[:, None] + ring], axis=1)
    k = np.arange(SIDES)
    after = (k + 1) % SIDES
    fan = np.arange(1, SIDES - 1)
    faces = np.concatenate(
        [
            np.column_stack([k, after, after + SIDES]),
            np.column_stack([k, after + SIDES, k + SIDES]),
            np.column_stack([np.zeros_like(fan), fan + 1, fan]),
            SIDES + np.column_stack([np.zeros_like(fan), fan, fan + 1]),
        ]
    )
    shifts = 2 * SIDES * np.arange(len(start))
    return vertices.reshape(-1, 3), (faces[None] + shifts[:, None, None]).reshape(-1, 3)
