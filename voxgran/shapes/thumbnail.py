"""Small pictures for notebooks, drawn without a window, a driver or a graphics library.

A surface is sampled so densely that each of its pixels receives points, and the nearest point of a pixel is shown. This
takes a tenth of a second, whereas starting a renderer takes seconds.
"""

import base64
import html
import io
from collections.abc import Mapping

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.shapes.model import Shape

#: edge of a picture in pixels, and how many samples a pixel has along each axis
EDGE, FINE = 160, 2
#: sampled points per sample of the picture
DENSITY = 4.5
#: rows: to the right, up and towards the viewer
VIEW = np.array([[0.877, 0.481, 0.0], [-0.187, 0.341, 0.921], [0.443, -0.808, 0.389]])
FLAT_VIEW = np.eye(3)
LIGHT = np.array([-0.41, 0.61, 0.68])
COLOR = np.array([0.36, 0.55, 0.63])


def surface_samples(triangles: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Return points on triangles, at most about a spacing apart, and their normals.

    Parameters
    ----------
    triangles : (m, 3, 3) ndarray of float
        Corner points.
    spacing : float
        Largest spacing, in the unit of the points.

    Returns
    -------
    points, normals : (n, 3) ndarray of float
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    twice = np.linalg.norm(normal, axis=1)
    count = 1 + np.ceil(DENSITY * twice / (2 * spacing**2)).astype(np.int64)
    owner = np.repeat(np.arange(len(triangles)), count)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    # the sequence of the plastic number fills a square evenly; folded it fills a triangle
    u, v = np.modf(0.5 + number * 0.7548776662466927)[0], np.modf(0.5 + number * 0.5698402909980532)[0]
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    points = a[owner] + u[:, None] * (b - a)[owner] + v[:, None] * (c - a)[owner]
    return points, (normal / np.maximum(twice, 1e-300)[:, None])[owner]


def picture(
    points: Floats, normals: Floats, colors: Floats, *, flat: bool = False, edge: int = EDGE
) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    """Draw points with normals, lit from the upper left.

    Parameters
    ----------
    points, normals, colors : (n, 3) ndarray of float
        Positions, normals, and red, green and blue in [0, 1].
    flat : bool
        Whether the scene lies in the plane z = 0.
    edge : int
        Width and height, in pixels.

    Returns
    -------
    (edge, edge, 4) ndarray of uint8
        Red, green, blue and opacity.
    """
    view, fine = FLAT_VIEW if flat else VIEW, FINE * edge
    seen = points @ view.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = 0.94 * fine / max(float((high - low)[:2].max()), 1e-300)
    column = ((seen[:, 0] - (low[0] + high[0]) / 2) * scale + fine / 2).astype(np.int64)
    row = (fine / 2 - (seen[:, 1] - (low[1] + high[1]) / 2) * scale).astype(np.int64)
    place = np.clip(row, 0, fine - 1) * fine + np.clip(column, 0, fine - 1)
    order = np.argsort(seen[:, 2], kind="stable")
    top = np.full(fine * fine, -1)
    top[place[order]] = order
    taken = top >= 0
    shade = 0.45 + 0.55 * np.abs((normals[top[taken]] @ view.T) @ LIGHT)
    canvas = np.zeros((fine * fine, 4))
    canvas[taken, :3] = np.clip(colors[top[taken]] * shade[:, None], 0, 1)
    canvas[taken, 3] = 1.0
    blocks = canvas.reshape(edge, FINE, edge, FINE, 4)
    opacity = blocks[..., 3].mean(axis=(1, 3))
    total = (blocks[..., :3] * blocks[..., 3:]).sum(axis=(1, 3)) / FINE**2
    mixed = total / np.maximum(opacity, 1e-300)[..., None]
    return np.round(255 * np.concatenate([mixed, opacity[..., None]], axis=2)).astype(np.uint8)


def shape_picture(shape: Shape, *, edge: int = EDGE) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    """Draw a shape.

    Parameters
    ----------
    shape : Shape
        Shape whose tessellation is drawn.
    edge : int
        Width and height, in pixels.

    Returns
    -------
    (edge, edge, 4) ndarray of uint8
        Red, green, blue and opacity.
    """
    spacing = 2 * shape.bounding_radius / (FINE * edge)
    points, normals = surface_samples(shape.vertices[shape.faces], spacing)
    return picture(points, normals, np.broadcast_to(COLOR, points.shape), flat=shape.dimension == 2, edge=edge)


def image_tag(image: np.ndarray[tuple[int, int, int], np.dtype[np.uint8]], text: str) -> str:
    """Return a picture as an ``<img>`` with embedded data."""
    buffer = io.BytesIO()
    load("matplotlib.image").imsave(buffer, image, format="png")
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f'<img alt="{html.escape(text)}" width="{len(image)}" src="data:image/png;base64,{data}">'


def card(image: str, rows: Mapping[str, str]) -> str:
    """Return a picture beside a table of names and values, as HTML."""
    lines = "".join(
        f'<tr><th style="text-align:left">{html.escape(name)}</th>'
        f'<td style="text-align:left">{html.escape(value)}</td></tr>'
        for name, value in rows.items()
    )
    return f'<div style="display:flex;gap:1em;align-items:center">{image}<table>{lines}</table></div>'


def shape_card(shape: Shape) -> str:
    """Return a small picture and the numbers of a shape as HTML, for notebooks."""
    kind = str(getattr(shape.geometry, "kind", type(shape.geometry).__name__.lower()))
    flat, unit = shape.dimension == 2, f" {shape.unit}" if shape.unit else ""
    rows = {
        "shape": f"{shape.name} ({kind})",
        "equivalent diameter": f"{shape.diameter:.6g}{unit}",
        "area" if flat else "volume": f"{shape.volume:.6g}",
        "perimeter" if flat else "surface area": f"{shape.surface_area:.6g}",
        "faces": f"{len(shape.faces)}, at most {shape.tessellation_error:.2g} from the true surface",
    }
    return card(image_tag(shape_picture(shape), shape.name), rows)
