"""Interactive view of a page: the grains as plotly draws them in a browser, and the data that the page carries for it.

The page carries one reduced surface of each shape, and pose, values and contacts of each grain; `view.js` places the
surfaces. plotly.js comes from the package of plotly, compressed, so that the page loads nothing.

The data are one gzip stream in base64: the length of a JSON head as four bytes (little-endian), the head, and the
arrays, which the head lists by name with type, shape and first byte after the head.
"""

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.containers.model import Container
from voxgran.measures.registered.coordination import touching_contacts
from voxgran.packing.model import Packing
from voxgran.report.colors import coloring, colors_of, gradient
from voxgran.report.creases import creased
from voxgran.report.facts import shape_names
from voxgran.report.scenes import drawn_surface
from voxgran.report.stage import view_axes

#: about the largest number of triangles of a view, which a laptop turns smoothly
TRIANGLES = 240_000
#: fewest and most triangles of a grain
FEWEST, MOST = 20, 1_000
#: largest number of grains in a view
GRAINS = 20_000
#: largest number of line segments of the outline of a container, and of triangles of one without curved walls
SEGMENTS, PLANE = 5_000, 100
#: largest of the whole numbers that stand for the coordinates of a surface
WHOLE = 32_767


@dataclass(frozen=True, slots=True)
class PackingView:
    """What a page carries of one packing: its name, the data in base64, and what the view leaves out."""

    name: str
    data: str
    note: str


def views_of(packings: Mapping[str, Packing], color_by: str = "diameter") -> dict[str, Any] | None:
    """Return what the template of the view needs, for packings by name; None if all are empty.

    The triangles are shared among the packings.

    Raises
    ------
    MissingLibraryError
        If plotly cannot be loaded.
    """
    full = {name: packing for name, packing in packings.items() if packing.count}
    if not full:
        return None
    views = [_view(name, packing, TRIANGLES // len(full)) for name, packing in full.items()]
    flat = all(packing.dimension == 2 for packing in full.values())
    settings = {"gradient": gradient(), "axes": view_axes().tolist(), "color": color_by}
    return {"packings": views, "viewer": viewer(), "settings": settings, "flat": flat}


@cache
def viewer() -> str:
    """Return plotly.js as a gzip file in base64.

    Raises
    ------
    MissingLibraryError
        If plotly cannot be loaded.
    """
    source = Path(load("plotly").__file__).parent / "package_data" / "plotly.min.js"
    return _packed(source.read_bytes())


def _packed(content: bytes) -> str:
    """Return bytes compressed and in base64, the same for the same bytes."""
    return base64.b64encode(gzip.compress(content, 6, mtime=0)).decode()


def _view(name: str, packing: Packing, triangles: int) -> PackingView:
    """Return the view of a packing."""
    shown = shown_grains(packing)
    most = int(np.clip(triangles // len(shown), FEWEST, MOST))
    return PackingView(name, _packed(encoded(*view_data(packing, shown, most))), _note(packing, shown, most))


def shown_grains(packing: Packing) -> Integers:
    """Return the grains of the view: all, or those nearest to the middle along y, in 2D nearest to the centroid."""
    if packing.count <= GRAINS:
        return np.arange(packing.count)
    away = packing.position - packing.container.bounds.mean(axis=0)
    distance = np.abs(away[:, 1]) if packing.dimension == 3 else np.linalg.norm(away, axis=1)
    return np.sort(np.argsort(distance, kind="stable")[:GRAINS])


def _note(packing: Packing, shown: Integers, most: int) -> str:
    """Return what the view leaves out."""
    notes = []
    if len(shown) < packing.count:
        where = "to the middle along y" if packing.dimension == 3 else "to the middle"
        notes.append(f"It shows {len(shown)} of {packing.count} grains, those nearest {where}.")
    if any(len(packing.shapes[s].faces) > most for s in np.unique(packing.shape_id[shown])):
        notes.append(f"Surfaces are reduced to about {most} triangles for this view only.")
    return " ".join(notes)


def view_data(packing: Packing, shown: Integers, most: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the head and the arrays of the data of a view; `most` is the largest number of triangles of a grain.

    Lengths are in median diameters, from the middle of the container, so that single precision is enough for packings
    of all sizes and places.
    """
    middle, length = packing.container.bounds.mean(axis=0), float(np.median(packing.diameters[shown]))
    used, shape = np.unique(packing.shape_id[shown], return_inverse=True)
    bodies = [creased(packing.shapes[s], *drawn_surface(packing.shapes[s], most)) for s in used]
    reach = np.array([np.abs(vertices).max() for vertices, _ in bodies])
    whole = [np.round(vertices / r * WHOLE) for (vertices, _), r in zip(bodies, reach, strict=True)]
    shades = colors_of(packing)
    # fixed grains have values like all others here: it has no colour for grains without one; a copy finds contacts anew
    free = packing if packing.fixed is None else replace(packing, fixed=None)
    colors = [coloring(free, name) for name in shades]
    lines = (outline(packing.container) - middle) / length
    contacts = touching_contacts(packing)
    near = np.zeros(packing.count, dtype=bool)
    near[shown] = True
    kept = near[contacts.i] | near[contacts.j]
    arrays = {
        "vertices": np.concatenate(whole).astype(np.int16),
        "faces": _joined([faces for _, faces in bodies]),
        "vertex_count": np.array([len(vertices) for vertices, _ in bodies], np.uint32),
        "face_count": np.array([len(faces) for _, faces in bodies], np.uint32),
        "reach": (reach / length).astype(np.float32),
        "grain": shown.astype(np.uint32),
        "shape": shape.reshape(-1).astype(np.uint32),
        "position": ((packing.position[shown] - middle) / length).astype(np.float32),
        "orientation": packing.orientation[shown].astype(np.float32),
        "scale": packing.scale[shown].astype(np.float32),
        "values": np.array([color.values[shown] for color in colors]).astype(np.float32),
        "contacts": np.unique(np.sort(np.column_stack([contacts.i, contacts.j])[kept], axis=1), axis=0).astype(
            np.uint32
        ),
        "lines": lines.astype(np.float32),
    }
    names = shape_names(packing)
    head = {
        "dimension": packing.dimension,
        "unit": "" if packing.unit == "1" else packing.unit,
        "length": length,
        "middle": middle.tolist(),
        "bounds": packing.container.bounds.tolist(),
        "shapes": [names[s] for s in used],
        "colors": [{"name": n, "label": c.label, "unit": c.unit} for n, c in zip(shades, colors, strict=True)],
    }
    return head, arrays


def _joined(faces: Sequence[Integers]) -> Any:
    """Return triangles of all surfaces, each with the numbers of its own vertices, in the smallest type."""
    joined = np.concatenate(faces)
    return joined.astype(np.uint16 if joined.max() < 1 << 16 else np.uint32)


def encoded(head: Mapping[str, Any], arrays: Mapping[str, Any]) -> bytes:
    """Return head and arrays as bytes; each array begins at a multiple of four bytes."""
    parts, listed, at = [], {}, 0
    for name, array in arrays.items():
        content = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).tobytes()
        listed[name] = {"type": array.dtype.name, "shape": list(array.shape), "at": at}
        parts.append(content + bytes(-len(content) % 4))
        at += len(parts[-1])
    text = json.dumps({**head, "arrays": listed}).encode()
    text += b" " * (-len(text) % 4)
    return len(text).to_bytes(4, "little") + text + b"".join(parts)


def outline(container: Container) -> Floats:
    """Return the outline of a container as the two ends (n, 2, 3) of line segments.

    These are its sharp edges, and where walls are curved its sections through the middle too.
    """
    mesh = load("pyvista").PolyData.from_regular_faces(*container.mesh())
    if container.dimension == 2:
        return _segments(
            mesh.extract_feature_edges(feature_edges=False, manifold_edges=False, non_manifold_edges=False)
        )
    edges = _segments(mesh.extract_feature_edges(30.0, boundary_edges=False, manifold_edges=False))
    if mesh.n_cells <= PLANE:
        return edges
    middle = container.bounds.mean(axis=0)
    sections = [_segments(mesh.slice(normal=normal, origin=middle)) for normal in np.eye(3)]
    return np.concatenate([edges, *sections] if len(edges) <= SEGMENTS else sections)


def _segments(lines: Any) -> Floats:
    """Return both ends (n, 2, 3) of the line segments of a mesh."""
    ends = np.asarray(lines.lines).reshape(-1, 3)[:, 1:] if lines.n_lines else np.zeros((0, 2), np.int64)
    return np.asarray(lines.points, dtype=np.float64)[ends]
