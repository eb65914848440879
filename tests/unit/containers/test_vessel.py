"""Vessels: the space that a wall of a mesh encloses, against closed formulas."""

import math
import warnings

import manifold3d
import numpy as np
import pytest
import pyvista

import voxgran as vg
from voxgran._base.errors import DirtyMeshError, InputError
from voxgran.shapes.tessellate import revolved

SIDES = 48
#: area of the polygon of so many sides in a circle of radius 1
AREA = SIDES / 2 * math.sin(2 * math.pi / SIDES)
CUP = [(0, 0), (0, 2), (5, 2), (5, 1.5), (0.5, 1.5), (0.5, 0)]
THIN = [(0, 0), (0, 2), (5, 2), (5, 1.9), (0.1, 1.9), (0.1, 0)]
#: outside and inside of an hourglass: two chambers of two cones each, between which the neck is 0.8 wide
HOURGLASS = [(0, 0), (0, 2.2), (4, 0.6), (8, 2.2), (8, 2), (4, 0.4), (0.2, 2), (0.2, 0)]


def turned(profile):
    """Return the solid of revolution of a closed profile of heights and radii."""
    section = manifold3d.CrossSection([[(radius, z) for z, radius in profile]])
    mesh = manifold3d.Manifold.revolve(section, SIDES).to_mesh64()
    return vg.Shape.from_mesh(np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts))


def frustum(low, high, height):
    """Return the volume of a frustum of a pyramid of SIDES sides."""
    return AREA / 3 * height * (low**2 + low * high + high**2)


def test_the_space_in_a_cup_reaches_to_its_rim():
    space = vg.Vessel(turned(CUP))
    assert space.volume == pytest.approx(AREA * 1.5**2 * 4.5, rel=1e-8)
    np.testing.assert_allclose(space.bounds[:, 2], [0.5, 5.0], atol=1e-7)
    assert vg.Vessel(turned(CUP), lid=3.0).volume == pytest.approx(AREA * 1.5**2 * 2.5, rel=1e-12)


def test_a_cup_is_filled_along_gravity():
    cup = turned(CUP)
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    lying = vg.Shape.from_mesh((cup.vertices + np.array(cup.offset)) @ turn.T, cup.faces)
    assert vg.Vessel(lying, gravity="-x").volume == pytest.approx(AREA * 1.5**2 * 4.5, rel=1e-8)
    # a tilted one holds less
    angle = math.radians(20)
    turn = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
    tilted = vg.Shape.from_mesh((cup.vertices + np.array(cup.offset)) @ turn.T, cup.faces)
    # the plane at the lowest point of the rim inside passes the axis 1.5 tan(20) below the rim
    full = AREA * 1.5**2 * (4.5 - 1.5 * math.tan(angle))
    assert vg.Vessel(tilted).volume == pytest.approx(full, rel=1e-3)


def test_an_hourglass_is_one_space_of_two_chambers_unless_a_lid_parts_them():
    glass = turned(HOURGLASS)
    whole = frustum(2, 0.4, 3.8) + frustum(0.4, 2, 4)
    assert vg.Vessel(glass).volume == pytest.approx(whole, rel=1e-7)
    assert vg.Vessel(glass, lid=4.0).volume == pytest.approx(frustum(2, 0.4, 3.8), rel=1e-8)
    upper = vg.Vessel(glass, floor=4.0, lid=7.0)
    assert upper.volume == pytest.approx(frustum(0.4, 1.6, 3), rel=1e-8)


@pytest.mark.slow
def test_beds_rest_in_an_hourglass_and_its_wall_is_told_from_it(tmp_path):
    glass = turned(HOURGLASS)
    vg.save_shape(glass, tmp_path / "glass.stl")
    grain = vg.make_shape("sphere", diameter=0.5)
    mapping = {"kind": "vessel", "file": str(tmp_path / "glass.stl")}
    bed = vg.pack(grain, vg.make_container(mapping), "gravity", count=25, seed=1)
    assert bed.stop_reason == "settled"
    assert vg.verify(bed).ok
    assert bool(vg.equilibrium(bed).rests.all())
    # all of them within the inner profile
    radius = np.hypot(bed.position[:, 0], bed.position[:, 1])
    assert (radius < 0.4 + 0.4 * np.abs(bed.position[:, 2] - 4.0) + 0.05).all()
    vg.save(bed, tmp_path / "bed.vtp")
    assert vg.load(tmp_path / "bed.vtp").container.volume == pytest.approx(bed.container.volume, rel=1e-12)
    with pytest.warns(vg.PackingWarning, match=r"which looks like a wall; give Vessel\(shape\)"):
        vg.pack(vg.make_shape("sphere", diameter=0.1), vg.ClosedMesh(glass), "rsa", count=5)


def test_a_closed_tank_and_what_stands_in_it():
    """A thick shell of two surfaces, without and with a stirrer that hangs in it."""
    block = manifold3d.Manifold.cube
    shell = block([6, 6, 6], True) - block([4, 4, 4], True)
    tank = vg.Shape.from_mesh(*arrays(shell))
    assert tank.volume == pytest.approx(152)
    assert vg.Vessel(tank).volume == pytest.approx(64, rel=1e-12)
    assert vg.Vessel(tank, lid=1.0).volume == pytest.approx(48, rel=1e-12)
    vessel = vg.Vessel(tank)
    assert vessel.signed_distance([(0, 0, 0), (0, 0, 2.5)]).tolist() == pytest.approx([-2.0, 0.5])
    stirrer = block([1, 1, 3], True).translate([0, 0, 1])
    inside = vg.Vessel(vg.Shape.from_mesh(*arrays(shell + stirrer)))
    assert inside.volume == pytest.approx(64 - 2.5, rel=1e-12)
    assert inside.signed_distance([(0, 0, 1), (1.0, 0, 1)]).tolist() == pytest.approx([0.5, -0.5])


def test_of_two_spaces_a_point_chooses():
    block = manifold3d.Manifold.cube
    two = block([10, 4, 4], True)
    two -= block([3, 3, 3], True).translate([-3, 0, 0])
    two -= block([2, 2, 2], True).translate([2, 0, 0])
    wall = vg.Shape.from_mesh(*arrays(two))
    assert vg.Vessel(wall).volume == pytest.approx(27, rel=1e-12)
    assert vg.Vessel(wall, point=(2, 0, 0)).volume == pytest.approx(8, rel=1e-12)
    with pytest.raises(InputError, match="encloses no space"):
        vg.Vessel(wall, point=(20, 0, 0))


def arrays(solid):
    """Return vertices and faces of a solid of manifold3d."""
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts)


def test_a_rim_that_is_round_and_rounded_holds_what_it_holds():
    """In single precision, as STL files are: the lid lies where the space would overflow."""
    angle = np.linspace(0, math.pi, 12)
    lip = [(5 + 0.25 * math.sin(a), 1.75 + 0.25 * math.cos(a)) for a in angle]
    cup = turned([(0, 0), (0, 2), *lip, (0.5, 1.5), (0.5, 0)])
    single = (cup.vertices + np.array(cup.offset)).astype(np.float32)
    highest = 5 + 0.25 * np.sin(angle).max()
    space = vg.Vessel(vg.Shape.from_mesh(single, cup.faces))
    assert space.bounds[1, 2] == pytest.approx(highest, abs=2e-5)
    assert AREA * 1.5**2 * 4.5 < space.volume < AREA * 1.75**2 * 4.75


@pytest.mark.parametrize("rims", [1, 2])
def test_shells_without_thickness_are_closed_at_their_rims(rims):
    vertices, faces, _ = revolved([(0.0, 1.0), (3.0, 2.0)], sides=SIDES)
    height = vertices[faces][:, :, 2]
    kept = ~(height > 2.9).all(axis=1) & ~((height < 0.1).all(axis=1) & (rims == 2))
    shell = vg.Shape.from_surface(vertices, faces[kept])
    assert vg.Vessel(shell).volume == pytest.approx(frustum(1, 2, 3), rel=1e-12)
    assert vg.Vessel(shell, lid=1.5).volume == pytest.approx(frustum(1, 1.5, 1.5), rel=1e-12)
    wave = 0.2 * np.cos(3 * np.arctan2(vertices[:, 1], vertices[:, 0])) * vertices[:, 2:].T[0] / 3
    wavy = vg.Shape.from_surface(vertices * (1 + wave[:, None] / 3 * [0, 0, 1]), faces[kept])
    assert vg.Vessel(wavy).bounds[1, 2] == pytest.approx(wavy.vertices[:, 2].max() + wavy.offset[2] - 0.4, abs=1e-9)


def test_a_pipe_is_closed_at_both_ends():
    pipe = turned([(0, 1.5), (0, 2), (5, 2), (5, 1.5)])
    assert vg.Vessel(pipe).volume == pytest.approx(AREA * 1.5**2 * 5, rel=1e-7)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"lid": 5.5}, "encloses no space below the lid at 5.5: lid and floor must close it"),
        ({"lid": -1.0, "floor": 2.0}, "below the lid at -1 above the floor at 2"),
        ({"gravity": (0, 0, 0)}, "gravity is .* it must have a length"),
    ],
)
def test_levels_that_close_nothing_are_refused(options, match):
    with pytest.raises(InputError, match=match):
        vg.Vessel(turned(CUP), **options)


def test_solids_and_other_shapes_enclose_nothing():
    with pytest.raises(InputError, match=r"encloses no space.*ClosedMesh"):
        vg.Vessel(vg.make_shape("convex_polyhedron", seed=1))
    with pytest.raises(InputError, match="is no mesh"):
        vg.Vessel(vg.make_shape("sphere"))
    with pytest.raises(InputError, match="wall is 3"):
        vg.Vessel(3)


def test_a_thin_wall_is_told_from_a_solid():
    assert "looks like a wall" in vg.ClosedMesh(turned(THIN)).doubt(0.1)
    for solid in (vg.make_shape("convex_polyhedron", seed=1), vg.make_shape("solid_union", seed=2), turned(CUP)):
        assert vg.ClosedMesh(vg.Shape.from_mesh(solid.vertices, solid.faces)).doubt(0.1) == ""
    with warnings.catch_warnings(action="error"):
        vg.pack(vg.make_shape("sphere", diameter=0.3), vg.Vessel(turned(THIN)), "rsa", count=5)


def tub(*, x=0.0, size=2.0):
    """Return vertices and faces of a cube without its top, about (x, 0, 0)."""
    vertices, faces = arrays(manifold3d.Manifold.cube([size] * 3, True).translate([x, 0, 0]))
    return vertices, faces[~(vertices[faces][:, :, 2] > 0.49 * size).all(axis=1)]


def joined(*parts):
    """Return one mesh of several."""
    first = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [faces.astype(np.int64) + k for (_, faces), k in zip(parts, first[:-1], strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def written(path, *parts):
    pyvista.PolyData.from_regular_faces(*joined(*parts)).save(path)
    return path


@pytest.mark.parametrize(
    ("point", "options"),
    [((10, 0, 0), {}), ((0, 0, 5), {}), ((0, 0, 0.7), {"lid": 0.5}), ((0, 0, -0.9), {"floor": -0.5})],
)
def test_the_space_of_a_shell_holds_the_point(point, options):
    shell = vg.Shape.from_surface(*tub())
    assert vg.Vessel(shell, point=(0, 0, 0), **options).volume == pytest.approx(8 if not options else 6)
    with pytest.raises(InputError, match="encloses no space that holds the point"):
        vg.Vessel(shell, point=point, **options)


def test_a_point_chooses_between_shells_of_a_file(tmp_path):
    path = written(tmp_path / "tubs.stl", tub(), tub(x=5.0, size=1.0))
    assert vg.Vessel(path).volume == pytest.approx(8)
    small = vg.Vessel(path, point=(5, 0, 0))
    assert small.volume == pytest.approx(1)
    np.testing.assert_allclose(small.bounds, [[4.5, -0.5, -0.5], [5.5, 0.5, 0.5]])


@pytest.mark.parametrize("gap", [0.0, -0.2])
def test_a_wall_may_be_of_several_bodies(gap, tmp_path):
    """A tube that stands on a plate, or in it, and a block that touches neither."""
    cylinder = manifold3d.Manifold.cylinder
    tube = cylinder(10, 5, 5, SIDES) - cylinder(12, 4.5, 4.5, SIDES).translate([0, 0, -1])
    plate = cylinder(1, 5, 5, SIDES).translate([0, 0, -1 - gap])
    block = manifold3d.Manifold.cube([1, 1, 1]).translate([0, 0, 5])
    path = written(tmp_path / "silo.ply", *map(arrays, (tube, plate, block)))
    assert vg.Vessel(path).volume == pytest.approx(AREA * 4.5**2 * (10 + gap) - 1, rel=1e-6)
    # what is below the block alone
    assert vg.Vessel(path, lid=4.0, point=(0, 0, 1)).volume == pytest.approx(AREA * 4.5**2 * (4 + gap), rel=1e-6)


@pytest.mark.parametrize("outward", [True, False])
def test_two_skins_of_a_wall_enclose_the_bore(outward, tmp_path):
    inner, outer = ([np.array(part) for part in revolved([(0, r), (9, r)], sides=SIDES)[:2]] for r in (2.0, 2.2))
    skins = [(v, f[np.ptp(v[f][:, :, 2], axis=1) > 1]) for v, f in (inner, outer)]
    if not outward:
        skins[0] = skins[0][0], skins[0][1][:, ::-1]
    path = written(tmp_path / "skins.ply", *skins)
    assert vg.Vessel(path).volume == pytest.approx(AREA * 2**2 * 9, rel=1e-6)
    assert vg.Vessel(path, point=(0, 0, 4), floor=1.0, lid=5.0).volume == pytest.approx(AREA * 2**2 * 4, rel=1e-6)


@pytest.mark.parametrize("options", [{"lid": 6.0}, {"point": (3, 3, 3)}, {"lid": 6.0, "floor": 5.5}])
def test_an_open_wall_is_not_returned_in_place_of_its_bore(options):
    """The surface of a cup without the underside is closed there; a lid above the cup closes nothing."""
    cup = turned(CUP)
    vertices = cup.vertices + np.array(cup.offset)
    kept = ~(vertices[cup.faces][:, :, 2] < 0.01).all(axis=1)
    open_cup = vg.Shape.from_surface(vertices, cup.faces[kept])
    assert vg.Vessel(open_cup).volume == pytest.approx(AREA * 1.5**2 * 4.5, rel=1e-7)
    with pytest.raises(InputError, match="encloses no space"):
        vg.Vessel(open_cup, **options)


def test_a_gutter_and_triangles_enclose_nothing(tmp_path):
    profile = [(-1, 2), (-1, 1.9), (-1, 1.8), (-1, 0), (1, 0), (1, 1.8), (1, 1.9), (1, 2)]
    ends = [np.array([(x, y, z) for y, z in profile]) for x in (0.0, 5.0)]
    k = np.arange(7)
    faces = np.concatenate([np.column_stack([k, k + 1, k + 8]), np.column_stack([k + 1, k + 9, k + 8])])
    with pytest.raises(InputError, match="encloses no space"):
        vg.Vessel(written(tmp_path / "gutter.stl", (np.concatenate(ends), faces)))
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
    with pytest.raises((DirtyMeshError, InputError), match=r"no closed surface|encloses no space"):
        vg.Vessel(written(tmp_path / "flat.stl", flat))
