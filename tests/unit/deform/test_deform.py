"""Grains that give way: closed formulas of spheres, exact booleans of any shapes, volumes kept, shapes restored."""

import itertools
import math

import numpy as np
import pytest
from kit import slow
from scipy.optimize import brentq
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, OutputExistsError, TooLargeError
from voxgran.contacts.deformation import indentation as dents
from voxgran.contacts.deformation import refined_surface as soft_surface
from voxgran.contacts.deformation.refined_surface import crossing
from voxgran.geometry.triangles import enclosed_volume
from voxgran.shapes.spheres import Spheres

BALL = vg.make_shape("sphere")
ROOM = vg.Box((6, 6, 6))
TURNS = [[0.8, 0.6, 0, 0], [0.5, 0.5, 0.5, 0.5]]
manifold3d = pytest.importorskip("manifold3d")


def two_spheres(depth, scale=(1.0, 1.0)):
    """Return two spheres of diameters `scale` along x that overlap by a depth."""
    apart = sum(scale) / 2 - depth
    return vg.Packing.of([BALL], ROOM, position=[(2, 3, 3), (2 + apart, 3, 3)], scale=scale, orientation=TURNS)


def solid(vertices, faces):
    """Return a solid of manifold3d."""
    body = manifold3d.Manifold(manifold3d.Mesh64(np.ascontiguousarray(vertices), faces.astype(np.uint64)))
    assert body.status() == manifold3d.Error.NoError
    return body


def left_over(packing, soft):
    """Return for each near pair the volume that both bodies have in common after giving way, and before."""
    lengths = packing.container.bounds[1] - packing.container.bounds[0]
    after = [solid(*surface) for surface in zip(soft.vertices, soft.faces, strict=True)]
    before = [solid(packing.world_vertices(g), packing.shapes[packing.shape_id[g]].faces) for g in range(soft.count)]
    near = packing.contacts(0.25 * packing.diameters.max())
    shared = []
    for i, j, image in zip(near.i, near.j, near.image, strict=True):
        way = (image * lengths).tolist()
        shared.append([(bodies[i] ^ bodies[j].translate(way)).volume() for bodies in (after, before)])
    return np.array(shared)


@pytest.mark.parametrize("depth", [0.04, 1e-4])
def test_equal_spheres_meet_in_a_flat_disk(depth):
    """Radius sqrt(R d - d^2 / 4), force the integral of the depth over the disk; both of order 2 in the spacing."""
    spacings, radius, stiffness = np.array([0.4, 0.2, 0.1, 0.05]), 0.5, 3.0
    disk = math.pi * (radius * depth - depth**2 / 4)
    integral = math.pi * (depth / 2) ** 2 * (radius - depth / 3)
    errors = []
    for spacing in spacings:
        soft = vg.deform(two_spheres(depth), stiffness=stiffness, spacing=spacing)
        errors.append([1 - math.sqrt(soft.area[0] / disk), soft.force[0] / (stiffness * integral) - 1])
        # no triangle of either crosses the plane of the disk
        plane = 2.5 - depth / 2
        assert soft.vertices[0][:, 0].max() == pytest.approx(plane, abs=1e-13)
        assert soft.vertices[1][:, 0].min() == pytest.approx(plane, abs=1e-13)
        assert soft.normal[0] == pytest.approx([1, 0, 0], abs=1e-12)
        assert soft.depth[0] == pytest.approx(depth, rel=1e-9)
        assert soft.volume_error < 1e-14
        assert 0 < soft.steepness.min() < soft.steepness.max() < 0.3
    errors = np.array(errors)
    assert (errors > 0).all()
    order = np.polyfit(np.log(spacings), np.log(errors), 1)[0]
    assert (order > 1.6).all()
    assert errors[-1].max() < 4e-4


def test_volume_of_the_dents_comes_back_around_the_contact():
    """What lies outside of the sphere is the volume of the dent, a cap; beyond the reach no vertex moves."""
    depth, radius = 0.04, 0.5
    soft = vg.deform(two_spheres(depth), spacing=0.05)
    from_center = soft.vertices[0] - [2, 3, 3]
    disk = math.sqrt(radius * depth - depth**2 / 4)
    rim = np.array([radius - depth / 2, disk])
    away = np.hypot(from_center[:, 0] - rim[0], np.hypot(*from_center[:, 1:].T) - rim[1])
    height = np.linalg.norm(from_center, axis=1) - radius
    # the reach is told in radii of the disk that has the area of the cap, 2 pi R d / 2
    far = (away > math.sqrt(radius * depth)) & (height > -1e-9)
    assert far.sum() > 1000
    assert np.abs(height[far]).max() < 1e-15
    # by rings of equal distance from the axis: the mean height of a ring times its area
    free = (height > 1e-12) & (from_center[:, 0] > 0)
    across = np.hypot(*from_center[free, 1:].T)
    order = np.argsort(across)
    angle = np.arcsin(np.minimum(across[order] / radius, 1.0))
    volume = np.trapezoid(2 * math.pi * radius**2 * np.sin(angle) * height[free][order], angle)
    assert volume == pytest.approx(math.pi * (depth / 2) ** 2 * (radius - depth / 6), rel=0.05)


def test_depths_are_shared_by_the_stiffnesses():
    soft = vg.deform(two_spheres(0.05, scale=(1.0, 0.6)), stiffness=[1.0, 3.0], spacing=0.2)
    centers, radii = np.array([[2, 3, 3], [2.75, 3, 3]]), np.array([0.5, 0.3])
    for vertices in soft.vertices:
        depth = radii - np.linalg.norm(vertices[:, None] - centers, axis=2)
        common = (depth > 1e-9).all(axis=1)
        assert common.sum() > 50
        assert np.abs(depth[common] @ [1.0, -3.0]).max() < 1e-13
        nearest = vertices[common][np.hypot(*(vertices[common] - 3)[:, 1:].T).argmin()]
        # on the axis the depths are three quarters and one of the whole
        assert nearest[0] == pytest.approx(2.5 - 0.05 * 0.75, abs=2e-4)


def test_a_rigid_grain_keeps_its_shape():
    """The common surface is the cap of the rigid sphere, the force the integral of the depth in the other over it."""
    depth, radius = 0.04, 0.5
    caps = []
    for spacing in (0.2, 0.1, 0.05):
        soft = vg.deform(two_spheres(depth), stiffness=[2.0, np.inf], spacing=spacing)
        assert np.abs(np.linalg.norm(soft.vertices[1] - [2.96, 3, 3], axis=1) - radius).max() < 1e-15
        assert soft.steepness[1] == 0
        assert soft.volume_error < 1e-14
        caps.append(1 - soft.area[0] / (math.pi * radius * depth))
    assert caps[0] > 3 * caps[1] > 9 * caps[2] > 0
    turn = np.linspace(0, math.acos((1 - depth) / 2 / radius), 20001)
    inside = radius - np.sqrt((1 - depth) ** 2 + radius**2 - 2 * (1 - depth) * radius * np.cos(turn))
    force = 2.0 * np.trapezoid(inside * np.cos(turn) * 2 * math.pi * radius**2 * np.sin(turn), turn)
    assert soft.force[0] == pytest.approx(force, rel=1e-3)


def shapes_that_touch():
    """Return shapes of all geometries."""
    spheres = Spheres(np.array([[-0.3, 0, 0], [0.3, 0, 0], [0, 0.3, 0]]), np.array([0.35, 0.35, 0.3]))
    return {
        "clump": vg.Shape.of(spheres, name="clump"),
        "rock": vg.make_shape("solid_union", seed=3),
        "box": vg.make_shape("box", lengths=(1, 0.8, 0.6)),
        "ellipsoid": vg.make_shape("ellipsoid", aspect=(1.4, 1, 0.7)),
        "cylinder": vg.make_shape("cylinder"),
        "cone": vg.make_shape("cone"),
    }


def overlapping(one, other, depth, seed):
    """Return two shapes in random poses, pushed into each other along x until they overlap by a depth."""
    turns = np.random.Generator(np.random.PCG64(seed)).normal(size=(2, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)

    def pair(apart):
        place = [(2, 3, 3), (2 + apart, 3, 3)]
        return vg.Packing.of([one, other], ROOM, position=place, shape_id=[0, 1], orientation=turns)

    def miss(apart):
        found = pair(apart).contacts(1.0)
        return (found.gap[0] if found.count else 1.0) + depth

    return pair(brentq(miss, 0.4, 2.5, xtol=1e-6))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        slow("rock", "clump"),
        ("box", "ellipsoid"),
        slow("cylinder", "cone"),
        slow("rock", "box"),
        ("clump", "ellipsoid"),
    ],
)
def test_any_shapes_give_way_to_each_other(one, other):
    shapes = shapes_that_touch()
    packing = overlapping(shapes[one], shapes[other], 0.03, 5)
    shares = []
    for spacing in (0.4, 0.1):
        soft = vg.deform(packing, spacing=spacing)
        after, before = left_over(packing, soft)[0]
        shares.append(after / before)
        assert soft.volume_error < 1e-13
        assert soft.area[0] > 0
        for grain in range(2):
            body = vg.Shape.from_mesh(soft.vertices[grain], soft.faces[grain])
            assert body.volume == pytest.approx(packing.volumes[grain], rel=0.01)
            assert body.volume == pytest.approx(soft.volume_before[grain], rel=1e-9)
    assert shares[1] < 0.005
    assert shares[1] < 0.5 * shares[0]


@pytest.mark.parametrize("depths", [(0.04, 0.03, 0.02), (0.2, 0.2, 0.2)])
def test_three_grains_share_what_they_have_in_common(depths):
    """Deep ones all have a region in common, which is shared by all three: the disks end at the axis of the three."""
    a, b, c = (1 - depth for depth in depths)
    x = (a * a + b * b - c * c) / (2 * a)
    place = np.array([(2, 2, 3), (2 + a, 2, 3), (2 + x, 2 + math.sqrt(b * b - x * x), 3)])
    packing = vg.Packing.of([BALL], ROOM, position=place)
    soft = vg.deform(packing, spacing=0.2)
    assert len(soft.i) == 3
    assert soft.volume_error < 1e-14
    after, before = left_over(packing, soft).T
    assert after.max() < 1e-9 * before.min()
    for depth, area in zip(np.sort(depths), np.sort(soft.area), strict=True):
        square = 0.5 * depth - depth**2 / 4
        # equal depths: the axis is this far from the middles of the disks
        axis = min((1 - depth) / math.sqrt(12), math.sqrt(square)) if depths[0] == depths[1] else math.sqrt(square)
        cut_off = square * math.acos(axis / math.sqrt(square)) - axis * math.sqrt(square - axis**2)
        assert area == pytest.approx(math.pi * square - cut_off, rel=0.01)


def test_periodic_images_are_partners():
    places = [(x, y, 1.0) for x in (0.9, 1.87) for y in (0.1, 1.06)]
    soft = vg.deform(vg.Packing.of([BALL], vg.Box((1.94, 1.92, 2.0), "xy"), position=places), spacing=0.2)
    # each grain touches two others, both of them directly and across a face
    assert sorted(np.abs(soft.image).tolist()) == [[0, 0, 0]] * 4 + [[0, 1, 0]] * 2 + [[1, 0, 0]] * 2
    for vertices in soft.vertices:
        assert np.ptp(vertices, axis=0)[:2] == pytest.approx([0.97, 0.96], abs=1e-13)
    alone = [vg.deform(two_spheres(depth), spacing=0.2).area[0] for depth in (0.03, 0.04)]
    assert np.sort(soft.area) == pytest.approx(np.repeat(alone, 4), rel=2e-3)
    # a neighbour of the same diameter across the face gives the same
    pair = vg.Packing.of([BALL], vg.Box((1.98, 3, 3), "x"), position=[(0.2, 1, 1), (1.22, 1, 1)])
    assert vg.deform(pair, spacing=0.2).image.tolist() == [[-1, 0, 0]]


def test_without_contact_the_shape_is_restored_bit_for_bit():
    rock = vg.make_shape("solid_union", seed=3)
    place = np.array([(2, 3, 3), (2.97, 3, 3), (4.5, 3, 3)])
    together = vg.Packing.of([BALL, rock], ROOM, position=place, shape_id=[0, 0, 1])
    soft = vg.deform(together)
    apart = vg.Packing.of(
        [BALL, rock], ROOM, position=place + np.array([[0, 0, 0], [0.1, 0, 0], [0, 0, 0]]), shape_id=[0, 0, 1]
    )
    again = vg.deform(apart)
    assert len(again.i) == 0
    assert again.volume_error == 0
    for grain, (one, packing) in enumerate([(again, apart), (again, apart), (soft, together)]):
        assert one.vertices[grain].tobytes() == packing.world_vertices(grain).tobytes()
        assert one.faces[grain].tobytes() == packing.shapes[packing.shape_id[grain]].faces.tobytes()
        volume = enclosed_volume(one.vertices[grain] - packing.position[grain], one.faces[grain])
        assert one.volume_after[grain] == pytest.approx(volume, rel=1e-12)
    # it depends on the present contacts only
    assert vg.deform(together).vertices[0].tobytes() == soft.vertices[0].tobytes()
    none = vg.deform(vg.Packing.of([BALL], ROOM, position=np.zeros((0, 3))))
    assert (none.count, none.volume_error) == (0, 0.0)


def test_bulges_leave_walls_and_neighbours_alone():
    """A sphere on the floor, squeezed between others, with another one almost touching."""
    place = [(3, 3, 0.5), (3.95, 3, 0.5), (2.05, 3, 0.5), (3, 3.95, 0.5), (3, 1.999, 0.5)]
    packing = vg.Packing.of([BALL], ROOM, position=place)
    soft = vg.deform(packing, spacing=0.2)
    assert len(soft.i) == 3
    assert min(vertices[:, 2].min() for vertices in soft.vertices) >= -1e-15
    assert soft.volume_error < 1e-14
    after, before = left_over(packing, soft).T
    assert len(after) > 3
    assert after.max() < 1e-9 * before.max()


def test_bulges_reach_farther_where_there_is_too_little_room(monkeypatch):
    packing = two_spheres(0.04)
    soft = vg.deform(packing, reach=0.3)
    assert soft.reach == pytest.approx([1.2, 1.2])
    assert soft.steepness.max() < 0.45
    assert abs(left_over(packing, soft)[0, 0]) < 1e-12
    # without the limit they would meet, which the exact booleans find
    monkeypatch.setattr(dents, "STEEPEST", 5.0)
    after, before = left_over(packing, vg.deform(packing, reach=0.3))[0]
    assert after > 0.3 * before


def test_a_packing_with_allowed_overlap_gives_way():
    box, options = vg.Box((2, 2, 4), "xy"), {"spacing": 0.25, "overlap": 0.04, "sweeps": 150, "cycles": 2}
    packing = vg.pack(BALL, box, method="control_point", count=10, seed=1, **options)
    soft = vg.deform(packing, spacing=0.3)
    assert len(soft.i) > 5
    assert soft.volume_error < 1e-13
    assert (soft.area > 0).all()
    assert (soft.force > 0).all()
    after, before = left_over(packing, soft).T
    assert after.sum() < 1e-6 * before.sum()


def test_false_position_finds_what_halving_finds():
    functions = [
        lambda x: 1 - x**3 / 8,
        lambda x: 0.5 - x,
        lambda x: math.exp(-x) - 0.3,
        lambda x: 1e-3 - max(x, 0) ** 9,
    ]
    high = np.array([4.0, 4.0, 4.0, 4.0])
    found = crossing(lambda x: np.array([f(v) for f, v in zip(functions, x, strict=True)]), high, 1e-14)
    for f, place in zip(functions, found, strict=True):
        assert place == pytest.approx(brentq(f, 0.0, 4.0, xtol=1e-14), abs=1e-9)
    assert len(crossing(lambda x: x, np.zeros(0), 1e-14)) == 0


def test_surfaces_and_contacts_are_saved(tmp_path):
    soft = vg.deform(two_spheres(0.04), spacing=0.4)
    vg.save_deformed(soft, tmp_path / "soft.vtp")
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "soft.vtp"))
    reader.Update()
    data = reader.GetOutput()
    places = vtk_to_numpy(data.GetPoints().GetData())
    assert places.tobytes() == np.concatenate(soft.vertices).tobytes()
    grain = vtk_to_numpy(data.GetCellData().GetArray("grain"))
    assert np.bincount(grain).tolist() == [len(faces) for faces in soft.faces]
    corners = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    assert (corners[grain == 1] == soft.faces[1] + len(soft.vertices[0])).all()
    assert vtk_to_numpy(data.GetFieldData().GetArray("contact_area")).tobytes() == soft.area.tobytes()
    with pytest.raises(OutputExistsError):
        vg.save_deformed(soft, tmp_path / "soft.vtp")
    with pytest.raises(FileFormatError, match="choose that"):
        vg.save_deformed(soft, tmp_path / "soft.stl")


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"stiffness": 0.0}, "stiffness is 0.0 for grain 0"),
        ({"stiffness": [1.0, -1.0]}, "stiffness is -1.0 for grain 1"),
        ({"stiffness": [1.0, np.nan]}, "stiffness is nan for grain 1"),
        ({"stiffness": [1.0, 1.0, 1.0]}, "one for each of the 2 grains"),
        ({"stiffness": "hard"}, "stiffness"),
        ({"stiffness": np.inf}, "both rigid"),
        ({"spacing": 0.0}, "spacing"),
        ({"reach": -1.0}, "reach"),
    ],
)
def test_bad_input_is_refused(keywords, message):
    with pytest.raises(InputError, match=message):
        vg.deform(two_spheres(0.02), **keywords)


def test_what_cannot_give_way_is_refused(monkeypatch):
    flat = vg.Packing.of([vg.make_shape("disk")], vg.Rectangle((3, 3)), position=[(1, 1, 0)])
    with pytest.raises(InputError, match="flat"):
        vg.deform(flat)
    small_within = vg.Packing.of([BALL], ROOM, position=[(3, 3, 3), (3.1, 3, 3)], scale=[1.0, 0.3])
    with pytest.raises(InputError, match="grain 1 and another one lie"):
        vg.deform(small_within)
    with pytest.raises(InputError, match="grain 0 or 1 lies wholly within the other"):
        vg.deform(small_within, stiffness=[1.0, np.inf])
    cell = list(itertools.product((0.36, 1.08), repeat=3))
    crushed = vg.Packing.of([BALL], vg.Box((1.44, 1.44, 1.44), "xyz"), position=cell)
    with pytest.raises(InputError, match="no room to bulge"):
        vg.deform(crushed, spacing=0.4)
    monkeypatch.setattr(soft_surface, "MOST_VERTICES", 3000)
    with pytest.raises(TooLargeError, match=r"spacing is 0\.1"):
        vg.deform(two_spheres(0.02))


def test_grains_that_coincide_are_refused():
    twins = vg.Packing.of([vg.make_shape("sphere")], vg.Box((6, 6, 6)), position=[(1, 1, 1), (1, 1, 1)])
    with pytest.raises(InputError, match="wholly within"):
        vg.deform(twins)
