"""Contacts as tubes from centroid to centroid: force chains, as thick as the forces, and rods between neighbours."""

from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.contacts.forces import chain_ends
from voxgran.containers.model import periods_of
from voxgran.measures.registered.coordination import touching_contacts
from voxgran.packing.model import Packing
from voxgran.report.colors import Coloring, legend_of
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
#: radius of a rod, in median diameters, and sides of rods of which there are more
ROD, FEWEST_SIDES = 0.06, 3

_GRAIN, _OUTLINE, _ROD = "#d3dae0", "#aab5be", "#2f6f8f"


def picture_forces(packing: Packing, *, window: tuple[int, int] = (900, 900)) -> Picture | None:
    """Draw the contacts that carry a force as tubes with radii in proportion to it, in 2D in front of the grains.

    Bright is weak and dark is strong. A tube runs between the centroids of the two grains, at a wall or the lid to the
    contact point; at periodic sides it leaves the container. The largest hundredth have the colour of the end of the
    colour bar. Return None where no forces are known or none is carried.
    """
    flat = packing.dimension == 2
    with stage_of(window) as stage:
        colors = add_chains(stage, packing)
        if colors is None:
            return None
        strip = legend_of(colors, window, shades=COLORS)
        add_container(stage, packing.container)
        look_at(stage, packing.container.mesh()[0], flat=flat, below=0.0 if strip is None else strip.height)
        add_scale_bar(stage, packing.unit)
        if strip is not None:
            strip.add_to(stage)
        return shot(stage)


def add_chains(stage: Any, packing: Packing) -> Coloring | None:
    """Draw the contacts that carry a force as tubes, in 2D in front of the grains; return what the colours of
    :data:`COLORS` mean, None where no forces are known or none is carried.
    """
    found, forces = force_tubes(packing), packing.forces
    if found is None or forces is None:
        return None
    mesh, limit = found
    _add_behind(stage, packing)
    stage.add_mesh(mesh, scalars="strength", cmap=COLORS, clim=(0.0, 1.0), show_scalar_bar=False, **MATERIAL)
    return Coloring(np.array([0.0, limit]), "contact force", forces.unit)


def add_contacts(stage: Any, packing: Packing) -> None:
    """Draw rods between the centroids of grains that touch, in 2D in front of the grains.

    At periodic sides a rod leaves the container.
    """
    found = touching_contacts(packing)
    _add_behind(stage, packing)
    if found.count:
        start, end = packing.position[found.i], packing.position[found.j] + found.image @ periods_of(packing.container)
        radius = np.full(found.count, ROD * float(np.median(packing.diameters)))
        body = tubes(start, end, radius, sides=SIDES if found.count <= MOST else FEWEST_SIDES)
        stage.add_mesh(load("pyvista").PolyData.from_regular_faces(*body), color=_ROD, **MATERIAL)


def _add_behind(stage: Any, packing: Packing) -> None:
    """Draw the grains of a packing in 2D behind the rods, which lie in the plane."""
    if packing.dimension == 2 and packing.count:
        grains = packing.to_pyvista().translate((0.0, 0.0, -float(packing.diameters.max())))
        stage.add_mesh(grains, color=_GRAIN, lighting=False)
        add_outlines(stage, grains, color=_OUTLINE)


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


def tubes(start: Floats, end: Floats, radius: Floats, *, sides: int = SIDES) -> tuple[Floats, Integers]:
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
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    ring *= radius[:, None, None]
    vertices = np.concatenate([start[:, None] + ring, end[:, None] + ring], axis=1)
    k = np.arange(sides)
    after = (k + 1) % sides
    fan = np.arange(1, sides - 1)
    faces = np.concatenate(
        [
            np.column_stack([k, after, after + sides]),
            np.column_stack([k, after + sides, k + sides]),
            np.column_stack([np.zeros_like(fan), fan + 1, fan]),
            sides + np.column_stack([np.zeros_like(fan), fan, fan + 1]),
        ]
    )
    shifts = 2 * sides * np.arange(len(start))
    return vertices.reshape(-1, 3), (faces[None] + shifts[:, None, None]).reshape(-1, 3)
