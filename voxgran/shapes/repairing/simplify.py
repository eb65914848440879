"""Simplification: a closed mesh with fewer triangles, of the same volume, and how far it is from the original.

Flat parts first get as few triangles as they need. Edges are then collapsed in the order of their quadric error
(Garland & Heckbert 1997, doi:10.1145/258734.258849) by VTK, in the body frame at unit size, in single precision. On
scans its volume and distances are more accurate than those of the same method in Open3D. Collapses may fold or part the
surface: the result is repaired and passes the same check as any other shape, or a few more edges are collapsed. It is
scaled to the volume of the original.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_count, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import DirtyMeshError, InputError, PackingWarning, warn
from voxgran._base.lazy import load
from voxgran._base.scalars import cube_root
from voxgran._base.seeds import stream
from voxgran._base.vtk_data import numpy_support, poly_data
from voxgran.geometry.tree import grow_tree
from voxgran.geometry.triangles import areas_of
from voxgran.shapes.files import load_shape
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.repair import repaired

#: fewest triangles of a closed surface
FEWEST = 4
#: shares of the triangles asked for that are tried in turn
SHARES = (1.0, 0.98, 0.95, 0.9, 0.85, 0.8, 0.7)
#: random points on each surface from which distances are taken, and most of its vertices
SAMPLED, MOST_VERTICES = 10_000, 100_000
#: distance, in extents, up to which triangles lie in one plane
FLAT = 1e-12
#: distance, in extents, up to which a vertex is one of the original: single precision is lost to it
SAME = 1e-6
#: grains without a surface of so few triangles that are named
NAMED = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Simplification(ExplainedAttributes):
    """What came of a simplification.

    Attributes
    ----------
    shape : Shape
        Closed solid of the same volume; its record has `simplified_from`, the number of triangles before.
    faces_before, faces : int
        Triangles before and after.
    volume_change : float
        Relative change of the volume, which is kept up to rounding.
    collapse_volume_change : float
        Relative change of the volume by the collapses alone, before the shape was scaled.
    area_change : float
        Relative change of the surface area.
    mean_distance, largest_distance : float
        Distances between both surfaces, in the unit of lengths, from points on each: the mean over random points, and
        the largest of these and of the vertices, a lower estimate of the Hausdorff distance.
    sentences : tuple of str
        What was repaired after the collapses; empty where nothing was wrong.
    """

    shape: Shape
    faces_before: int
    faces: int
    volume_change: float
    collapse_volume_change: float
    area_change: float
    mean_distance: float
    largest_distance: float
    sentences: tuple[str, ...]


@explained(hint="simplify(shape, faces=500)")
def simplify(shape: Shape | str | os.PathLike[str], *, faces: int) -> Simplification:
    """Reduce a solid to at most so many triangles, with its volume kept.

    Parameters
    ----------
    shape : Shape or path-like
        Solid, or a mesh file as :func:`voxgran.load_shape` reads it. Of a solid in closed form the tessellation is
        reduced. A solid of no more triangles comes back unchanged.
    faces : int
        Largest number of triangles, at least 4.

    Returns
    -------
    Simplification
        The shape, in the place of the original, and how much it differs.

    Raises
    ------
    InputError
        If the shape is flat or an open surface, `faces` is no whole number of at least 4, or no closed surface of so
        few triangles is found; the message says how many can be had.
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is of no known format, or damaged.
    DirtyMeshError
        If the mesh in the file does not bound one solid.

    Examples
    --------
    >>> import voxgran as vg
    >>> made = vg.simplify(vg.make_shape("torus"), faces=1000)
    >>> made.faces_before, made.faces, round(made.shape.diameter, 12)
    (4092, 1000, 1.0)
    >>> 0.0 < made.largest_distance < 0.01
    True
    """
    solid: Any = load_shape(shape) if isinstance(shape, str | os.PathLike) else shape
    check_type(solid, Shape, "shape", "a Shape; make_shape and load_shape make one")
    most = as_count(faces, "faces", at_least=FEWEST)
    solid.refuse_open("simplified shapes")
    if solid.dimension == 2:
        raise InputError(f"shape {solid.name!r} is flat: only solids have triangles to be reduced; take a solid")
    found = _reduced(solid, most)
    if found is None:
        enough = _enough(solid, most)
        remedy = "leave it as it is" if enough is None else f"give {enough}"
        raise InputError(
            f"faces is {most}: no closed surface of so few triangles is found for {solid.name!r}, which has "
            f"{len(solid.faces)}; {remedy}"
        )
    return found


def simplified(shapes: Sequence[Shape], faces: int) -> tuple[Shape, ...]:
    """Return solids of which meshes have at most so many triangles; those without such a surface, as labels that noise
    has torn, are as coarse as can be had, and named in one warning.
    """
    most, missed, made = as_count(faces, "faces", at_least=FEWEST), [], list(shapes)
    for k, shape in enumerate(shapes):
        if isinstance(shape.geometry, Mesh):
            found = _reduced(shape, most)
            if found is None:
                enough = _enough(shape, most)
                found = None if enough is None else _reduced(shape, enough)
                missed.append(shape if found is None else found.shape)
            made[k] = missed[-1] if found is None else found.shape
    if missed:
        names = ", ".join(one.name for one in missed[:NAMED]) + ", ..." * (len(missed) > NAMED)
        warn(
            f"{len(missed)} of {len(made)} grains ({names}) have no closed surface of at most {most} triangles and "
            f"keep up to {max(len(one.faces) for one in missed)}: see whether each is one grain, or leave them out",
            PackingWarning,
        )
    return tuple(made)


def _reduced(solid: Shape, most: int) -> Simplification | None:
    """Return a solid with at most so many triangles; None where no such surface is found."""
    before = len(solid.faces)
    if before <= most:
        nothing: dict[str, Any] = dict.fromkeys(
            ("volume_change", "collapse_volume_change", "area_change", "mean_distance", "largest_distance"), 0.0
        )
        return Simplification(shape=solid, faces_before=before, faces=before, sentences=(), **nothing)
    size, surface = _unit_surface(solid)
    found = _closed(*surface, most)
    return None if found is None else _compared(solid, size, *found)


def _unit_surface(solid: Shape) -> tuple[float, tuple[Floats, Integers]]:
    """Return the largest extent of a solid, and its surface at unit size with few triangles on flat parts."""
    size = float(np.ptp(solid.vertices, axis=0).max())
    return size, without_flat_edges(solid.vertices / size, solid.faces)


def _enough(solid: Shape, most: int) -> int | None:
    """Return a number of triangles, within a tenth of the least, for which a closed surface is found; None without."""
    surface, before = _unit_surface(solid)[1], len(solid.faces)
    tries = (most * 2**k for k in range(1, 30) if most * 2**k < before)
    enough = next((n for n in tries if _closed(*surface, n) is not None), None)
    if enough is None:
        return None
    few = enough // 2
    while enough - few > enough // 10 + 1:
        middle = (few + enough) // 2
        few, enough = (few, middle) if _closed(*surface, middle) is not None else (middle, enough)
    return enough


def _compared(solid: Shape, size: float, reduced: Shape, sentences: tuple[str, ...]) -> Simplification:
    """Return a reduced surface of unit size at the size and volume of its solid, and how far the two are apart."""
    volume = solid.volume / size**3
    factor = cube_root(volume / reduced.volume)
    corners = size * (np.array(reduced.offset) + factor * reduced.vertices)
    made = Shape.from_mesh(corners, reduced.faces, name=solid.name, unit=solid.unit)
    x, y, z = (float(a + b) for a, b in zip(solid.offset, made.offset, strict=True))
    # the statistics of a rough surface are not those of the reduced one
    kept = {key: value for key, value in solid.record.items() if not key.startswith("roughness_")}
    record = kept | {"simplified_from": len(solid.faces)}
    mean, largest = distances(solid.vertices / size, solid.faces, corners / size, reduced.faces)
    return Simplification(
        shape=replace(made, offset=(x, y, z), record=record),
        faces_before=len(solid.faces),
        faces=len(made.faces),
        volume_change=made.volume / solid.volume - 1,
        collapse_volume_change=reduced.volume / volume - 1,
        area_change=made.surface_area / solid.surface_area - 1,
        mean_distance=mean * size,
        largest_distance=largest * size,
        sentences=sentences,
    )


def _closed(vertices: Floats, faces: Integers, most: int) -> tuple[Shape, tuple[str, ...]] | None:
    """Return a solid of at most so many triangles, and what was repaired; None where none is found."""
    for share in SHARES:
        wanted = max(FEWEST, int(share * most))
        try:
            found = repaired(*decimated(vertices, faces, wanted), name="reduced surface")
        except (DirtyMeshError, InputError):
            continue
        if len(found.shape.faces) <= most and found.volume > 0:
            return found.shape, found.sentences
    return None


def without_flat_edges(vertices: Floats, faces: Integers) -> tuple[Floats, Integers]:
    """Return a surface of unit size with as few triangles on its flat parts as can be, by manifold3d, without a change
    beyond rounding; the same surface where it touches itself.
    """
    library = load("manifold3d")
    mesh = library.Mesh64(np.array(vertices), np.array(faces, dtype=np.uint64))
    solid = library.Manifold(mesh)
    if solid.status() != library.Error.NoError:
        return vertices, faces
    made = solid.simplify(FLAT).to_mesh64()
    return np.array(made.vert_properties[:, :3], dtype=np.float64), np.array(made.tri_verts, dtype=np.int64)


def decimated(vertices: Floats, faces: Integers, most: int) -> tuple[Floats, Integers]:
    """Return a surface of unit size after edge collapses to about so many triangles; it may be open or cross itself."""
    if len(faces) <= most:
        return vertices, faces
    filtered = load("vtkmodules.vtkFiltersCore").vtkQuadricDecimation()
    filtered.SetInputData(poly_data(vertices, "Polys", faces))
    filtered.SetTargetReduction(1 - most / len(faces))
    filtered.Update()
    output, to_numpy = filtered.GetOutput(), numpy_support().vtk_to_numpy
    if not output.GetNumberOfPolys():
        return vertices[:0], faces[:0]
    points = np.array(to_numpy(output.GetPoints().GetData()), dtype=np.float64)
    triangles = np.array(to_numpy(output.GetPolys().GetConnectivityArray()), dtype=np.int64).reshape(-1, 3)
    away, nearest = load("scipy.spatial").cKDTree(vertices).query(points)
    points[away < SAME] = vertices[nearest[away < SAME]]
    return points, triangles


def distances(one: Floats, faces: Integers, two: Floats, others: Integers) -> tuple[float, float]:
    """Return the mean and the largest distance between two closed surfaces, from points on each."""
    means, largest = [], []
    for k, (a, f, b, g) in enumerate(((one, faces, two, others), (two, others, one, faces))):
        tree = grow_tree(b, g)
        inner = np.abs(tree.signed_distance(_random_points(a[f], k)))
        corners = np.abs(tree.signed_distance(a[:: 1 + len(a) // MOST_VERTICES]))
        means.append(float(inner.mean()))
        largest.append(max(float(inner.max()), float(corners.max())))
    return sum(means) / 2, max(largest)


def _random_points(triangles: Floats, k: int) -> Floats:
    """Return random points, uniform by area, on (m, 3, 3) triangles."""
    generator, areas = stream(0, "simplify", k), areas_of(triangles)
    chosen = triangles[generator.choice(len(triangles), SAMPLED, p=areas / areas.sum())]
    u, v = generator.random((2, SAMPLED))
    root = np.sqrt(u)
    shares = np.column_stack([1 - root, root * (1 - v), root * v])
    return np.asarray(linear.einsum("ni,nij->nj", shares, chosen))
