"""Repair: what is certain is mended exactly, what is not is refused with the reason."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import voxgran as vg
from voxgran._base.errors import DirtyMeshError, InputError
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.shapes.formats.mesh_files import read_surface
from voxgran.shapes.repairing.diagnose import diagnose
from voxgran.shapes.repairing.holes import closed_loop, hole_loops
from voxgran.shapes.repairing.repair import repair
from voxgran.shapes.tessellate import unit_box


@pytest.fixture(scope="module")
def rock(data_dir):
    shape = vg.load_shape(data_dir / "bennu_lp.obj")
    return shape.vertices, shape.faces, shape.volume


def box(*, edge=1.0, at=(0.0, 0.0, 0.0)):
    vertices, faces, _ = unit_box()
    return edge * vertices + np.array(at), faces


def both(one, other):
    return np.concatenate([one[0], other[0]]), np.concatenate([one[1], other[1] + len(one[0])])


def test_a_good_mesh_is_left_as_it_is(rock):
    vertices, faces, volume = rock
    found = repair(vertices, faces, name="rock")
    assert found.sentences == ()
    assert found.shape.volume == pytest.approx(volume, rel=1e-14)
    assert found.volume_change == 0.0
    assert repair(found.shape).shape == found.shape


def test_what_is_added_is_taken_away_again_exactly(rock):
    vertices, faces, volume = rock
    soup = vertices[faces].reshape(-1, 3)
    triangles = np.arange(len(soup)).reshape(-1, 3)
    triangles[5:40] = triangles[5:40, ::-1]
    doubled = np.concatenate([triangles, triangles[100:120], [[0, 1, 1]]])
    flag = np.array([soup[0], soup[1], 1.5 * soup[2]])
    points, dirty = both((soup, doubled), (flag, np.array([[0, 1, 2]])))
    assert not diagnose(points, dirty).ok
    found = repair(points, dirty)
    assert found.volume == pytest.approx(volume, rel=1e-12)
    assert abs(found.volume_change) < 1e-12
    text = "\n".join(found.sentences)
    assert f"merged {len(soup) + 3 - len(vertices) - 1} vertices" in text
    assert "left out 1 faces without area" in text
    assert "left out 20 faces that stand twice" in text
    assert "left out 1 patches with 1 faces that hang" in text
    assert "turned over 35 faces" in text


@pytest.mark.parametrize("gone", [[0], [0, 1], [0, 1, 2, 3]])
def test_holes_in_flat_sides_are_closed_exactly(gone):
    vertices, faces = box()
    found = repair(vertices, np.delete(faces, gone, axis=0), max_hole=1.0)
    assert found.shape.volume == pytest.approx(1.0, rel=1e-12)
    assert f"with {len(gone)} faces" in found.sentences[0]


def test_small_holes_of_a_rock_cost_little_volume(rock):
    vertices, faces, volume = rock
    generator = stream(3, "repair")
    kept = np.delete(faces, generator.choice(len(faces), 30, replace=False), axis=0)
    found = repair(vertices, kept)
    assert found.shape.volume == pytest.approx(volume, rel=2e-3)
    assert diagnose(found.shape).ok


def test_a_hole_of_many_edges_is_closed_from_its_middle():
    angle = 2 * np.pi * np.arange(400) / 400
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    points = np.concatenate([ring, [[0, 0, 1.0]]])
    side = np.column_stack([np.arange(400), (np.arange(400) + 1) % 400, np.full(400, 400)])
    loop = hole_loops(side, 401)
    assert [len(one) for one in loop] == [400]
    added, triangles = closed_loop(points, side, loop[0])
    assert added == pytest.approx(np.zeros((1, 3)), abs=1e-12)
    assert len(triangles) == 400
    cone = repair(points, side, max_hole=1.0).shape
    assert cone.volume == pytest.approx(400 * np.sin(np.pi / 200) / 2 / 3, rel=1e-12)


def test_the_least_area_closes_a_bent_hole_along_its_ridge():
    """A roof without its two halves of one side: the ridge is the edge of least area."""
    points = np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0.1), (2, 2, 0), (0, 2, 0), (0, 1, 0.1)], dtype=float)
    added, triangles = closed_loop(points, np.zeros((0, 3), np.int64), np.arange(6))
    assert not len(added)
    edges = {tuple(sorted(edge)) for t in triangles.tolist() for edge in zip(t, t[1:] + t[:1], strict=True)}
    assert (2, 5) in edges


def test_a_wide_hole_is_refused_and_named(rock):
    vertices, faces, _ = rock
    with pytest.raises(
        DirtyMeshError, match=r"1 holes, the widest .* closed up to 0\.25; raise max_hole, or use Shape"
    ):
        repair(vertices, faces[vertices[faces].mean(axis=1)[:, 2] < 0.0])


def test_several_bodies_are_refused_chosen_or_kept():
    mesh = both(box(), box(edge=0.5, at=(2, 0, 0)))
    with pytest.raises(DirtyMeshError, match=r"2 separate bodies: .* with bodies='largest' or bodies='all'$"):
        repair(*mesh)
    largest = repair(*mesh, bodies="largest")
    assert largest.shape.volume == pytest.approx(1.0)
    assert "left out 11 % of the volume" in largest.sentences[-1]
    every = repair(*mesh, bodies="all", name="pair")
    assert [shape.volume for shape in every.shapes] == pytest.approx([1.0, 0.125])
    assert [shape.name for shape in every.shapes] == ["pair_0", "pair_1"]
    assert every.volume == pytest.approx(1.125)


def test_shells_that_overlap_are_joined():
    found = repair(*both(box(), box(at=(0.5, 0.25, 0.125))))
    assert found.shape.volume == pytest.approx(2 - 0.5 * 0.75 * 0.875, rel=1e-12)
    assert "joined 2 shells" in found.sentences[-1]


def test_a_solid_in_a_solid_is_one_and_a_cavity_stays():
    inner, faces = box(edge=0.5)
    assert repair(*both(box(), (inner, faces))).shape.volume == pytest.approx(1.0)
    hollow = both(box(), (inner, faces[:, ::-1]))
    assert repair(*hollow).sentences == ()
    turned = repair(hollow[0], hollow[1][:, ::-1])
    assert turned.shape.volume == pytest.approx(1 - 0.125)
    holed = repair(hollow[0], np.delete(hollow[1], [0], axis=0), max_hole=1.0)
    assert holed.shape.volume == pytest.approx(1 - 0.125)


def test_a_spike_through_the_surface_is_cut_out(rock):
    vertices, faces, volume = rock
    spiked = vertices.copy()
    spiked[200] = -1.2 * spiked[200]
    assert diagnose(spiked, faces).self_intersections > 0
    found = repair(spiked, faces)
    assert found.shape.volume == pytest.approx(volume, rel=0.01)
    assert "cut through itself" in found.sentences[-1]


def test_a_surface_with_one_side_is_refused():
    angle = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    wide = np.column_stack([np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle), np.sin(angle / 2)])
    ring = np.column_stack([3 * np.cos(angle), 3 * np.sin(angle), 0 * angle])
    points = np.concatenate([ring + wide, ring - wide])
    k = np.arange(29)
    faces = np.concatenate([np.column_stack([k, k + 1, k + 30]), np.column_stack([k + 1, k + 31, k + 30])])
    band = np.concatenate([faces, [[29, 30, 59], [30, 0, 59]]])
    with pytest.raises(DirtyMeshError, match="one side"):
        repair(points, band)


@pytest.mark.slow
def test_the_scanned_bunny_becomes_a_grain(data_dir):
    vertices, faces = read_surface(data_dir / "bunny_dirty.ply")
    with pytest.raises(DirtyMeshError):
        vg.Shape.from_mesh(vertices, faces)
    found = repair(vertices, faces, name="bunny")
    assert repair(data_dir / "bunny_dirty.ply").shape == found.shape
    assert vg.load_shape(data_dir / "bunny_dirty.ply", repair=True) == found.shape
    assert diagnose(found.shape).ok
    assert found.shape.volume == pytest.approx(7.5e-4, rel=0.01)
    assert abs(found.volume_change) < 0.03
    assert "closed 15 holes" in "\n".join(found.sentences)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"max_hole": -1.0}, "max_hole is -1"),
        ({"max_hole": np.nan}, "max_hole is nan"),
        ({"bodies": "some"}, "bodies is 'some'"),
    ],
)
def test_bad_options_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        repair(*box(), **options)


def test_bad_meshes_are_refused():
    vertices, faces = box()
    with pytest.raises(InputError, match="0 faces"):
        repair(vertices, faces[:0])
    with pytest.raises(InputError, match="finite"):
        repair(np.where(vertices == vertices[0], np.nan, vertices), faces)
    with pytest.raises(InputError, match="has none: give vertices and faces"):
        repair(vertices)
    with pytest.raises(DirtyMeshError, match="encloses no volume"):
        repair(vertices * np.array([1, 1, 0]), faces)


@given(seed=st.integers(0, 10**6), gone=st.integers(0, 3), turned=st.integers(0, 20))
def test_damage_to_a_convex_polyhedron_is_mended(seed, gone, turned):
    shape = vg.make_shape("convex_polyhedron", seed=seed % 50, points=40)
    generator = stream(seed, "damage")
    faces = shape.faces.copy()
    over = generator.choice(len(faces), turned, replace=False)
    faces[over] = faces[over, ::-1]
    faces = np.delete(faces, generator.choice(len(faces), gone, replace=False), axis=0)
    found = repair(shape.vertices, faces, max_hole=1.0)
    assert diagnose(found.shape).ok
    # a hole of one or two faces of a convex body costs no more than the tetrahedron over it
    assert found.shape.volume <= shape.volume * (1 + 1e-12)
    assert found.shape.volume > 0.8 * shape.volume
    if gone == 0:
        assert found.shape.volume == pytest.approx(shape.volume, rel=1e-12)


@pytest.mark.parametrize("at", [(1, 0, 0), (1, 0.5, 0), (1, 1, 0), (1, 1, 1), (0.75, 0, 0)])
@pytest.mark.parametrize("turned", [False, True])
def test_solids_that_touch_are_several_unless_they_share_a_face(at, turned):
    """Face to face, on a part of a face, along an edge and at a corner, with the same diagonals and with others."""
    edge = 0.5 if at[0] == 0.75 else 1.0
    one, (points, faces) = box(), box(edge=edge, at=at)
    if turned:
        order = [0, 2, 1]
        points, faces = (points - at)[:, order] + at, faces[:, ::-1]
    two = both(one, (points, faces))
    assert diagnose(*two).outward_inner_shells == 0
    with pytest.raises(DirtyMeshError, match="has 2 separate bodies: a grain must be one solid"):
        repair(*two)
    found = repair(*two, bodies="all")
    if at in ((1, 0, 0), (1, 0.5, 0), (0.75, 0, 0)):
        assert [shape.volume for shape in found.shapes] == pytest.approx([1.0 + edge**3], rel=1e-12)
        assert found.sentences[-1] == "joined 2 solids that touch face to face, by manifold3d"
    else:
        assert [shape.volume for shape in found.shapes] == pytest.approx([1.0, edge**3], rel=1e-12)
    assert repair(*two, bodies="largest").shape.volume == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_solids_that_share_a_face_in_single_precision_are_one(seed):
    """Faces of a solid that is turned and rounded are parts of 1e8 away from those that they touch, or cut through."""
    turn = rotation_matrices(random_rotations(stream(seed, "turned"), 1))[0]
    parts = box(), box(edge=0.5, at=(0.75, 0, 0)), box(edge=0.5, at=(0, 0.9, 0)), box(edge=0.5, at=(0, 1.2, 0.1))
    corner, edge, gap = (
        box(edge=0.5, at=(0.75,) * 3),
        box(edge=0.4, at=(-0.7, -0.7, 0)),
        box(edge=0.3, at=(0, 0, 0.6501)),
    )
    points, faces = parts[0]
    for part in (*parts[1:], corner, edge, gap):
        points, faces = both((points, faces), part)
    rounded = (points @ turn.T + 0.3).astype(np.float32)
    found = repair(rounded, faces, bodies="all")
    # of those that overlap, that share a face, that touch at a corner and along an edge, and with a gap
    volumes = [1.0 + 0.125, 0.25 - 0.2 * 0.5 * 0.4, 0.125, 0.064, 0.027]
    assert [shape.volume for shape in found.shapes] == pytest.approx(volumes, rel=2e-5)
    assert all(diagnose(shape).ok for shape in found.shapes)
    assert "joined 2 solids that touch face to face, by manifold3d" in found.sentences


@pytest.mark.parametrize("gap", [3e-7, -3e-7])
def test_a_slit_of_rounding_between_two_faces_is_closed(gap):
    found = repair(*both(box(), box(edge=0.5, at=(0.75 + gap, 0.0, 0.0))), bodies="all")
    assert [shape.volume for shape in found.shapes] == pytest.approx([1.125], rel=2e-5)
    assert len(repair(*both(box(), box(edge=0.5, at=(0.7501, 0.0, 0.0))), bodies="all").shapes) == 2


def test_a_ring_of_bricks_and_a_wall_in_two_rows_are_one_body_each():
    """Many faces at once; in a ring the last solid closes it."""
    ring = [
        box(at=at) for at in ((0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 2, 0), (1, 2, 0), (0, 2, 0), (0, 1, 0))
    ]
    wall = [box(at=(10 + k + 0.5 * row, 0, row)) for row in range(2) for k in range(3)]
    points, faces = ring[0]
    for part in (*ring[1:], *wall):
        points, faces = both((points, faces), part)
    found = repair(points, faces, bodies="all")
    assert [shape.volume for shape in found.shapes] == pytest.approx([8.0, 6.0], rel=1e-9)


def test_a_cavity_and_a_solid_that_touch_the_surface_from_within():
    outer, inner = box(edge=2.0), box(edge=1.0, at=(0.5, 0.0, 0.0))
    assert diagnose(*both(outer, inner)).outward_inner_shells == 1
    assert diagnose(*both(outer, (inner[0], inner[1][:, ::-1]))).cavities == 1


def test_of_a_surface_with_two_sides_one_is_kept():
    points, faces = box()
    found = repair(points, np.concatenate([faces, faces[:, ::-1]]))
    assert found.sentences == ("left out 12 faces, the second side of a surface with two",)
    assert found.shape.volume == pytest.approx(1.0, rel=1e-12)
    # a sheet beside a solid is no part of it
    fin = both((points, faces), (points + 3, np.concatenate([faces[:1], faces[:1, ::-1]])))
    assert repair(*fin).shape.volume == pytest.approx(1.0, rel=1e-12)
