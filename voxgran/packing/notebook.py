"""What a notebook shows of a packing: a small picture and the main numbers."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.contacts.assembly import Assembly
from voxgran.packing.model import Packing
from voxgran.shapes.thumbnail import EDGE, FINE, card, image_tag, picture, surface_samples

#: triangles up to which grains are drawn with their own surfaces; more are drawn as spheres
MOST_TRIANGLES = 1_500_000
#: points of one sphere at least and at most
FEWEST, MOST_POINTS = 40, 4000
#: dark, middle and light end of the colours, small to large
RAMP = np.array([[0.23, 0.32, 0.55], [0.13, 0.57, 0.55], [0.93, 0.85, 0.25]])


def packing_card(packing: Packing) -> str:
    """Return a small picture of a packing and its numbers, as HTML."""
    names = ", ".join(shape.name for shape in packing.shapes[:4]) + (" ..." if len(packing.shapes) > 4 else "")
    unit = "" if packing.unit == "1" else f" {packing.unit}"
    axes = ", ".join(axis for axis, wraps in zip("xyz", packing.container.periodic, strict=True) if wraps)
    rows = {
        "packing": f"{packing.count} grains of {len(packing.shapes)} shapes: {names}",
        "solid fraction": f"{packing.solid_fraction:.4f}",
        "method": str(packing.provenance.get("method", "not known")),
        "stopped": packing.stop_reason,
        "container": packing.container.kind + (f", periodic in {axes}" if axes else ""),
    }
    if packing.count:
        low, high = packing.diameters.min(), packing.diameters.max()
        rows["equivalent diameter"] = f"{low:.4g} to {high:.4g}{unit}"
    image = image_tag(packing_picture(packing), "the grains, by size") if packing.count else ""
    return card(image, rows)


def packing_picture(packing: Assembly) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    """Draw grains, coloured by size: with their own surfaces, or as spheres of equal volume where there are many.

    Parameters
    ----------
    packing : Packing or Assembly
        At least one grain.

    Returns
    -------
    (160, 160, 4) ndarray of uint8
        Red, green, blue and opacity.
    """
    faces = np.array([len(shape.faces) for shape in packing.shapes])[packing.shape_id]
    extent = float(np.ptp(packing.position, axis=0).max() + packing.diameters.max())
    spacing = extent / (FINE * EDGE)
    many = int(faces.sum()) > MOST_TRIANGLES
    points, normals, owner = _spheres(packing, spacing) if many else _surfaces(packing, spacing)
    size = packing.diameters
    share = (size - size.min()) / max(float(np.ptp(size)), 1e-300) if np.ptp(size) else np.full(len(size), 0.5)
    ends = np.array([0.0, 0.5, 1.0])
    colors = np.column_stack([np.interp(share, ends, RAMP[:, c]) for c in range(3)])
    return picture(points, normals, colors[owner], flat=packing.dimension == 2)


def _surfaces(packing: Assembly, spacing: float) -> tuple[Floats, Floats, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Return points, normals and grain on the surfaces of all grains."""
    points, normals, owner = [], [], []
    for index in np.unique(packing.shape_id):
        members, shape = np.flatnonzero(packing.shape_id == index), packing.shapes[index]
        fine = spacing / float(packing.scale[members].max())
        body, outward = surface_samples(shape.vertices[shape.faces], fine)
        matrices = packing.matrices[members]
        placed = np.einsum("gij,pj->gpi", matrices * packing.scale[members, None, None], body)
        points.append((placed + packing.position[members, None]).reshape(-1, 3))
        normals.append(np.einsum("gij,pj->gpi", matrices, outward).reshape(-1, 3))
        owner.append(np.repeat(members, len(body)))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(owner)


def _spheres(packing: Assembly, spacing: float) -> tuple[Floats, Floats, np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Return points, normals and grain on spheres of equal volume."""
    radius = packing.diameters / 2
    count = int(np.clip(4 * np.pi * (float(np.median(radius)) / spacing) ** 2, FEWEST, MOST_POINTS))
    k = np.arange(count) + 0.5
    # a spiral with golden steps fills a sphere evenly
    polar, turn = np.arccos(1 - 2 * k / count), np.pi * (1 + np.sqrt(5)) * k
    sphere = np.column_stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])
    points = packing.position[:, None] + radius[:, None, None] * sphere
    return points.reshape(-1, 3), np.tile(sphere, (packing.count, 1)), np.repeat(np.arange(packing.count), count)
