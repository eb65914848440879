"""Surface reconstruction: a closed shape from a point cloud, with residuals."""

import logging
import math
from dataclasses import dataclass

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_choice, as_count, as_length, as_number, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import DirtyMeshError, InputError, shown
from voxgran._base.lazy import load
from voxgran.lattice.label import components
from voxgran.points.backend_open3d import without_stderr
from voxgran.points.cloud import Cloud, Frame
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import bounds_solid
from voxgran.shapes.repairing.repair import repair

log = logging.getLogger(__name__)

#: smallest number of points of a body
FEWEST = 50
#: largest depth of the octree, which then has 2^10 cells per edge
DEEPEST = 10
#: corners of the edges and of the facets of a tetrahedron
EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
SIDES = ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))
#: largest number of rounds that repair edges at which the surface meets itself
ROUNDS = 60
#: default radius of the spheres of an alpha shape, in spacings
ALPHA = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Reconstruction(ExplainedAttributes):
    """Shape reconstructed from a cloud, with the residuals between the two.

    Attributes
    ----------
    shape : Shape
        Closed shape; its `offset` is the centroid in the frame of the cloud.
    mean_residual, rms_residual, largest_residual : float
        Distances of the points of the cloud from the surface, in the unit of lengths.
    largest_hole : float
        Largest distance of a surface point from the nearest point of the cloud, in the unit of lengths.
    spacing : float
        Spacing of the cloud, in the unit of lengths.
    sentences : tuple of str
        Repairs that were needed, one sentence each.
    """

    shape: Shape
    mean_residual: float
    rms_residual: float
    largest_residual: float
    largest_hole: float
    spacing: float
    sentences: tuple[str, ...]


@explained(hint='shape_of_cloud(cloud, method="poisson")')
def shape_of_cloud(
    cloud: Cloud,
    *,
    method: str = "poisson",
    depth: int | None = None,
    alpha: float | None = None,
    max_gap: float = 5.0,
    name: str | None = None,
) -> Reconstruction:
    """Reconstruct a closed shape from a point cloud.

    Parameters
    ----------
    cloud : Cloud
        Points all around one body; missing normals are estimated.
    method : {"poisson", "alpha"}
        "poisson": smooth surface that averages noise (Kazhdan & Hoppe 2013). "alpha": surface through the outer points,
        which keeps edges and is displaced outward by about the noise (Edelsbrunner & Mucke 1994; cavities are filled).
    depth : int, optional
        Depth of the octree of "poisson", from 2 to 10. Default: the logarithm of the number of points to base 4.
    alpha : float, optional
        Radius of the spheres of "alpha", in the unit of lengths. Default: three spacings.
    max_gap : float
        Largest distance of a surface point from the nearest point of the cloud, and of a point of the cloud from the
        surface, in spacings.
    name : str, optional
        Name of the shape in reports. Default: that of the cloud.

    Returns
    -------
    Reconstruction
        The shape and its residuals.

    Raises
    ------
    InputError
        If the cloud has fewer than 50 distinct points, is flat, is too sparse for a closed surface (the message states
        where and how sparse), contains other bodies or stray points, or a parameter is out of range.
    DirtyMeshError
        If the reconstruction is not a closed surface.

    References
    ----------
    Kazhdan & Hoppe 2013, Screened Poisson surface reconstruction, doi:10.1145/2487228.2487237. Edelsbrunner & Mucke
    1994, Three-dimensional alpha shapes, doi:10.1145/174462.156635.

    Examples
    --------
    >>> import voxgran as vg
    >>> cloud = vg.Cloud.of(vg.sample_surface(vg.shapes.sphere(), spacing=0.2))
    >>> round(vg.shape_of_cloud(cloud).shape.diameter, 1)
    1.0
    """
    check_type(cloud, Cloud, "cloud", "a Cloud; load_cloud reads one")
    as_choice(method, "method", ("poisson", "alpha"))
    holes = as_number(max_gap, "max_gap", above=0.0)
    levels = None if depth is None else as_count(depth, "depth", at_least=2)
    if levels is not None and levels > DEEPEST:
        raise InputError(f"depth is {shown(levels)}: more than {DEEPEST} makes more cells than memory holds; lower it")
    radius = None if alpha is None else as_length(alpha, "alpha")
    _refuse_thin(cloud)
    frame = Frame.around(cloud.points)
    if method == "poisson":
        corners, faces = _poisson(cloud, frame, levels)
    else:
        corners, faces = _alpha(cloud, frame, (radius or ALPHA * cloud.spacing) / frame.size)
    if not len(faces):
        raise DirtyMeshError(f"{cloud.name} has {len(cloud)} points and no surface comes of them: raise alpha or depth")
    hole = _refuse_sparse(cloud, frame, corners, faces, holes)
    called = cloud.name if name is None else name
    shape, sentences = _closed(frame.back(corners), faces, called, cloud.unit)
    apart = _distances(shape, cloud.points)
    _refuse_far(cloud, apart, holes)
    found = Reconstruction(
        shape=shape,
        mean_residual=float(apart.mean()),
        rms_residual=float(np.sqrt((apart**2).mean())),
        largest_residual=float(apart.max()),
        largest_hole=hole,
        spacing=cloud.spacing,
        sentences=sentences,
    )
    log.info("%s: %d points, mean residual %.3g, largest hole %.3g", called, len(cloud), apart.mean(), hole)
    return found


def _refuse_thin(cloud: Cloud) -> None:
    """Refuse clouds of too few points, or without volume."""
    different = len(np.unique(cloud.points, axis=0))
    if different < FEWEST:
        raise InputError(f"{cloud.name} has {different} points that differ: a body needs {FEWEST}; scan it more finely")
    spread = linear.svd(cloud.points - cloud.points.mean(axis=0))[1]
    if spread[2] <= 1e-9 * spread[0]:
        raise InputError(f"{cloud.name} lies in a plane: it bounds no volume; scan the other sides too")


def _poisson(cloud: Cloud, frame: Frame, depth: int | None) -> tuple[Floats, Integers]:
    """Return a Poisson surface in the frame; on one thread, since several threads do not reproduce the same bits."""
    open3d = load("open3d")
    oriented = cloud if cloud.normals is not None else cloud.with_normals(min(30, len(cloud) - 1))
    levels = depth or max(4, min(DEEPEST, round(math.log(len(cloud), 4))))
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error), without_stderr():
        made, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            frame.to_open3d(oriented), depth=levels, n_threads=1
        )
    return np.asarray(made.vertices, dtype=np.float64), np.asarray(made.triangles, dtype=np.int64)


def _alpha(cloud: Cloud, frame: Frame, radius: float) -> tuple[Floats, Integers]:
    """Return the alpha shape in the frame: the Delaunay tetrahedra that spheres from outside do not reach."""
    corners = frame.into(np.unique(cloud.points, axis=0))
    # joggled, since the Delaunay tetrahedra of points on a common sphere are not unique
    tetras = load("scipy.spatial").Delaunay(corners, qhull_options="QJ Pp").simplices.astype(np.int64)
    facets = _facets(tetras)
    # tetrahedra whose facets are all small
    size = np.maximum.reduce([_circumradii(corners[tetras[:, list(side)]]) for side in SIDES])
    wide = _circumradii(corners[facets.corners])
    # the tetrahedra, and at last the outside itself, that spheres reach through facets
    through = wide > radius
    body = components(len(tetras) + 1, facets.one[through], facets.other[through])
    outside = np.asarray(body == body[-1])
    widest = int(np.where(through, wide, 0.0).argmax())
    hole = corners[facets.corners[widest]].mean(axis=0), float(wide[widest]) if through.any() else 0.0
    _refuse_wafer(cloud, frame, corners, tetras[~outside[:-1]], hole)
    edges = _numbered(tetras[:, EDGES], len(corners))
    for turn in range(ROUNDS + 1):
        edge = outside[facets.one] != outside[facets.other]
        surface = facets.corners[edge]
        sides, many = np.unique(_numbered(surface[:, [[0, 1], [0, 2], [1, 2]]], len(corners)), return_counts=True)
        pinched = np.isin(edges, sides[many > 2]).any(axis=1)
        if turn == ROUNDS or not pinched.any():
            break
        # if the surface meets itself along an edge, small tetrahedra around it join the solid, or else some are removed
        joined = pinched & outside[:-1] & (size <= 2 * radius)
        outside[:-1] = outside[:-1] & ~joined if joined.any() else outside[:-1] | (pinched & (size <= radius))
    inner = np.where(outside[facets.one], facets.other, facets.one)[edge]
    return _outward(corners, surface, corners[tetras[inner]].mean(axis=1))


@dataclass(frozen=True, slots=True)
class _Facets:
    """Triangles between tetrahedra: their corners and two tetrahedra each; the index past the last is the outside."""

    corners: Integers
    one: Integers
    other: Integers


def _refuse_wafer(cloud: Cloud, frame: Frame, corners: Floats, solid: Integers, hole: tuple[Floats, float]) -> None:
    """Refuse a skin thinner than two spacings, which remains if spheres enter the body through a hole."""
    edges = corners[solid[:, 1:]] - corners[solid[:, :1]]
    volume = float(np.abs(linear.determinant(edges)).sum()) / 6
    area = len(np.unique(cloud.points, axis=0)) * (cloud.spacing / frame.size) ** 2
    if volume < area * cloud.spacing / frame.size:
        where = ", ".join(f"{value:.4g}" for value in frame.back(hole[0]))
        raise InputError(
            f"{cloud.name} is too sparse to close: the spheres get inside, the widest way is around ({where}) with a "
            f"radius of {hole[1] * frame.size:.4g}, and its spacing is {cloud.spacing:.4g}; scan that side, or raise "
            "alpha"
        )


def _facets(tetras: Integers) -> _Facets:
    """Return the triangles between tetrahedra."""
    sides = np.sort(tetras[:, SIDES], axis=2).reshape(-1, 3)
    _, which = np.unique(sides, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    new = np.r_[True, np.diff(which.ravel()[order]) != 0]
    first, last = order[new], order[np.r_[new[1:], True]]
    return _Facets(sides[first], first // 4, np.where(first == last, len(tetras), last // 4))


def _numbered(edges: Integers, many: int) -> Integers:
    """Return one key per edge, given the number of corners."""
    return np.asarray(edges.min(axis=-1) * many + edges.max(axis=-1))


def _circumradii(corners: Floats) -> Floats:
    """Return the circumradii of triangles; infinite for degenerate ones."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    sides = linear.norm(a, axis=1) * linear.norm(b, axis=1) * linear.norm(a - b, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(sides / (2 * linear.norm(np.cross(a, b), axis=1)), nan=np.inf))


def _outward(corners: Floats, faces: Integers, inner: Floats) -> tuple[Floats, Integers]:
    """Return the corners in use and the faces, oriented so that inner points lie behind them."""
    a, b, c = (corners[faces[:, k]] for k in range(3))
    behind = (np.cross(b - a, c - a) * (inner - a)).sum(axis=1) < 0
    wound = np.where(behind[:, None], faces, faces[:, [0, 2, 1]])
    used, again = np.unique(wound, return_inverse=True)
    return corners[used], again.reshape(wound.shape).astype(np.int64)


def _refuse_sparse(cloud: Cloud, frame: Frame, corners: Floats, faces: Integers, largest: float) -> float:
    """Return the largest distance of the surface from the points; refuse the cloud if it is too large."""
    sides, many = np.unique(
        np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2), axis=0, return_counts=True
    )
    border = np.unique(sides[many == 1])
    # the hole of an open surface is widest at the center of its border
    middle = corners[border].mean(axis=0, keepdims=True) if len(border) else np.zeros((0, 3))
    places = frame.back(np.concatenate([corners, corners[faces].mean(axis=1), middle]))
    distance = load("scipy.spatial").cKDTree(cloud.points).query(places)[0]
    worst = int(distance.argmax())
    hole, spacing = float(distance[worst]), cloud.spacing
    if hole > largest * spacing:
        where = ", ".join(f"{value:.4g}" for value in places[worst])
        raise InputError(
            f"{cloud.name} is too sparse to close: around ({where}) no point lies within {hole:.4g}, which is "
            f"{hole / spacing:.1f} of its spacings of {spacing:.4g}, and max_gap is {largest:g}; scan that side, "
            "take stray points away with without_outliers, or raise max_gap"
        )
    return hole


def _refuse_far(cloud: Cloud, apart: Floats, largest: float) -> None:
    """Refuse a surface that is far from some points."""
    worst, limit = int(apart.argmax()), largest * cloud.spacing
    if apart[worst] > limit:
        where = ", ".join(f"{value:.4g}" for value in cloud.points[worst])
        raise InputError(
            f"{cloud.name} has {int((apart > limit).sum())} of {len(apart)} points further than {limit:.4g} from the "
            f"surface, the farthest {apart[worst]:.4g} at ({where}), and max_gap is {largest:g} spacings; take "
            "bodies apart with clusters, or stray points away with without_outliers"
        )


def _closed(corners: Floats, faces: Integers, name: str, unit: str | None) -> tuple[Shape, tuple[str, ...]]:
    """Return the shape of a surface, repaired if it is not closed, and the repairs."""
    if bounds_solid(corners, faces):
        return Shape.from_mesh(corners, faces, name=name, unit=unit), ()
    try:
        mended = repair(corners, faces, bodies="largest", max_hole=1.0, name=name, unit=unit)
    except DirtyMeshError as error:
        raise DirtyMeshError(
            f"no surface comes of the cloud, scan more finely or try the other method: {error}"
        ) from None
    return mended.shape, mended.sentences


def _distances(shape: Shape, points: Floats) -> Floats:
    """Return the distances of points, in the frame of the cloud, from the surface of a shape."""
    corners, faces, _ = shape.geometry.tessellation()
    frame = Frame.around(corners)
    open3d = load("open3d")
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(frame.into(corners).astype(np.float32)), open3d.core.Tensor(faces.astype(np.uint32))
    )
    inside = frame.into(points - np.array(shape.offset)).astype(np.float32)
    return np.asarray(scene.compute_distance(open3d.core.Tensor(inside)).numpy() * frame.size, dtype=np.float64)
