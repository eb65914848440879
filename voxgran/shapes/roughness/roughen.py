"""Shapes with rough skins: surfaces displaced along their normals by a random field.

Meshes are refined for the shortest wavelength, and normals change gradually across edges.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Literal

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, check_type
from voxgran._base.calls import explained
from voxgran._base.config import from_mapping
from voxgran._base.errors import InputError, TooLargeError
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.geometry.crossing import count_crossings
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.finer import cut_edges, edges_of, onto_surface, vertex_normals
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import SIDES, Outline, is_simple
from voxgran.shapes.roughness.fields import draw_field
from voxgran.shapes.roughness.measuring import moments_of, scattered_statistics, vertex_weights
from voxgran.shapes.roughness.parameters import POINTS, Method, RoughField, Roughness
from voxgran.shapes.shells import edge_faults
from voxgran.shapes.spheres import Spheres

#: corners of a rough outline at the most
MOST_CORNERS = 5_000
#: distances, in correlation lengths, over which normals are smoothed: none, and more where the surface meets itself
WIDTHS = (0.0, 0.5, 1.0, 2.0)
#: relative residual of the equations of smoothed normals, far below what their directions decide
DIFFUSED = 1e-10
#: halvings of the interval of heights in search of the largest one
SEARCHED = 12
#: height from which on the largest one is searched, in edges of the mesh
SMALL = 1e-4


@explained(hint="roughen(shape, rms=0.01)")
def roughen(
    shape: Shape,
    *,
    method: Method = "spectral",
    rms: float | None = None,
    correlation_length: float | Sequence[float] | None = None,
    shortest: float | None = None,
    hurst: float | None = None,
    autocorrelation: Literal["exponential", "gaussian", "linear"] | None = None,
    skewness: float = 0.0,
    kurtosis: float = 3.0,
    seed: int = 0,
) -> Shape:
    """Give a shape a rough skin.

    The surface is refined and its vertices are displaced along their normals by a random field, whose mean over the
    surface is 0 and whose root mean square is exactly `rms`. A curved surface takes the values of a field in space.

    Parameters
    ----------
    shape : Shape
        Solid, open surface or outline; it is triangles, or a polygon, afterwards.
    method : {"spectral", "patir", "whitehouse", "midpoint"}
        Random field: self-affine with a Hurst exponent; of a given autocorrelation function (Patir 1978,
        doi:10.1016/0043-1648(78)90157-6); by recursion along each axis (Whitehouse & Archard 1970,
        doi:10.1098/rspa.1970.0068); by midpoint displacement (Fournier, Fussell & Carpenter 1982,
        doi:10.1145/358523.358553).
    rms : float, optional
        Root mean square height, in the unit of lengths; default: 0.02 equivalent diameters.
    correlation_length : float or sequence of float, optional
        Distance at which the autocorrelation falls to 1/e, in the unit of lengths, or one for each axis of the body
        frame; default: 0.25 equivalent diameters.
    shortest : float, optional
        Shortest wavelength, in the unit of lengths, along which the mesh has four edges; the spectral field ends there.
        Default: 0.75 of the least correlation length.
    hurst : float, optional
        Hurst exponent of `spectral` and `midpoint`, in [0.05, 1]; default: 0.8.
    autocorrelation : {"exponential", "gaussian", "linear"}, optional
        Autocorrelation function of `patir`; default: exponential.
    skewness, kurtosis : float
        Expected moments of the heights, of `spectral` and `patir`; 0 and 3 for Gaussian heights.
    seed : int
        Seed of the field; the same seed gives the same bits.

    Returns
    -------
    Shape
        Closed if the shape is closed, without self-intersections. Its record has what is measured as by
        :func:`surface_statistics`, under names such as ``"roughness_rms"``, in the unit of lengths.

    Raises
    ------
    InputError
        If a parameter is out of range, or the surface would intersect itself; the message gives the largest height with
        which it does not.
    TooLargeError
        If the shortest wavelength needs more than 400,000 faces or too large a field.

    Examples
    --------
    >>> import voxgran as vg
    >>> stone = vg.roughen(vg.make_shape("sphere"), rms=0.01, seed=3)
    >>> round(stone.record["roughness_rms"], 12)
    0.01
    """
    check_type(shape, Shape, "shape", "a Shape; make_shape and load_shape make one")
    given = {key: value for key, value in locals().items() if key not in ("shape", "seed")}
    return roughened(shape, from_mapping(Roughness, given, "roughen"), stream(seed, "roughen"))


def roughened(shape: Shape, roughness: Roughness, generator: np.random.Generator) -> Shape:
    """Return a shape with a rough skin.

    Raises
    ------
    InputError, TooLargeError
        As :func:`roughen`.
    """
    field = roughness.on(shape.diameter, shape.dimension)
    if not shape.is_open and field.rms > shape.bounding_radius:
        raise InputError(
            f"rms is {field.rms:.4g}: with heights larger than the solid, whose bounding radius is "
            f"{shape.bounding_radius:.4g}, the rough surface cuts through itself; give less, such as "
            f"{0.02 * shape.diameter:.2g}"
        )
    geometry: Geometry
    if isinstance(shape.geometry, Outline):
        geometry, told = _rough_outline(shape.geometry, field, generator)
    else:
        geometry, told = _rough_surface(shape, field, generator)
    made = Shape.of(geometry, name=shape.name, unit=shape.unit)
    x, y, z = (float(a + b) for a, b in zip(shape.offset, made.offset, strict=True))
    return Shape(made.geometry, shape.name, (x, y, z), shape.unit, record={**shape.record, **told})


def _rough_surface(shape: Shape, field: RoughField, generator: np.random.Generator) -> tuple[Geometry, dict[str, Any]]:
    """Return the displaced triangles of a shape in its body frame, and what is measured on them."""
    if shape.is_open and edge_faults(shape.faces, len(shape.vertices))[1:].any():
        raise InputError(
            f"shape {shape.name!r} has edges of faces that are not oriented alike, or of more than two faces: a rough "
            "surface has two sides; repair it"
        )
    vertices, faces = refined(shape, field.edge)
    weights = vertex_weights(vertices, faces)
    heights = random_heights(vertices, weights, field, generator)
    normals = vertex_normals(vertices, faces)

    @cache
    def directions(width: float) -> Floats:
        # near edges, points must move in directions that change gradually, or those on both sides would pass each other
        return diffused(normals, vertices, faces, width * float(field.lengths.min())) if width else normals

    def displaced(factor: float) -> Floats | None:
        for width in WIDTHS:
            moved = vertices + (factor * heights)[:, None] * directions(width)
            if count_crossings(moved, faces) == 0:
                return moved
        return None

    moved = largest_if_none(field.rms, displaced, least=SMALL * field.edge)
    told = record_of(field, vertices, heights, weights, 3)
    return (Surface if shape.is_open else Mesh)(moved, faces), told


def _rough_outline(
    outline: Outline, field: RoughField, generator: np.random.Generator
) -> tuple[Outline, dict[str, Any]]:
    """Return the displaced polygon of an outline, and what is measured on it."""
    if outline.kind == "disk":
        sides = max(SIDES, math.ceil(2 * math.pi * outline.radius / field.edge))
        angles = 2 * np.pi * np.arange(min(sides, MOST_CORNERS + 1)) / sides
        corners = outline.radius * np.column_stack([libm.cos(angles), libm.sin(angles)]) + np.array(outline.center)
    else:
        corners = outline.vertices
    along = np.roll(corners, -1, axis=0) - corners
    lengths = linear.norm(along, axis=1)
    number = np.maximum(np.ceil(lengths / field.edge * (1 - 1e-9)), 1.0)
    if number.sum() > MOST_CORNERS:
        least = field.shortest * number.sum() / MOST_CORNERS
        raise TooLargeError(
            f"shortest is {field.shortest:.4g}: the outline would have {number.sum():.3g} corners, at most "
            f"{MOST_CORNERS} are made; give at least {least:.2g}"
        )
    parts = [a + np.arange(n)[:, None] / n * t for a, t, n in zip(corners, along, number, strict=True)]
    points = np.concatenate(parts)
    after, before = np.roll(points, -1, axis=0) - points, points - np.roll(points, 1, axis=0)
    weights = linear.norm(after, axis=1) + linear.norm(before, axis=1)
    weights /= weights.sum()
    heights = random_heights(points, weights, field, generator)
    total = after + before
    normals = np.column_stack([total[:, 1], -total[:, 0]]) / linear.norm(total, axis=1, keepdims=True)
    moved = largest_if_none(
        field.rms,
        lambda factor: corners if is_simple(corners := points + (factor * heights)[:, None] * normals) else None,
        least=SMALL * field.edge,
    )
    told = record_of(field, points, heights, weights, 2)
    return Outline("polygon", vertices=moved), told


def random_heights(points: Floats, weights: Floats, field: RoughField, generator: np.random.Generator) -> Floats:
    """Return heights (n,) at points (n, d), of weighted mean 0 and exactly the root mean square of a field."""
    low, high = points.min(axis=0), points.max(axis=0)
    spacing = np.full(points.shape[1], field.edge)
    raw = draw_field(field, low, high, spacing, generator).at(points)
    return np.asarray(field.rms * moments_of(raw, weights)[0])


def largest_if_none(rms: float, displaced: Callable[[float], Floats | None], *, least: float) -> Floats:
    """Return the points of a surface displaced by heights times the factor 1.

    Raises
    ------
    InputError
        If the surface meets itself, which `displaced` tells by None; the message gives the largest height, found by
        bisection from the height `least` on, with which it does not.
    """
    moved = displaced(1.0)
    if moved is not None:
        return moved
    low, high = float(f"{least:.3g}") / rms, 1.0
    if low < high and displaced(low) is not None:
        for _ in range(SEARCHED):
            middle = float(f"{math.sqrt(low * high) * rms:.3g}") / rms  # what is proposed is what is tested
            if not low < middle < high:
                break
            low, high = (low, middle) if displaced(middle) is None else (middle, high)
        raise InputError(
            f"rms is {rms:.4g}: with these heights the rough surface cuts through itself; give at most {low * rms:.3g}"
        )
    raise InputError(
        f"rms is {rms:.4g}: the rough surface cuts through itself however small the heights are, as where the smooth "
        "one touches itself along an edge or at a corner; take another shape, or repair it"
    )


def record_of(field: RoughField, points: Floats, heights: Floats, weights: Floats, dimension: int) -> dict[str, Any]:
    """Return what was drawn and what is measured at points of the smooth surface, for the record of a shape."""
    told: dict[str, Any] = {"method": field.method, "shortest": field.shortest}
    if field.rms:
        found = scattered_statistics(points, heights, weights, field.edge, ends_of(field), dimension)
        told |= {key: value for key, value in found.recorded().items() if key != "correlation_lengths"}
    else:
        told["rms"] = 0.0
    return {f"roughness_{key}": value for key, value in told.items()}


def ends_of(field: RoughField) -> tuple[float, ...]:
    """Return the wavelengths at which the spectrum of a field may end; 0 where it does not."""
    return (field.shortest,) if field.method == "spectral" else (0.0,)


#: faces of a refined surface at the most
MOST_FACES = 400_000


def refined(shape: Shape, edge: float) -> tuple[Floats, Integers]:
    """Return the tessellation of a shape with edges of about a length at most, its vertices on the true surface.

    The triangles of solids are divided by manifold3d, each edge into equal pieces, and new edges may be up to twice as
    long as asked for; the edges of open surfaces are bisected until none is too long.

    Raises
    ------
    TooLargeError
        If it has more than 400,000 faces.
    """
    vertices, faces = shape.vertices, shape.faces
    _refuse_many(4 / math.sqrt(3) * shape.surface_area / edge**2, edge)
    if not shape.is_open:
        library = load("manifold3d")
        mesh = library.Mesh64(vertices.copy(), np.ascontiguousarray(faces, dtype=np.uint64))
        finer = library.Manifold(mesh).refine_to_length(edge).to_mesh64()
        flat = np.array(finer.vert_properties[:, :3], dtype=np.float64)
        points, triangles = onto_surface(shape.geometry, flat), np.array(finer.tri_verts, dtype=np.int64)
        _refuse_many(len(triangles), edge)
        # necks between spheres may be narrower than the triangles, so that points on the spheres would pass each other
        if isinstance(shape.geometry, Spheres) and count_crossings(points, triangles):
            return flat, triangles
        return points, triangles
    while True:
        _refuse_many(len(faces), edge)
        ends, index = edges_of(faces)
        long = linear.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1) > edge
        if not long.any():
            return vertices, faces
        new = np.full(len(ends), -1)
        new[long] = len(vertices) + np.arange(int(long.sum()))
        vertices = np.concatenate([vertices, vertices[ends[long]].mean(axis=1)])
        faces = cut_edges(vertices, faces, index, new)


def _refuse_many(number: float, edge: float) -> None:
    """Raise where a surface has too many faces."""
    if number > MOST_FACES:
        least = POINTS * edge * math.sqrt(number / MOST_FACES)
        raise TooLargeError(
            f"shortest is {POINTS * edge:.4g}: a surface of {number:.3g} faces would be needed to resolve it, at most "
            f"{MOST_FACES} are made; give at least {least:.2g}"
        )


def diffused(normals: Floats, vertices: Floats, faces: Integers, width: float) -> Floats:
    """Return unit normals (n, 3) smoothed over a distance along the surface: one implicit step of diffusion."""
    sparse, n = load("scipy.sparse"), len(vertices)
    corners = vertices[faces]
    sides = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)
    doubled = linear.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    # linear finite elements: products of the sides opposite to two corners
    stiffness = linear.einsum("fik,fjk->fij", sides, sides) / (2 * np.maximum(doubled, 1e-300))[:, None, None]
    rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, 3).ravel()
    mass = np.bincount(faces.ravel(), np.repeat(doubled / 6, 3), n)
    matrix = sparse.coo_matrix((stiffness.ravel() * width**2 / 4, (rows, columns)), (n, n)) + sparse.diags(mass)
    matrix = matrix.tocsr()
    found = np.stack(
        [linear.conjugate_gradient(matrix, mass * column, relative=DIFFUSED) for column in normals.T], axis=1
    )
    return np.asarray(found / np.maximum(linear.norm(found, axis=1, keepdims=True), 1e-300))
