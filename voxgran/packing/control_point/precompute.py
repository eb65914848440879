"""What follows from a problem for control-point packing: points, trees, fields, walls, cells of grains, cache."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran._base.seeds import philox_key
from voxgran.containers.gravity import gravity_vector, main_axis
from voxgran.containers.model import boundary_of
from voxgran.packing.control_point.attempts import link_all, span_all
from voxgran.packing.control_point.distance_fields import MARGIN, Fields, make_fields, make_reaches, no_reaches
from voxgran.packing.control_point.parameters import ControlPoint
from voxgran.packing.control_point.point_trees import make_trees, stack_room
from voxgran.packing.control_point.records import (
    BALL,
    FLAT,
    KDTREE,
    KEEP_OUT,
    MESH,
    RADIUS,
    ROUND,
    SDF,
    Bodies,
    Cells,
    CloseLists,
    GrainPoses,
    PairCache,
    Pairs,
    Scratch,
    Walls,
)
from voxgran.packing.control_point.state import ControlState
from voxgran.packing.control_point.verlet_lists import MOST_GRAINS, ROOM, make_lists
from voxgran.packing.problem import Problem
from voxgran.points.control import inner_count, inner_points, sample_controls
from voxgran.points.sample import SurfacePoints
from voxgran.shapes.describing.curvature import largest_curvature
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.model import Shape

#: numbers of the tests of contact
TESTS = {"sdf": SDF, "kdtree": KDTREE}
#: edges of a cell of a lattice of distances in a spacing: its error is then small beside that of the points
CELLS_IN_SPACING = 3.0
#: longest edge of a cell, in diameters: distances on wide cells tell little of places between
WIDEST_CELL = 0.07
#: control points that are listed for a pair of near grains, and pairs for which there are lists
LISTED, MOST_PAIRS = 64, 2**17
#: factor on what control points keep where there are open surfaces, so that no step carries one through another, and
#: how long a way, in c, at least is that begins and ends KEPT c from a point and comes nearer than c
KEPT = 1.05
WAY = 2.0 * (KEPT**2 - 1.0) ** 0.5
#: ratio of the spacings of points on closed meshes
STEP = 1.02
#: extent of a surface out of its plane, in that along it, below which it is flat
FLAT_SHARE = 1e-9


@dataclass(frozen=True, slots=True)
class Precomputed:
    """What follows from the problem, and the cells and walls where the grains are linked; as the kernels take it."""

    bodies: Bodies
    extent: Floats
    span: Floats
    walls: Walls
    cells: Cells
    lists: CloseLists
    cache: PairCache
    scratch: Scratch
    key: Any  # of the random numbers


def precomputed_of(problem: Problem, state: ControlState) -> Precomputed:
    """Return what follows from the problem, made again where the state is new or was read from a checkpoint."""
    if "precomputed" not in state.derived:
        bodies = _bodies(problem)
        key = philox_key(problem.seed, "control_point")
        extent = _extent(problem, bodies)
        cells, lists = _cells(problem, extent)
        scratch = _scratch(problem, bodies, cells)
        span = np.zeros((problem.count if len(bodies.reaches.values) else 0, 6))
        made = Precomputed(bodies, extent, span, _walls(problem), cells, lists, _pair_cache(problem), scratch, key)
        put_lid(problem, made.walls, state.lid_lowered)
        grains = pairs_of(problem, state, made).grains
        link_all(grains, made.cells)
        span_all(grains, bodies, scratch)
        state.derived["precomputed"] = made
    kept: Precomputed = state.derived["precomputed"]
    return kept


def pairs_of(problem: Problem, state: ControlState, setting: Precomputed) -> Pairs:
    """Return what the comparison of two grains reads and writes, the arrays of the state among them."""
    poses = (state.position, state.orientation, state.entered, state.step)
    kinds = (problem.shape_id.astype(np.int64), problem.diameter.astype(np.float64))
    gap = problem.length(problem.parameters.distance - problem.parameters.overlap)
    grains = GrainPoses(*poses, *kinds, setting.extent, setting.span, state.lifted)
    return Pairs(grains, setting.bodies, setting.cache, setting.scratch, gap)


def put_lid(problem: Problem, walls: Walls, lowered: float) -> None:
    """Move the lid, the wall opposite to gravity, to a distance below its first position."""
    down = main_axis(gravity_vector(problem))
    lower, upper = problem.container.bounds
    walls.lower[:] = lower + lowered * np.maximum(down, 0)
    walls.upper[:] = upper + lowered * np.minimum(down, 0)


def memory_needed(problem: Problem) -> int:
    """Return how many bytes the setting takes at the most, before anything is made."""
    settings: ControlPoint = problem.parameters
    wall = _wall_of(problem)
    solids = [*problem.shapes, *([] if wall is None else [wall])]
    total = 0.0
    for solid in solids:
        # points that keep apart and cover at this spacing; 24 bytes each, as much in the tree, and their probes
        flat_wall = solid is wall and problem.dimension == 2
        surface = _edge_lengths(problem).sum() if flat_wall else solid.surface_area
        points = 16 + 5 * surface / settings.spacing ** (problem.dimension - 1)
        points += inner_count(solid, spacing=settings.spacing) if settings.points == "all" else 0.0
        faces = len(solid.geometry.faces) if isinstance(solid.geometry, Mesh | Surface) else 5000
        total += points * (24 * 40 + 48) + faces * (72 + 3 * 24)
    if settings.contact == "sdf":
        # 4 bytes a node, and its place and distance while they are made
        widest = 2 * max(shape.bounding_radius for shape in problem.shapes) + settings.spacing
        across = widest / _cell_edge(settings.spacing) + 2 * MARGIN + 2
        total += len(problem.shapes) * 4 * across**3 + 60 * across**3
    listed = LISTED if settings.contact != "sdf" else 0
    # where the grain reaches, and its list of near ones
    near = 4 * ROOM + 32 if problem.count <= MOST_GRAINS else 0
    return int(total) + _cached_pairs(problem) * (listed * 16 + 160) + problem.count * (near + 112)


def _pair_cache(problem: Problem) -> PairCache:
    """Return an empty cache with room for the neighbours of all grains."""
    room = _cached_pairs(problem)
    listed = LISTED if problem.parameters.contact != "sdf" else 0
    lists = np.zeros((room if listed else 0, listed, 2), dtype=np.int64)
    return PairCache(np.full((room, 4), -1, dtype=np.int64), np.zeros((room, 16)), lists)


def _cached_pairs(problem: Problem) -> int:
    """Return for how many pairs there is a cache, a power of two."""
    return min(MOST_PAIRS, 1 << int(np.ceil(libm.log2(16 * max(problem.count, 1)))))


def _scratch(problem: Problem, bodies: Bodies, cells: Cells) -> Scratch:
    """Return room for what the kernels try: neighbours are all grains in all images within reach, at the most."""
    room = stack_room(bodies.trees)
    lengths = (cells.width * cells.count)[list(problem.container.periodic)]
    images = int(np.prod(2 * np.ceil(2 * cells.reach / lengths) + 1))
    return Scratch(
        *(np.zeros(3), np.zeros(4), np.zeros((3, 3)), np.zeros(6)),
        *(np.zeros(7), np.zeros(4), np.zeros((3, 3)), np.zeros(3)),
        *(np.zeros((room, 2), dtype=np.int64), np.zeros((LISTED, 2), dtype=np.int64)),
        np.zeros((images * problem.count, 4), dtype=np.int64),
    )


def _extent(problem: Problem, bodies: Bodies) -> Floats:
    """Return the extents of the grains, (n, 9), by the columns of :mod:`voxgran.packing.control_point.records`."""
    known = len(problem.shapes)
    inner = [shape.volume / shape.surface_area for shape in problem.shapes]
    curvature = [largest_curvature(shape.geometry) for shape in problem.shapes]
    smooth = np.array([bend is not None for bend in curvature], dtype=np.bool_)
    error = np.array([_point_error(shape) for shape in problem.shapes])
    error += bodies.fields.error if len(bodies.fields.error) else 0.0
    unit = np.column_stack([bodies.radius[:known], bodies.spacing[:known] / 2, inner, np.where(smooth, error, 0.0)])
    radius, half, inside, slack = (unit[problem.shape_id] * problem.diameter[:, None]).T
    if any(shape.is_open for shape in problem.shapes):
        inside = _open_ways(problem, bodies, half / KEPT)
    bend = np.array([-1.0 if bend is None else bend for bend in curvature])[problem.shape_id] / problem.diameter
    most, loosest = float(np.maximum(bend, 0.0).max(initial=0.0)), float(slack.max(initial=0.0))
    # what bulges between points, or has to be kept off from thin grains; no more than half the spacing
    bulge = 0.5 * half**2 * (np.maximum(bend, 0.0) + most) + slack + loosest
    room = np.minimum(np.maximum(bulge, half - float(inside.min(initial=np.inf))), half + slack + loosest)
    room = room if problem.parameters.contact == "sdf" else half
    reaches, stretch, limit = bodies.reaches, np.ones(problem.count), np.zeros(problem.count)
    if len(reaches.values):
        stretch, limit = reaches.stretch[problem.shape_id], reaches.limit[problem.shape_id] * problem.diameter
    # spheres of a start may touch: they are compared by their centers
    sphere = np.array([shape.is_sphere for shape in problem.shapes], dtype=np.float64)[problem.shape_id]
    exact = sphere if problem.start is not None else np.zeros(problem.count)
    return np.ascontiguousarray(np.column_stack([radius, half, inside, bend, slack, room, stretch, limit, exact]))


def _open_ways(problem: Problem, bodies: Bodies, cover: Floats) -> Floats:
    """Return how far the points of grains may move in a step where there are open surfaces, (n,).

    Points that are kept KEPT times the sum of two covering radii (n,) apart then pass each other at more than that sum
    all along the way, so that what they cover does not cross; the least of all radii stands for that of the partner.
    """
    least = float(cover.min(initial=np.inf))
    if boundary_of(problem.container).solid is not None:
        least = min(least, float(bodies.spacing[-1]) / (2 * KEPT))
    return WAY * (cover + least)


def _point_error(shape: Shape) -> float:
    """Return how far control points may lie from the true surface."""
    smooth = ("sphere", "ellipsoid", "spherocylinder", "disk")
    return 0.0 if getattr(shape.geometry, "kind", "") in smooth else shape.tessellation_error


def _bodies(problem: Problem) -> Bodies:
    """Sample the shapes, and the container where it is a mesh, and plant their trees."""
    settings: ControlPoint = problem.parameters
    samples: list[Any] = [problem.points(k, settings.spacing) for k in range(len(problem.shapes))]
    solids = list(problem.shapes)
    wall = _wall_of(problem)
    if wall is not None:
        solids.append(wall)
        samples.append(_edge_points(problem) if problem.dimension == 2 else _wall_points(problem))
    # points of a curved shape lie on its tessellation, and that lies near the true surface
    kept = KEPT if any(shape.is_open for shape in problem.shapes) else 1.0
    spacing = [
        kept * (points.spacing + 2 * solid.tessellation_error) for points, solid in zip(samples, solids, strict=True)
    ]
    hulls, margins = zip(*(_hull(shape) for shape in problem.shapes), strict=True)
    # what holds nothing has no triangles that could tell inside from outside
    triangles = [solid.vertices[solid.faces[: 0 if solid.is_open else None]] for solid in solids]
    fields = _fields(problem, samples)
    controls = [np.asarray(points) for points in samples]
    if settings.points == "all":
        for k, solid in enumerate(problem.shapes):
            controls[k] = np.concatenate([controls[k], inner_points(solid, spacing=settings.spacing)])
    trees, known = make_trees(controls), controls[: len(problem.shapes)]
    spheres = all(shape.is_sphere for shape in problem.shapes)
    return Bodies(
        TESTS[settings.contact],
        settings.tested_points == "both",
        trees,
        fields,
        no_reaches() if spheres else make_reaches(list(problem.shapes), known, fields),
        np.array([solid.bounding_radius for solid in solids]),
        np.array(spacing),
        *(np.concatenate(hulls), _starts(hulls)),
        np.array(margins),
        *(np.concatenate(triangles), _starts(triangles)),
    )


def _wall_of(problem: Problem) -> Shape | None:
    """Return the closed mesh that is the container, in 2D the triangles of a polygon; None of other containers."""
    wall = boundary_of(problem.container).solid
    if wall is None or problem.dimension == 3:
        return wall
    return Shape(Mesh(*problem.container.mesh()), wall.name)


def _wall_points(problem: Problem) -> SurfacePoints:
    """Return points on the closed mesh that is the container.

    The mesh is sampled in the user's unit, with a seed of its own and a spacing that changes in steps, so that other
    packings in the same container, also of grains of another median diameter, mostly find the same points in memory.
    """
    known, unit = (problem.given, problem.unit_length) if problem.given is not None else (problem.container, 1.0)
    wall = boundary_of(known).solid
    assert wall is not None
    steps = math.floor(math.log(problem.parameters.spacing * unit / wall.diameter, STEP))
    points = sample_controls(wall, spacing=wall.diameter * STEP**steps)
    return SurfacePoints.from_points(np.asarray(points) / unit, points.spacing / unit)


def _edge_lengths(problem: Problem) -> Floats:
    """Return the lengths of the edges of a polygon."""
    loops = boundary_of(problem.container).loops
    return np.concatenate([linear.norm(np.roll(loop, -1, axis=0) - loop, axis=1) for loop in loops])


def _edge_points(problem: Problem) -> SurfacePoints:
    """Return points on the edges of a polygon, its corners among them, at most the spacing apart."""
    loops = boundary_of(problem.container).loops
    start, way = np.concatenate(loops), np.concatenate([np.roll(loop, -1, axis=0) - loop for loop in loops])
    parts = np.ceil(_edge_lengths(problem) / problem.parameters.spacing).astype(np.int64)
    share = np.concatenate([np.arange(part) / part for part in parts])
    points = np.repeat(start, parts, axis=0) + share[:, None] * np.repeat(way, parts, axis=0)
    apart = float((_edge_lengths(problem) / parts).max())
    return SurfacePoints.from_points(np.column_stack([points, np.zeros(len(points))]), apart)


def _fields(problem: Problem, samples: list[Any]) -> Fields:
    """Return the fields of the shapes, none where points are compared with points."""
    settings: ControlPoint = problem.parameters
    if settings.contact != "sdf":
        return make_fields([], [], cell=1.0)
    least = float(problem.diameter.min(initial=np.inf))
    reach = problem.length(settings.distance) / least if np.isfinite(least) else 0.0
    points = [np.asarray(sample) for sample in samples]
    depth = problem.length(settings.overlap) / least if np.isfinite(least) else 0.0
    # points keep off thin grains by half the spacing at the most
    margin, cell = settings.spacing / 2, _cell_edge(settings.spacing)
    return make_fields(list(problem.shapes), points, cell=cell, reach=reach, depth=depth, margin=margin)


def _cell_edge(spacing: float) -> float:
    """Return the wanted edge of the cells of fields."""
    return min(spacing / CELLS_IN_SPACING, WIDEST_CELL)


def _hull(shape: Shape) -> tuple[Floats, float]:
    """Return points, (n, 3), and a room around them whose convex hull holds a shape: of a sphere, its center."""
    if shape.is_sphere:
        return np.zeros((1, 3)), shape.bounding_radius
    corners = shape.vertices[:, : shape.dimension]
    if shape.is_open:
        corners = _spread(corners)
    hull = load("scipy.spatial").ConvexHull(corners).vertices
    return np.ascontiguousarray(shape.vertices[hull]), shape.tessellation_error


def _spread(corners: Floats) -> Floats:
    """Return corners, (n, 3), as they are, or in two coordinates where all lie in a plane."""
    middle = corners - corners.mean(axis=0)
    axes = linear.svd(middle)
    return corners if axes[1][2] > FLAT_SHARE * axes[1][0] else linear.matmul(middle, axes[2][:2].T)


def _starts(parts: Sequence[Floats]) -> Integers:
    """Return where each part begins when all lie one after another, and where the last one ends."""
    return np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)


def _walls(problem: Problem) -> Walls:
    """Return the walls of the container."""
    container = problem.container
    lower, upper = (np.array(corner, dtype=np.float64) for corner in container.bounds)
    periodic = np.array(container.periodic, dtype=np.int64)
    walled = np.where(np.arange(3) < problem.dimension, 1 - periodic, 0).astype(np.int64)
    boundary = boundary_of(container)
    kind, radius, offset = FLAT, 0.0, np.zeros(3)
    if boundary.solid is not None:
        kind, offset = MESH, np.array(boundary.solid.offset)
    elif wall := boundary.cylinder or boundary.sphere:
        kind, radius, offset = ROUND if wall.axes == 2 else BALL, float(wall.radius), (lower + upper) / 2
    return Walls(kind, lower, upper, walled, periodic, radius, offset, bool(problem.parameters.lid))


def _cells(problem: Problem, extent: Floats) -> tuple[Cells, CloseLists]:
    """Lay out empty cells and lists; cells are as wide as a grain, since looking into many small ones takes longer."""
    lower, upper = problem.container.bounds
    span = np.where(np.arange(3) < problem.dimension, upper - lower, 1.0)
    least = (np.prod(span) / (64 * problem.count)) ** (1 / problem.dimension)
    count = np.maximum(np.floor(span / max(2.0 * float(np.median(extent[:, RADIUS])), least)), 1).astype(np.int64)
    reach = float(extent[:, RADIUS].max() + 2 * extent[:, KEEP_OUT].max()) + problem.length(problem.parameters.distance)
    head = np.full(int(np.prod(count)), -1, dtype=np.int64)
    radius, periodic = float(extent[:, RADIUS].max()), np.array(problem.container.periodic)
    lists = make_lists(problem.count, (upper - lower)[periodic], radius + reach, radius)
    return Cells(lower.copy(), span / count, count, head, np.full(problem.count, -1, dtype=np.int64), reach), lists
