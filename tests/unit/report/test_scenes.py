"""Pictures show what they should: not blank, every grain in its place and its share."""

import numpy as np
import pytest
import pyvista
from matplotlib.colors import to_rgb
from PIL import Image

import voxgran as vg
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.geometry.rotation import rotation_matrices
from voxgran.packing.model import Packing
from voxgran.report import page, scenes
from voxgran.report.scenes import picture_cut, picture_faces, picture_grain, picture_packing
from voxgran.report.stage import BACKGROUND, look_at, shot, stage_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.tessellate import sphere

WINDOW = (320, 240)


def render_ids(packing, *, window=WINDOW):
    """Return which grain is seen in each pixel, (height, width): 0 is background, k + 1 is grain k."""
    bodies = [scenes.drawn_surface(shape, scenes.picture_faces(packing)) for shape in packing.shapes]
    merged = scenes.merged_surfaces(packing, bodies=bodies)
    label = merged.grain + 1
    colors = np.stack([label >> 16 & 255, label >> 8 & 255, label & 255], axis=1).astype(np.uint8)
    with stage_of(window, lit=False) as stage:
        if len(label):
            mesh = pyvista.PolyData.from_regular_faces(merged.vertices, merged.faces)
            mesh.cell_data["label"] = colors
            stage.add_mesh(mesh, scalars="label", rgb=True, lighting=False)
        look_at(stage, packing.container.mesh()[0], flat=packing.dimension == 2)
        return shot(stage).astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])


def covered(picture, contrast=8):
    """Return the share of pixels that are not background."""
    ground = np.round(255 * np.array(to_rgb(BACKGROUND)))
    return float((np.abs(picture.astype(float) - ground).max(axis=2) > contrast).mean())


def test_the_whole_packing_is_seen(packing):
    picture = picture_packing(packing, window=WINDOW)
    assert picture.shape == (240, 320, 3)
    assert picture.dtype == np.uint8
    assert 0.2 < covered(picture) < 0.6
    # nothing is cut off: only background along the rim
    rim = np.concatenate([picture[:2].reshape(-1, 3), picture[-2:].reshape(-1, 3)])
    assert len(np.unique(rim, axis=0)) == 1


def test_insides_that_are_left_out_are_not_seen(packing, monkeypatch):
    drawn, uncut = picture_packing(packing, window=WINDOW), []

    def add_all(*arguments, **options):
        uncut.append(options.pop("uncut"))
        add_grains(*arguments, **options)

    add_grains = scenes.add_grains
    monkeypatch.setattr(scenes, "add_grains", add_all)
    with_insides = picture_packing(packing, window=WINDOW)
    assert uncut == [True]
    differ = np.abs(drawn.astype(int) - with_insides).max(axis=2)
    assert (differ > 16).mean() < 1e-3


def test_the_same_packing_gives_the_same_picture(packing):
    np.testing.assert_array_equal(picture_packing(packing, window=WINDOW), picture_packing(packing, window=WINDOW))


def test_colours_tell_sizes_and_shapes_apart(packing):
    by_size = picture_packing(packing, window=WINDOW)
    by_shape = picture_packing(packing, window=WINDOW, color_by="shape")
    assert (by_size != by_shape).any(axis=2).mean() > 0.1
    # viridis from dark purple to yellow: its ends are seen in the picture by shape
    red, green, blue = np.moveaxis(by_shape.astype(int), 2, 0)
    assert ((red > 150) & (green > 140) & (blue < 110)).mean() > 0.03
    assert ((blue > green + 15) & (red < 120)).mean() > 0.03


def test_every_visible_grain_is_labelled_and_sizes_match_their_projection(packing):
    ids = render_ids(packing, window=WINDOW)
    assert ids.shape == (240, 320)
    assert set(np.unique(ids)) <= set(range(packing.count + 1))
    assert len(np.unique(ids)) > 30
    spheres = packing.shape_id[np.unique(ids)[1:] - 1] == 0
    assert 10 < spheres.sum() < len(spheres) - 10
    share = np.isin(ids - 1, np.flatnonzero(packing.shape_id == 0)).sum() / (ids > 0).sum()
    assert 0.25 < share < 0.6


def test_one_sphere_covers_the_area_of_its_disk():
    shape = Shape.of(Primitive("sphere", (1.0,)), name="sphere")
    packing = Packing.of([shape], Box((2, 2, 2)), position=[[1, 1, 1]])
    labels = render_ids(packing, window=(300, 300))
    assert labels.max() == 1
    rows, columns = np.nonzero(labels)
    assert np.ptp(rows) == pytest.approx(np.ptp(columns), abs=2)
    assert labels.sum() == pytest.approx(np.pi / 4 * np.ptp(rows) * np.ptp(columns), rel=0.03)
    np.testing.assert_allclose([rows.mean(), columns.mean()], 149.5, atol=1.0)


def test_the_cut_takes_the_near_quarter_away(packing):
    whole, cut = render_ids(packing, window=WINDOW), picture_cut(packing, window=WINDOW)
    assert 0.15 < covered(cut) < covered(picture_packing(packing, window=WINDOW))
    corner = np.flatnonzero((packing.position[:, 0] > 2) & (packing.position[:, 1] < 2))
    assert np.isin(whole - 1, corner).mean() > 0.1  # it was in front


def test_many_spheres_are_shaded_points_in_the_same_places(packing, monkeypatch):
    spheres = np.flatnonzero(packing.shape_id == 0)
    only = Packing.of(
        packing.shapes, packing.container, position=packing.position[spheres], scale=packing.scale[spheres]
    )
    meshes = picture_packing(only, window=WINDOW)
    monkeypatch.setattr(scenes, "MOST_SPHERES", 5)
    points = picture_packing(only, window=WINDOW)
    assert covered(points) == pytest.approx(covered(meshes), rel=0.03)
    assert (np.abs(points.astype(int) - meshes).max(axis=2) > 90).mean() < 0.03


def test_a_large_packing_shows_its_middle_and_says_so(monkeypatch):
    """The grains of the middle are those nearest to the median place, and their contacts are found without the rest."""
    bed = vg.pack(vg.shapes.sphere(), vg.Box((8, 8, 8)), "advancing_front")
    monkeypatch.setattr(scenes, "MIDDLE", 40)
    monkeypatch.setattr(scenes, "TRIANGLE_BUDGET", 80 * bed.count)  # as of a million grains
    middle = scenes.middle_of(bed)
    assert middle.count == 40
    away = np.abs(bed.position - np.median(bed.position, axis=0)).max(axis=1)
    np.testing.assert_array_equal(middle.position, bed.position[away <= np.sort(away)[39]])
    assert middle.verify().escaped == 0
    monkeypatch.setattr(scenes, "MOST_SPHERES", bed.count - 1)
    monkeypatch.setattr(page, "MOST_FOR_CONTACTS", bed.count - 1)
    monkeypatch.setattr(scenes, "picture_grain", lambda shape: {})
    drawn = page.draw_pictures(bed, "diameter").packing
    assert drawn["whole"][2] == "The whole packing. Spheres are drawn as points, shaded by the slope of the heap."
    assert drawn["middle"][2] == "The 40 grains of a cube in the middle, with their surfaces."
    assert "most neighbours in that cube" in drawn["contacts"][2]
    assert not bed._contacts
    assert scenes.middle_of(bed[:3]).count == 3


def test_grains_of_many_triangles_are_drawn_coarser(packing, monkeypatch):
    vertices, faces, _ = sphere(4)
    fine = Shape.from_mesh(vertices * [0.5, 0.4, 0.3], faces)
    many = Packing.of([fine], packing.container, position=packing.position)
    monkeypatch.setattr(scenes, "TRIANGLE_BUDGET", 48 * 300)
    assert picture_faces(many) == 300
    body, triangles = scenes.drawn_surface(fine, 300)
    assert 200 < len(triangles) <= 300
    assert Mesh(body, triangles).volume == pytest.approx(fine.volume, rel=0.03)
    assert 0.1 < covered(picture_packing(many, window=WINDOW)) < 0.6
    assert picture_faces(Packing.of([], packing.container, position=[])) == 48 * 300


@pytest.mark.parametrize("kind", ["cylinder", "mesh"])
def test_every_container_has_an_outline(kind):
    vertices, faces, _ = sphere(2)
    solid = Shape.of(Mesh(vertices * [1.0, 1.0, 2.0] + [3, 3, 3], faces), name="drum")
    container = Cylinder(1.0, 3.0) if kind == "cylinder" else ClosedMesh(solid)
    picture = picture_packing(Packing.of([], container, position=[]), window=WINDOW)
    # the walls are a breath of colour, the outline and the scale bar are dark
    assert 0.004 < covered(picture, 60) < 0.06
    assert 0.1 < covered(picture, 5) < 0.9


def test_two_dimensions_are_seen_from_above(flat):
    ids = render_ids(flat, window=(400, 300))
    pixel = (4 / 400) / (1 - 2 * 0.03)
    areas = np.bincount(ids.ravel(), minlength=4)[1:] * pixel**2
    np.testing.assert_allclose(areas, flat.volumes, rtol=0.02)
    first, last = (np.argwhere(ids == k).mean(axis=0) for k in (1, 3))
    assert last[0] < first[0]  # y points up
    assert 0.15 < covered(picture_packing(flat, window=WINDOW)) < 0.4
    np.testing.assert_array_equal(picture_cut(flat, window=WINDOW), picture_packing(flat, window=WINDOW))


def test_a_grain_is_shown_as_surface_voxels_points_and_clump(packing):
    pictures = picture_grain(packing.shapes[1], window=(160, 120), spheres=8)
    assert list(pictures) == ["surface", "voxels", "points", "clump"]
    shares = {name: covered(picture) for name, picture in pictures.items()}
    assert 0.3 < shares["surface"] < 0.7
    assert shares["voxels"] == pytest.approx(shares["surface"], rel=0.15)
    assert shares["points"] == pytest.approx(shares["surface"], rel=0.15)
    assert 0.5 * shares["surface"] < shares["clump"] < 1.2 * shares["surface"]
    different = [(pictures["surface"] != pictures[name]).any(axis=2).mean() for name in ("voxels", "points", "clump")]
    assert min(different) > 0.1
    # nothing of one picture is in the next
    with stage_of((160, 120)) as stage:
        look_at(stage, 1.06 * packing.shapes[1].vertices)
        scenes.drawings_of(packing.shapes[1], 8)["clump"](stage)
        np.testing.assert_array_equal(shot(stage), pictures["clump"])


def test_a_flat_grain_has_no_clump(flat):
    for shape in flat.shapes:
        assert list(picture_grain(shape, window=(160, 120))) == ["surface", "voxels", "points"]


def test_the_camera_just_holds_what_it_is_given():
    generator = np.array([[0.0, 0, 0], [7, 1, 2], [3, 9, 1], [-4, 2, 8]])
    for window in ((320, 240), (200, 300)):
        with stage_of(window, lit=False) as stage:
            stage.add_points(generator, color="white", point_size=1, lighting=False)
            look_at(stage, generator)
            rows, columns = np.nonzero(shot(stage).max(axis=2))
        width, height = window
        margins = (
            columns.min() / width,
            1 - (columns.max() + 1) / width,
            rows.min() / height,
            1 - (rows.max() + 1) / height,
        )
        assert min(margins) == pytest.approx(0.03, abs=0.015)
        assert margins[0] == pytest.approx(margins[1], abs=0.015)
        assert margins[2] == pytest.approx(margins[3], abs=0.015)


def test_pictures_follow_the_orientation_of_a_grain(packing):
    one = Packing.of(packing.shapes[1:], Box((2, 2, 2)), position=[[1, 1, 1]])
    quarter = np.array([[np.cos(np.pi / 4), 0.0, np.sin(np.pi / 4), 0.0]])
    turned = Packing.of(packing.shapes[1:], Box((2, 2, 2)), position=[[1, 1, 1]], orientation=quarter)
    by_hand = Shape.of(packing.shapes[1].geometry.rotated(rotation_matrices(quarter)[0]), name="turned")
    same = Packing.of([by_hand], Box((2, 2, 2)), position=[[1, 1, 1]])
    assert (render_ids(one) != render_ids(turned)).mean() > 0.02
    assert (render_ids(same) != render_ids(turned)).mean() < 0.002


def test_save_picture_draws_what_the_pictures_of_a_report_show(tmp_path):
    bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=12, seed=1)
    window = (120, 100)
    files = {name: tmp_path / f"{name}.png" for name in ("whole", "cut", "shape")}
    vg.save_picture(bed, files["whole"], color_by="height", window=window)
    vg.save_picture(bed, files["cut"], cut=True, window=window)
    vg.save_picture(vg.make_shape("convex_polyhedron"), files["shape"], window=window)
    drawn = {name: np.asarray(Image.open(path))[..., :3] for name, path in files.items()}
    assert np.array_equal(drawn["whole"], scenes.picture_packing(bed, color_by="height", window=window)[..., :3])
    assert np.array_equal(drawn["cut"], scenes.picture_cut(bed, window=window)[..., :3])
    assert drawn["shape"].shape == (100, 120, 3)
    assert len(np.unique(drawn["shape"].reshape(-1, 3), axis=0)) > 10


def test_save_picture_refuses_before_it_draws(tmp_path, monkeypatch):
    bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=2)
    there = tmp_path / "there.png"
    there.write_text("kept")
    monkeypatch.setattr("voxgran.report.notebook._picture", None)
    with pytest.raises(vg.VoxgranError, match=r"suffix '\.jpg'"):
        vg.save_picture(bed, tmp_path / "bed.jpg")
    with pytest.raises(vg.VoxgranError, match="is there already"):
        vg.save_picture(bed, there)
    with pytest.raises(vg.VoxgranError, match="color_by is 'taste'"):
        vg.save_picture(bed, there, color_by="taste", overwrite=True)
    with pytest.raises(vg.VoxgranError, match="a Packing or a Shape"):
        vg.save_picture([1], there, overwrite=True)
    assert there.read_text() == "kept"


def test_faces_that_are_not_drawn_are_not_seen(packing, monkeypatch):
    monkeypatch.setattr(scenes, "FLAT_LIMIT", 5)
    picture = picture_packing(packing, window=WINDOW).astype(int)
    add = pyvista.Plotter.add_mesh
    monkeypatch.setattr(
        pyvista.Plotter, "add_mesh", lambda self, mesh, **look: add(self, mesh, **{**look, "culling": None})
    )
    every = picture_packing(packing, window=WINDOW).astype(int)
    assert (np.abs(picture - every).max(axis=2) > 8).mean() < 0.003


def test_both_sides_of_a_sheet_are_drawn(monkeypatch):
    monkeypatch.setattr(scenes, "FLAT_LIMIT", 0)
    shares = []
    for turn in ((1, 0, 0, 0), (0, 1, 0, 0)):
        sheet = Packing.of(vg.make_shape("sheet"), Box((2, 2, 2)), position=[[1, 1, 1]], orientation=[turn])
        shares.append(covered(picture_packing(sheet, window=WINDOW), contrast=40))
    assert min(shares) > 0.03
    assert shares[0] == pytest.approx(shares[1], rel=0.05)
