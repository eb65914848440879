"""Surfaces are drawn sharp where their edges are, and smooth elsewhere."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.report.colors import coloring
from voxgran.report.creases import creased, shaded, vertex_normals
from voxgran.report.scenes import add_grains, picture_packing
from voxgran.report.stage import stage_of
from voxgran.shapes.tessellate import unit_box


def test_single_sharp_edges_of_a_scan_are_drawn_smooth(data_dir):
    for name in ("itokawa_lp.obj", "bennu_lp.obj"):
        rock = vg.load_shape(data_dir / name)
        assert len(creased(rock, rock.vertices, rock.faces)[0]) == len(rock.vertices)


def test_a_long_sharp_edge_stays_sharp_also_where_others_are_single():
    # the rim of a cylinder and of a hole in a solid are longer than the solid is wide
    for shape in (vg.make_shape("cylinder"), vg.make_shape("solid_union", seed=7)):
        corners, faces = creased(shape, shape.vertices, shape.faces)
        assert len(corners) > 1.05 * len(shape.vertices)
        np.testing.assert_array_equal(corners[faces], shape.vertices[shape.faces])


def test_polyhedra_have_flat_faces():
    rock = vg.make_shape("convex_polyhedron", seed=3)
    corners, faces = creased(rock, rock.vertices, rock.faces)
    sides = corners[faces]
    normal = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    drawn = shaded(corners, faces).point_data.active_normals[faces]
    assert np.abs(drawn - normal[:, None]).max() < 0.03


def test_normals_do_not_depend_on_the_triangles_of_a_face():
    vertices, faces = unit_box()[:2]
    mesh = shaded(vertices, faces)
    outward = vertices - vertices.mean(axis=0)
    np.testing.assert_allclose(
        mesh.point_data.active_normals, outward / np.linalg.norm(outward, axis=1, keepdims=True), atol=1e-6
    )


def test_triangles_that_are_turned_over_keep_their_corners():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    box = vg.make_shape("box")
    for faces in ([[0, 1, 2], [0, 2, 3]], [[0, 1, 2], [0, 3, 2]]):
        corners, triangles = creased(box, vertices, np.array(faces))
        np.testing.assert_array_equal(corners[triangles], vertices[faces])


def test_grains_have_the_normals_of_their_shapes_where_they_lie():
    shapes = [vg.make_shape("cylinder"), vg.make_shape("convex_polyhedron", seed=3), vg.make_shape("sphere")]
    bed = vg.pack(shapes, vg.Box((6, 6, 6)), "rsa", count=9, sizes=vg.sizes.uniform(0.5, 1.0), seed=1)
    with stage_of((80, 60)) as stage:
        add_grains(stage, bed, np.array([7, 2, 5, 0, 8]), coloring(bed, "diameter"))
        mesh = stage.mesh
    twin = vertex_normals(np.asarray(mesh.points), mesh.regular_faces)
    np.testing.assert_allclose(mesh.point_data.active_normals, twin, atol=1e-5)


@pytest.mark.parametrize("color_by", ["diameter", "height"])
def test_flat_grains_that_touch_have_outlines(color_by):
    disk = vg.make_shape("disk")
    pair = vg.Packing.of([disk], vg.Rectangle((4, 2)), position=[(1.5, 1, 0), (2.5, 1, 0)])
    picture = picture_packing(pair, color_by=color_by, window=(400, 200), legend=False).astype(int)
    row = picture[100, 150:250]
    # of the colour of the grains on both sides, and another one where they touch
    assert np.abs(row[0] - row[-1]).max() <= 6
    assert np.abs(row[45:55] - row[0]).max(axis=1).max() > 40
    assert (np.abs(row - row[0]).max(axis=1) > 40).mean() < 0.1
