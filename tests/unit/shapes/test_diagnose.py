import math

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

from voxgran._base.errors import DirtyMeshError, InputError
from voxgran._base.seeds import stream
from voxgran.geometry.crossing import DEPTH, count_crossings, is_crossing
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.lattice.cuberille import voxel_surface
from voxgran.shapes.family import make_shape
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.diagnose import Diagnosis, diagnose, merged, refuse_dirty
from voxgran.shapes.repairing.repair import parted
from voxgran.shapes.shells import edge_faults, half_edges, shell_labels, without_unused
from voxgran.shapes.tessellate import revolved, sphere, unit_box

BOX = unit_box()[:2]
BALL = sphere(2)[:2]


def joined(*meshes):
    """Put meshes into one, vertices unmerged."""
    starts = np.cumsum([0, *(len(v) for v, _ in meshes)])
    return (
        np.concatenate([v for v, _ in meshes]),
        np.concatenate([f + s for (_, f), s in zip(meshes, starts, strict=False)]),
    )


def moved(mesh, *, by=(0, 0, 0), times=1.0, flip=False):
    """Return a mesh stretched, shifted and turned inside out where asked."""
    vertices, faces = mesh
    return vertices * times + np.array(by), faces[:, ::-1] if flip else faces


def torus(major=1.0, minor=0.3, n=40, m=24):
    """Return vertices and faces of a torus."""
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    r = major + minor * np.cos(v)
    vertices = np.stack([r * np.cos(u), r * np.sin(u), minor * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a, b = (i * m + j).ravel(), ((i + 1) % n * m + j).ravel()
    c, d = ((i + 1) % n * m + (j + 1) % m).ravel(), (i * m + (j + 1) % m).ravel()
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


GOOD = {
    "box": BOX,
    "sphere": BALL,
    "fine sphere": sphere(4)[:2],
    "torus": torus(),
    "thin torus": torus(minor=1e-4),
    "cylinder": revolved([(-0.5, 0.5), (0.5, 0.5)])[:2],
    "cone with a fan at its tip": revolved([(-0.5, 0.5), (0.5, 0.0)], sides=300)[:2],
    "plate": moved(BOX, times=np.array([1.0, 1.0, 1e-6])),
    "needle": moved(BALL, times=np.array([1.0, 1e-5, 1e-5])),
    "hollow sphere": joined(BALL, moved(BALL, times=0.5, flip=True)),
    "thin shell": joined(BALL, moved(BALL, times=1 - 1e-6, flip=True)),
    "four holes": joined(
        BOX, *(moved(BALL, times=0.1, by=(0.2 * x, 0.2 * y, 0), flip=True) for x in (-1, 1) for y in (-1, 1))
    ),
}


@pytest.mark.parametrize("frame", ["as it is", "turned", "far", "tiny", "huge"])
@pytest.mark.parametrize("name", GOOD)
def test_good_meshes_are_good_in_any_frame(name, frame):
    vertices, faces = GOOD[name]
    if frame == "turned":
        vertices = vertices @ rotation_matrices(random_rotations(stream(0, name), 1))[0].T
    elif frame == "far":
        # plates and shells a millionth thick keep a digit of their thickness there
        vertices = vertices + np.array([1e3, -2e3, 3e3])
    elif frame in ("tiny", "huge"):
        vertices = vertices * {"tiny": 1e-12, "huge": 1e12}[frame]
    found = diagnose(vertices, faces)
    assert found.sentences() == []
    assert found.ok
    assert found.closed
    assert found.bodies == 1


def test_random_grains_are_good():
    for seed in range(3):
        for family in ("convex_polyhedron", "solid_union"):
            assert diagnose(make_shape(family, seed=seed)).ok


def test_cavities_are_counted():
    assert diagnose(*GOOD["hollow sphere"]).cavities == 1
    assert diagnose(*GOOD["four holes"]).cavities == 4


BAD = [
    ("a face left out", (BOX[0], BOX[1][1:]), {"open_edges": 3}, "3 open edges"),
    (
        "one face turned over",
        (BALL[0], np.vstack([BALL[1][:1, ::-1], BALL[1][1:]])),
        {"flipped_faces": 1},
        "1 faces wound",
    ),
    ("inside out", moved(BALL, flip=True), {"inside_out": 1}, "point inward"),
    ("apart", joined(BOX, moved(BOX, by=(3, 0, 0))), {"bodies": 2}, "2 separate bodies"),
    ("apart and turned over", joined(BOX, moved(BOX, by=(3, 0, 0), flip=True)), {"inside_out": 1}, "point inward"),
    (
        "solid in solid",
        joined(BALL, moved(BALL, times=0.5)),
        {"outward_inner_shells": 1},
        "inner shells that point outward",
    ),
    (
        "island in a cavity",
        joined(BALL, moved(BALL, times=0.5, flip=True), moved(BALL, times=0.2)),
        {"bodies": 2, "cavities": 1},
        "2 separate bodies",
    ),
    ("edge in common", joined(BOX, moved(BOX, by=(1, 1, 0))), {"non_manifold_edges": 1}, "without exactly two"),
    ("twice the same", joined(BOX, BOX), {"non_manifold_edges": 18}, "without exactly two"),
    ("flat", (BOX[0] * [1, 1, 0], BOX[1]), {}, ""),
    ("two faces", (np.eye(3), np.array([[0, 1, 2], [0, 2, 1]])), {"zero_volume": 1}, "without volume"),
    ("no faces", (np.eye(3), np.zeros((0, 3), dtype=int)), {"faces": 0}, "no faces"),
    ("not finite", (np.full((8, 3), np.nan), BOX[1]), {"not_finite": 24}, "not finite"),
]


@pytest.mark.parametrize(("mesh", "counts", "text"), [row[1:] for row in BAD], ids=[row[0] for row in BAD])
def test_bad_meshes_are_named(mesh, counts, text):
    found = diagnose(*mesh)
    assert not found.ok
    for name, value in counts.items():
        assert getattr(found, name) == value, name
    assert any(text in sentence for sentence in found.sentences())
    for sentence in found.sentences("stone.stl"):
        assert sentence.startswith("stone.stl has ")
        assert ": " in sentence
        assert "; " in sentence


CROSSING = {
    "boxes": joined(BOX, moved(BOX, by=(0.5, 0.5, 0.5))),
    "boxes in line": joined(BOX, moved(BOX, by=(0.5, 0, 0), times=np.array([1.0, 0.5, 0.5]))),
    "a little": joined(BALL, moved(BALL, by=(1.99, 0, 0))),
    "tori": joined(torus(), moved(torus(), by=(0.2, 0, 0))),
}


@pytest.mark.parametrize("name", CROSSING)
def test_shells_that_cut_each_other_are_found(name):
    assert diagnose(*CROSSING[name]).self_intersections > 0


@pytest.mark.parametrize("depth", [0.3, 1e-3, 1e-6])
def test_a_vertex_pushed_through_the_other_side_is_found(depth):
    vertices, faces = sphere(3)[:2]
    vertices = vertices.copy()
    k = int(vertices[:, 2].argmax())
    opposite = faces[vertices[faces].mean(axis=1)[:, 2].argmin()]
    vertices[k] = vertices[opposite].mean(axis=0) * (1 + depth)
    assert count_crossings(vertices, faces) > 0
    vertices[k] = vertices[opposite].mean(axis=0) * (1 - depth)
    assert count_crossings(vertices, faces) == 0


def test_touching_does_not_count_and_a_push_does():
    one, two = BOX, moved(BOX, by=(1.0, 0.1, 0.2))
    assert count_crossings(*joined(one, two)) == 0
    pushed = moved(BOX, by=(1.0 - 1e-6, 0.1, 0.2))
    assert count_crossings(*joined(one, pushed)) > 0


def separated(one, two):
    """The separating axis test in NumPy; also the twin of the kernel."""
    e, f = np.roll(one, -1, axis=0) - one, np.roll(two, -1, axis=0) - two
    axes = [np.cross(e[0], e[1]), np.cross(f[0], f[1]), *(np.cross(a, b) for a in e for b in f)]
    for axis in axes:
        length = np.linalg.norm(axis)
        if length > 1e-9:
            p, q = (one - one[0]) @ axis, (two - one[0]) @ axis
            if min(p.max() - q.min(), q.max() - p.min()) <= DEPTH * length:
                return True
    return False


def pierces(one, two):
    """Return whether an edge of one triangle goes through the other."""
    for a, b in ((one, two), (two, one)):
        for k in range(3):
            p, d = a[k], a[(k + 1) % 3] - a[k]
            system = np.column_stack([b[1] - b[0], b[2] - b[0], -d])
            if abs(np.linalg.det(system)) > 1e-14:
                u, v, t = np.linalg.solve(system, p - b[0])
                if min(u, v, 1 - u - v, t, 1 - t) > 1e-12:  # a corner in common is none
                    return True
    return False


def test_pair_test_agrees_with_edges_that_pierce_faces():
    corners = stream(3, "pairs").random((400, 2, 3, 3)) * 0.6
    corners[200:, 1, 0] = corners[200:, 0, 0]  # a corner in common
    got = np.array([is_crossing(one, two, DEPTH) for one, two in corners])
    assert 50 < got.sum() < 350
    assert (got == [not separated(one, two) for one, two in corners]).all()
    assert (got == [pierces(one, two) for one, two in corners]).all()


def test_count_agrees_with_all_pairs():
    corners = stream(4, "soup").random((60, 1, 3)) + 0.3 * stream(5, "soup").standard_normal((60, 3, 3))
    diagonal = np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0))
    expected = sum(not separated(corners[i] / diagonal, corners[j] / diagonal) for i in range(60) for j in range(i))
    assert expected > 20
    assert count_crossings(corners.reshape(-1, 3), np.arange(180).reshape(-1, 3)) == expected


@pytest.mark.parametrize("thin", [1e-3, 1e-8, 1e-13, 0.0])
def test_count_of_needles_agrees_with_all_pairs(thin):
    corners = stream(4, "soup").random((60, 1, 3)) + 0.5 * stream(5, "soup").standard_normal((60, 3, 3))
    corners[::2, 2] = corners[::2, 1] + thin * (corners[::2, 2] - corners[::2, 1])
    corners -= (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    corners /= np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0))
    expected = sum(is_crossing(corners[i], corners[j], DEPTH) for i in range(60) for j in range(i))
    assert expected > 10
    assert count_crossings(corners.reshape(-1, 3), np.arange(180).reshape(-1, 3)) == expected


def test_merging_makes_equal_corners_one_and_keeps_the_order():
    vertices, faces = BALL
    soup = vertices[faces].reshape(-1, 3)
    corners, triangles = merged(soup, np.arange(len(soup)).reshape(-1, 3))
    assert len(corners) == len(vertices)
    assert (corners[triangles] == vertices[faces]).all()
    assert (corners[0] == soup[0]).all()


def test_merging_welds_what_differs_by_rounding_and_leaves_the_rest():
    soup = BOX[0][BOX[1]].reshape(-1, 3)
    noise = 1e-14 * stream(6, "noise").standard_normal(soup.shape)
    corners, triangles = merged(soup + noise, np.arange(36).reshape(-1, 3))
    assert len(corners) == 8
    assert diagnose(corners, triangles).ok
    assert len(merged(soup + 1e5 * noise, np.arange(36).reshape(-1, 3))[0]) == 36
    assert (
        len(merged(np.array([[0.0, 0, 0], [-0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 2, 3], [1, 3, 2]]))[0])
        == 3
    )


def test_merging_drops_lines_where_the_surface_stays_closed():
    vertices, faces = unit_box()[:2]
    # the middle of an edge, doubled: a sliver without area between two triangles
    a, b, c = faces[0]
    vertices = np.vstack([vertices, vertices[a]])
    split = np.vstack([[8, b, c], faces[1:], [[8, a, b], [a, 8, c]]])
    corners, triangles = merged(vertices, split)
    assert len(triangles) == 12
    assert diagnose(corners, triangles).ok
    opened = np.vstack([faces[1:], [[8, a, b]]])
    assert len(merged(vertices, opened)[1]) == 12  # nothing is dropped where it would hide an opening
    assert not diagnose(vertices, opened).ok


def test_unused_corners_are_left_out():
    corners, triangles = merged(np.vstack([[[9.0, 9, 9]], BOX[0]]), BOX[1] + 1)
    assert len(corners) == 8
    assert triangles.max() == 7
    empty = merged(BOX[0], np.zeros((0, 3), dtype=np.int64))
    assert len(empty[0]) == len(empty[1]) == 0


def test_flipped_faces_are_counted_against_the_majority():
    vertices, faces = BALL
    turned = faces.copy()
    turned[:30] = turned[:30, ::-1]
    assert diagnose(vertices, turned).flipped_faces == 30
    turned[:300] = turned[:300, ::-1]
    # the first 30 are as they were again, 270 of 320 are turned: 50 are the minority
    assert diagnose(vertices, turned).flipped_faces == 50


def test_shapes_are_taken():
    shape = make_shape("box")
    assert diagnose(shape) == Diagnosis(faces=12, bodies=1)


def test_refusing_names_the_gravest_reason():
    refuse_dirty(*BOX, "box")
    said = (
        "stone has 3 open edges: a grain must be a closed surface; use vg.repair, or use Shape.from_surface where it is"
    )
    with pytest.raises(DirtyMeshError, match=f"^{said} to stay open$"):
        refuse_dirty(BOX[0], BOX[1][1:], "stone")
    with pytest.raises(DirtyMeshError, match=r"2 separate bodies: .*; use vg\.repair with bodies='largest' or"):
        refuse_dirty(*joined(BOX, moved(BOX, by=(3, 0, 0))), "stones")


@pytest.mark.parametrize(
    "arguments", [([1, 2, 3],), (np.zeros((3, 2)), [[0, 1, 2]]), (np.zeros((3, 3)), [[0, 1, 3]]), ("box",)]
)
def test_what_is_no_mesh_is_refused(arguments):
    with pytest.raises(InputError):
        diagnose(*arguments)


def test_depth_is_relative():
    one, two = BOX, moved(BOX, by=(1 - 1e-4, 0.1, 0.2))
    mesh = joined(one, two)
    counts = {count_crossings(mesh[0] * factor + shift, mesh[1]) for factor, shift in [(1, 0), (1e-9, 0), (1e9, 7.0)]}
    assert len(counts) == 1
    assert math.prod(counts) > 0


def chain():
    """Return five cubes in a chain, the first and the last of which share an edge only, with its ends doubled."""
    mask = np.zeros((2, 2, 2), dtype=bool)
    for place in [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (1, 1, 0)]:
        mask[place] = True
    return voxel_surface(mask)


def test_a_solid_that_touches_itself_along_an_edge_keeps_its_doubled_vertices():
    vertices, faces = chain()
    assert diagnose(vertices, faces).ok
    shape = Shape.from_mesh(vertices, faces)
    assert shape.volume == pytest.approx(5.0, rel=1e-14)
    assert shape.surface_area == pytest.approx(22.0, rel=1e-14)
    dirty = merged(vertices, faces)
    # the middle of the edge has two vertices, too
    assert diagnose(*dirty).non_manifold_edges == 2
    with pytest.raises(DirtyMeshError, match="2 edges without exactly two faces"):
        Shape.from_mesh(*dirty)


def test_two_solids_that_touch_are_not_one():
    box = unit_box()[:2]
    both = joined(box, moved(box, by=(1, 1, 0)))
    assert diagnose(*both).non_manifold_edges == 1
    with pytest.raises(DirtyMeshError):
        Shape.from_mesh(*both)


@pytest.mark.parametrize("seed", range(4))
def test_touching_edges_are_parted_without_a_change_of_the_surface(seed):
    turn = rotation_matrices(random_rotations(stream(seed, "turn"), 1))[0]
    vertices, faces = chain() if seed else voxel_surface(stream(0, "voxels").random((5, 5, 5)) < 0.6)
    vertices = vertices @ turn.T + seed
    corners, triangles = parted(*merged(vertices, faces))
    assert edge_faults(triangles, len(corners)).tolist() == [0, 0, 0]
    before, after = Mesh(vertices, faces), Mesh(corners, triangles)
    assert after.volume == pytest.approx(before.volume, rel=1e-12)
    assert after.surface_area == pytest.approx(before.surface_area, rel=1e-12)
    # no two cubes are joined that share no face, and no vertex is at a new place but the middles of edges
    assert (shell_labels(corners, triangles).max() == shell_labels(vertices, faces).max()) or not seed
    assert parted(*(merged(vertices, faces)[0], merged(vertices, faces)[1][1:])) is None


def test_faces_that_lie_on_each_other_are_not_parted():
    box = unit_box()[:2]
    assert parted(*merged(*joined(box, box))) is None


def test_edges_and_used_points_are_those_of_numpy():
    faces = np.random.default_rng(0).integers(0, 40, (500, 3)) * 2
    start, end, edge, uses = half_edges(faces, 80)
    ends = np.sort(np.column_stack([start, end]), axis=1)
    _, expected, counts = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    assert np.array_equal(edge, expected.ravel())
    assert np.array_equal(uses, counts)
    points = np.random.default_rng(1).random((80, 3))
    used, index = np.unique(faces, return_inverse=True)
    kept, renumbered = without_unused(points, faces)
    assert np.array_equal(kept, points[used])
    assert np.array_equal(renumbered, index.reshape(-1, 3))
    assert [len(part) for part in half_edges(faces[:0], 3)] == [0, 0, 0, 0]


@pytest.mark.parametrize("weld", [1e-12, 0.02])
def test_points_are_merged_as_by_all_distances(weld):
    points = np.random.default_rng(2).random((303, 3))
    points = np.concatenate([points, points[::3], points[1::3] + 1e-14, [[0.0] * 3, [-0.0] * 3]])
    points = points[np.random.default_rng(3).permutation(len(points))]
    merged_points, faces = merged(points, np.arange(len(points)).reshape(-1, 3), weld=weld)
    reach = weld * np.linalg.norm(np.ptp(points, axis=0))
    near = np.linalg.norm(points[:, None] - points, axis=2) <= reach
    first = connected_components(near)[1]
    _, leader, label = np.unique(first, return_index=True, return_inverse=True)
    got = faces.ravel()
    assert len(merged_points) == len(leader)
    # the first point of each set stands for it, in their order
    assert np.array_equal(merged_points[got], (points + 0.0)[leader[label]])
    assert np.array_equal(np.unique(got, return_index=True)[1], np.sort(leader))
