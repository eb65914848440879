"""Small pictures for notebooks, drawn without a window, a driver or a graphics library.

A surface is sampled so densely that each of its pixels receives points, and the nearest point of a pixel is shown. This
takes a tenth of a second, whereas starting a renderer takes seconds.
"""

import base64
import html
import io
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load

Image: TypeAlias = NDArray[np.uint8]

#: edge of a picture in pixels, and how many samples a pixel has along each axis
EDGE, FINE = 160, 2
#: sampled points per sample of the picture
DENSITY = 4.5
#: rows: to the right, up and towards the viewer
VIEW = np.array([[0.877, 0.481, 0.0], [-0.187, 0.341, 0.921], [0.443, -0.808, 0.389]])
LIGHT = np.array([-0.41, 0.61, 0.68])
#: dark, middle and light end of the colours, small to large
RAMP = np.array([[0.23, 0.32, 0.55], [0.13, 0.57, 0.55], [0.93, 0.85, 0.25]])
#: how many grains, one behind the other, are drawn in a column that is as wide as half of them, and grains up to which
#: all are drawn
DEEP, FEW = 3, 100


def surface_samples(triangles: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Return points (n, 3) on triangles (m, 3, 3), at most about a spacing apart, and their normals.

    Of triangles that are smaller than a point's share of the surface, as many have a point as is their share.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    twice = np.linalg.norm(normal, axis=1)
    ends = np.ceil(np.cumsum(DENSITY * twice / (2 * spacing**2))).astype(np.int64)
    owner = np.repeat(np.arange(len(triangles)), np.diff(ends, prepend=0))
    number = np.arange(len(owner))
    # the sequence of the plastic number fills a square evenly; folded it fills a triangle
    u, v = np.modf(0.5 + number * 0.7548776662466927)[0], np.modf(0.5 + number * 0.5698402909980532)[0]
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    points = a[owner] + u[:, None] * (b - a)[owner] + v[:, None] * (c - a)[owner]
    return points, (normal / np.maximum(twice, 1e-300)[:, None])[owner]


def picture(
    bodies: Sequence[Floats], body: Integers, matrices: Floats, position: Floats, size: Floats, *, flat: bool
) -> Image:
    """Draw placed bodies, coloured by size, as a picture (160, 160, 4) of red, green, blue and opacity.

    Each of the grains (at least one) has a `body`, a rotation times scale, a centroid and a diameter; `bodies` are the
    triangles (m, 3, 3) of each different body. Of many grains, those in front are drawn. If `flat` is true, all lies in
    the plane z = 0.
    """
    if len(body) > FEW and not flat:
        front = _in_front(position @ VIEW.T, float(np.median(size)))
        body, matrices, position, size = body[front], matrices[front], position[front], size[front]
    spacing = float(np.ptp(position, axis=0).max() + size.max()) / (FINE * EDGE)
    share = (size - size.min()) / np.ptp(size) if np.ptp(size) else np.full(len(size), 0.5)
    colors = np.column_stack([np.interp(share, (0.0, 0.5, 1.0), ramp) for ramp in RAMP.T])
    points, normals, owner = [], [], []
    factor = np.cbrt(np.abs(np.linalg.det(matrices)))
    # grains of about one size share their points, so that small grains have fewer points than large ones
    octave = np.floor(np.log2(factor)).astype(np.int64)
    for index, level in np.unique(np.column_stack([body, octave]), axis=0).tolist():
        members = np.flatnonzero((body == index) & (octave == level))
        samples, outward = surface_samples(bodies[index], spacing / float(factor[members].max()))
        turn = np.swapaxes(matrices[members], 1, 2)
        placed = samples @ turn + position[members, None]
        points.append(placed.reshape(-1, 3))
        normals.append((outward @ (turn / factor[members, None, None])).reshape(-1, 3))
        owner.append(np.repeat(members, len(samples)))
    return _drawn(np.concatenate(points), np.concatenate(normals), colors[np.concatenate(owner)], flat=flat)


def _in_front(seen: Floats, width: float) -> Integers:
    """Return which of points (n, 3), seen along the last axis, are among the nearest in their columns of a width."""
    column = np.floor((seen[:, :2] - seen[:, :2].min(axis=0)) / width).astype(np.int64)
    number = column @ [int(column[:, 1].max()) + 1, 1]
    order = np.lexsort((-seen[:, 2], number))
    first = np.searchsorted(number[order], number[order])
    return np.asarray(np.sort(order[np.arange(len(order)) - first < DEEP]))


def portrait(triangles: Floats, radius: float, *, flat: bool = False) -> Image:
    """Draw one body, the triangles (m, 3, 3) of which lie within a radius of the origin."""
    size = np.array([2 * radius])
    return picture([triangles], np.zeros(1, int), np.eye(3)[None], np.zeros((1, 3)), size, flat=flat)


def _drawn(points: Floats, normals: Floats, colors: Floats, *, flat: bool) -> Image:
    """Draw points with normals and colours, lit from the upper left."""
    view, fine = np.eye(3) if flat else VIEW, FINE * EDGE
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
    blocks = canvas.reshape(EDGE, FINE, EDGE, FINE, 4)
    opacity = blocks[..., 3].mean(axis=(1, 3))
    total = (blocks[..., :3] * blocks[..., 3:]).sum(axis=(1, 3)) / FINE**2
    mixed = total / np.maximum(opacity, 1e-300)[..., None]
    return np.round(255 * np.concatenate([mixed, opacity[..., None]], axis=2)).astype(np.uint8)


def _tag(image: Image, text: str) -> str:
    """Return a picture as an ``<img>`` that holds its data."""
    buffer = io.BytesIO()
    load("matplotlib.image").imsave(buffer, image, format="png")
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f'<img alt="{html.escape(text)}" width="{len(image)}" src="data:image/png;base64,{data}">'


def card(image: Image | None, rows: Mapping[str, str]) -> str:
    """Return a picture, where there is one, beside a table of names and values, as HTML."""
    lines = "".join(
        f'<tr><th style="text-align:left">{html.escape(name)}</th>'
        f'<td style="text-align:left">{html.escape(value)}</td></tr>'
        for name, value in rows.items()
    )
    tag = "" if image is None else _tag(image, next(iter(rows.values()), ""))
    return f'<div style="display:flex;gap:1em;align-items:center">{tag}<table>{lines}</table></div>'
