import math

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import DirtyMeshError, InputError
from voxgran.contacts.deformation.deform import deform
from voxgran.geometry.triangles import areas_of
from voxgran.shapes.describing.extents import principal_extents
from voxgran.shapes.mesh import Surface
from voxgran.shapes.repairing.diagnose import diagnose

SQUARE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])


def rectangle():
    return vg.Shape.from_surface(SQUARE, TWO, name="rectangle")


def test_a_rectangle_in_closed_form():
    flat = rectangle()
    assert flat.is_open
    assert flat.volume == 0.0
    assert flat.surface_area == pytest.approx(2.0)
    assert flat.diameter == pytest.approx(math.sqrt(8 / math.pi))
    assert flat.offset == pytest.approx((1.0, 0.5, 0.0))
    assert flat.bounding_radius == pytest.approx(math.hypot(1.0, 0.5))
    assert flat.geometry.area_inertia == pytest.approx(2.0 * np.diag([1 / 12, 4 / 12, 5 / 12]))
    assert principal_extents(flat) == pytest.approx([2.0, 1.0, 0.0], abs=1e-12)


def test_moments_do_not_depend_on_the_triangles():
    """The area of a half shell halves its sphere; its inertia about its axis is 2/3 R^2 of its mass."""
    half = vg.make_shape("shell", diameter=math.sqrt(8.0))
    area = half.surface_area
    assert area == pytest.approx(2 * math.pi, rel=1e-12)
    r = half.vertices[1:, :2].max()
    assert r == pytest.approx(1.0, rel=0.01)
    assert half.geometry.area_inertia[2, 2] == pytest.approx(2 / 3 * area * r**2, rel=0.01)
    fine = Surface(*_halved(half.vertices, half.faces))
    assert fine.area_inertia == pytest.approx(half.geometry.area_inertia, rel=1e-12, abs=1e-12)
    assert fine.centroid == pytest.approx(np.zeros(3), abs=1e-14)


def _halved(vertices, faces):
    middle = len(vertices) + np.arange(len(faces))
    parts = [np.column_stack([faces[:, k], faces[:, (k + 1) % 3], middle]) for k in range(3)]
    return np.concatenate([vertices, vertices[faces].mean(axis=1)]), np.concatenate(parts)


def test_poses_and_keys():
    flat = rectangle()
    turned = flat.rotated([math.sqrt(0.5), 0, 0, math.sqrt(0.5)]).scaled(2.0)
    assert turned.surface_area == pytest.approx(8.0)
    assert principal_extents(turned) == pytest.approx([4.0, 2.0, 0.0], abs=1e-12)
    assert flat == rectangle()
    assert flat != turned
    assert flat.key != vg.make_shape("box").key


@pytest.mark.parametrize("roll", [0.0, 90.0, 180.0, 350.0])
def test_a_rolled_sheet_keeps_its_lengths_and_has_the_curvature_it_states(roll):
    sheet = vg.make_shape("sheet", lengths=(2.0, 0.5), roll=roll)
    assert sheet.surface_area == pytest.approx(1.0)
    if roll:
        # the circle through all corners
        x, z = sheet.vertices[:, [0, 2]].T
        fit, left, *_ = np.linalg.lstsq(np.column_stack([x, z, np.ones_like(x)]), x**2 + z**2, rcond=None)
        radius = math.sqrt(fit[2] + (fit[0] ** 2 + fit[1] ** 2) / 4)
        assert left.sum() < 1e-24
        assert 1 / radius == pytest.approx(math.radians(roll) / 2.0, rel=1e-3)


def test_a_random_surface_has_the_height_it_states():
    wavy = vg.make_shape("random_surface", seed=3, height=0.2, aspect=(1.0, 1.0))
    edge = np.ptp(wavy.vertices[:, 0])
    z = wavy.vertices[:, 2] + wavy.offset[2]
    assert z.std() / edge == pytest.approx(0.2, rel=1e-12)
    assert diagnose(wavy).self_intersections == 0


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (SQUARE, [[0, 1, 2], [0, 2, 2]], r"^rag has 1 faces without area: .*leave them out"),
        ([*SQUARE, [5, 0, 0], [6, 0, 0], [5, 1, 0]], [*TWO, [4, 5, 6]], r"^rag has 2 separate parts: "),
        ([*SQUARE, [1.3, 0.2, -1], [1.3, 0.2, 1]], [*TWO, [0, 4, 5]], r"^rag has [12] pairs of faces that cut through"),
    ],
)
def test_what_is_no_surface_is_refused(vertices, faces, message):
    with pytest.raises(DirtyMeshError, match=message):
        vg.Shape.from_surface(np.array(vertices, dtype=float), faces, name="rag")


@pytest.mark.parametrize("family", ["box", "solid_union", "sphere", "torus"])
def test_the_skin_of_a_solid_is_its_closed_surface(family):
    solid = vg.make_shape(family)
    skin = solid.skin()
    assert skin.is_open
    assert skin.volume == 0.0
    assert skin.surface_area == pytest.approx(areas_of(solid.vertices[solid.faces]).sum())
    assert skin.diameter == pytest.approx(2 * math.sqrt(skin.surface_area / math.pi))
    # of the centroid of the area, which is the origin
    assert skin.vertices + np.array(skin.offset) == pytest.approx(solid.vertices, abs=1e-12)
    assert skin.skin() == skin
    assert vg.Shape.from_surface(solid.vertices, solid.faces).surface_area == pytest.approx(skin.surface_area)


def test_flat_shapes_have_no_skin():
    with pytest.raises(InputError, match="shape 'disk' is flat: skins are surfaces of solids"):
        vg.make_shape("disk").skin()


def test_skins_are_packed_saved_and_loaded(tmp_path):
    skin = vg.make_shape("convex_polyhedron", seed=1, points=8).skin()
    packing = vg.pack([skin], vg.Box((4, 4, 4)), "control_point", contact="kdtree", count=4, seed=1, sweeps=20)
    assert packing.count == 4
    assert packing.verify().ok
    packing.save(tmp_path / "skins.vtp")
    assert vg.load(tmp_path / "skins.vtp") == packing
    vg.save_shape(skin, tmp_path / "skin.ply")
    assert vg.load_shape(tmp_path / "skin.ply", surface=True).is_open
    assert not vg.load_shape(tmp_path / "skin.ply").is_open


def test_three_sheets_may_share_an_edge_and_faces_may_be_wound_in_any_way():
    vertices = [[0, 0, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0.3], [0, 0, 1]]
    assert vg.Shape.from_surface(vertices, [[0, 1, 2], [0, 1, 3], [1, 0, 4]]).surface_area > 1.5


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".off", ".stl", ".vtp"])
def test_files(tmp_path, suffix):
    path = tmp_path / f"sheet{suffix}"
    sheet = vg.make_shape("random_surface", seed=1)
    vg.save_shape(sheet, path)
    with pytest.raises(DirtyMeshError, match="open edges"):
        vg.load_shape(path)
    again = vg.load_shape(path, surface=True, unit="mm")
    assert again.is_open
    assert (again.name, again.unit) == ("sheet", "mm")
    assert again.surface_area == pytest.approx(sheet.surface_area, rel=1e-6)
    with pytest.raises(InputError, match="repair and surface are both true"):
        vg.load_shape(path, surface=True, repair=True)


@pytest.mark.parametrize("value", ["yes", None, 1])
def test_surface_and_repair_are_true_or_false(tmp_path, value):
    path = tmp_path / "sheet.off"
    vg.save_shape(rectangle(), path)
    for key in ("surface", "repair"):
        with pytest.raises(InputError, match=f"^{key} is .*: it must be True or False$"):
            vg.load_shape(path, **{key: value})


@pytest.mark.parametrize(
    "use",
    [
        lambda shape: vg.voxelize(shape, voxel_size=0.1),
        lambda shape: vg.signed_distance(shape, voxel_size=0.1),
        lambda shape: vg.fit_clump(shape, max_spheres=3),
        lambda shape: vg.to_image(vg.Packing.of([shape], vg.Box((3, 3, 3)), position=[[1, 1, 1]]), 0.1),
        lambda shape: deform(vg.Packing.of([shape], vg.Box((3, 3, 3)), position=[[1, 1, 1]])),
        lambda shape: vg.pack(shape, vg.Box((3, 3, 3)), method="digital", count=2),
    ],
)
def test_what_needs_an_inside_refuses_it(use):
    with pytest.raises(InputError, match=r"^shape 'rectangle' is an open surface: .* need a solid.*control_point"):
        use(rectangle())


def test_no_inertia_of_a_solid():
    with pytest.raises(InputError, match=r"no inertia at unit density: use geometry\.area_inertia"):
        _ = rectangle().inertia


def test_a_surface_can_be_closed_by_repair():
    cup = vg.make_shape("sheet", roll=180)
    with pytest.raises(DirtyMeshError):
        vg.repair(cup)
    bowl = vg.make_shape("shell", opening=320)
    assert vg.repair(bowl, max_hole=1.0).shape.volume > 0
