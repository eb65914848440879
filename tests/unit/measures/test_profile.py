"""Solid fraction along axes and from walls."""

import math

import numpy as np
import pytest

from voxgran._base.errors import InputError
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.kinds.sphere import Sphere
from voxgran.measures.model import measure
from voxgran.measures.registered.profile import DOUBT, WINDOW, axis_profile, cylinder_profiles, wall_profile
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.tessellate import unit_box

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
CUBE = Shape.of(Primitive("box", (1.0, 1.0, 1.0)), name="cube")
DISK = Shape.of(Outline("disk", radius=0.5), name="disk")
FREE = {"gravity": None}


def test_a_sphere_is_a_stack_of_disks():
    packing = Packing.of([BALL], Box((1, 1, 1)), position=[[0.5, 0.5, 0.5]])
    profile = axis_profile(packing, "z", bins=10)
    z = profile.edges - 0.5
    disks = math.pi * np.diff(0.25 * z - z**3 / 3) / 0.1
    assert profile.solid_fraction == pytest.approx(disks, rel=1e-13)
    assert profile.error.tolist() == [0.0] * 10
    assert profile.middle == pytest.approx(np.arange(10) * 0.1 + 0.05)


@pytest.mark.parametrize("axis", "xyz")
def test_the_mean_is_the_solid_fraction(axis):
    packing = Packing.of([BALL, CUBE], Box((3, 4, 5), periodic="yz"), position=[[1, 0, 0], [1, 2, 3]], shape_id=[0, 1])
    assert axis_profile(packing, axis, bins=13).solid_fraction.mean() == pytest.approx(
        packing.solid_fraction, rel=1e-12
    )


def test_disks_along_both_axes():
    packing = Packing.of([DISK], Rectangle((2, 1)), position=[[0.5, 0.5, 0], [1.5, 0.5, 0]], **FREE)
    along = axis_profile(packing, "x", bins=4).solid_fraction
    assert along == pytest.approx([math.pi / 4] * 4, rel=1e-13)
    with pytest.raises(InputError, match="axis is 'z'"):
        axis_profile(packing, "z")


def test_a_cylinder_is_narrower_at_its_sides():
    packing = Packing.of([BALL], Cylinder(1, 1), position=[[0, 0, 0.5]], **FREE)
    profile = axis_profile(packing, "x", bins=2)
    assert profile.solid_fraction == pytest.approx([math.pi / 6 / math.pi] * 2, rel=1e-13)
    quarters = axis_profile(packing, "x", bins=4)
    assert quarters.solid_fraction[0] == 0.0
    segment = math.pi / 3 - math.sqrt(3) / 4  # of a circle beyond half of its radius
    assert quarters.solid_fraction[1] == pytest.approx(math.pi / 12 / (math.pi / 2 - segment), rel=1e-12)


def test_a_closed_mesh_is_cut_too():
    vertices, faces, _ = unit_box()
    turned = vertices @ np.array([[1, -1, 0], [1, 1, 0], [0, 0, math.sqrt(2)]]) / math.sqrt(2) * 4
    packing = Packing.of([BALL], ClosedMesh(Shape.from_mesh(turned, faces, name="box")), position=[[0, 0, 0]], **FREE)
    profile = axis_profile(packing, "x", bins=2)
    assert profile.solid_fraction == pytest.approx([math.pi / 6 / 64] * 2, rel=1e-12)


def test_from_the_walls_of_a_box():
    # one cube in the middle of a box: at distance x from the walls the shell is solid from 1 on
    packing = Packing.of([CUBE], Box((3, 3, 3)), position=[[1.5, 1.5, 1.5]], **FREE)
    profile = wall_profile(packing, step=0.25)
    assert profile.edges[-1] == 1.5
    assert profile.solid_fraction == pytest.approx([0, 0, 0, 0, 1, 1], abs=1e-12)


def test_from_the_walls_of_a_rectangle_without_gravity():
    packing = Packing.of([DISK], Rectangle((4, 1), periodic=(True, False)), position=[[1, 0.5, 0]])
    profile = wall_profile(packing, step=0.25)
    ends = np.array([0.5, 0.25, 0.0])
    segment = 0.25 * np.arccos(ends / 0.5) - ends * np.sqrt(0.25 - ends**2)
    filled = np.diff(segment) * 2 / (4 * 0.5)
    # gravity is along y: what lies above 85 % of the area is left out, on one side
    free = Packing.of([DISK], packing.container, position=packing.position, **FREE)
    assert wall_profile(free, step=0.25).solid_fraction == pytest.approx(filled, rel=1e-12)
    assert len(profile.edges) == 3


def test_from_the_wall_of_a_cylinder():
    packing = Packing.of([BALL], Cylinder(2, 4), position=[[0, 0, 2]], **FREE)
    profile = wall_profile(packing, step=0.5)
    shells = np.pi * np.array([2 - e for e in profile.edges]) ** 2 * (4 - 2 * profile.edges)
    total = (profile.solid_fraction * -np.diff(shells)).sum()
    assert total == pytest.approx(math.pi / 6, rel=1e-9)
    assert profile.solid_fraction[:2] == pytest.approx([0, 0], abs=1e-12)


def test_without_walls_there_is_none():
    packing = Packing.of([BALL], Box((3, 3, 3), periodic="xyz"), position=[[1, 1, 1]])
    with pytest.raises(InputError, match="needs grains and a wall"):
        wall_profile(packing)
    assert "solid_fraction_wall" not in measure(packing, which=["profile"])["profiles"]


def test_the_profiles_in_the_tree():
    packing = Packing.of([BALL], Box((3, 3, 3)), position=[[1, 1, 1], [2, 2, 2]], unit="mm", **FREE)
    found = measure(packing, which=["profile"])["profiles"]
    assert found.x.attrs["units"] == "mm"
    assert found.solid_fraction_z.dims == ("z",)
    assert found.solid_fraction_z_error.values.max() == 0.0
    assert float(found.solid_fraction_y.mean()) == pytest.approx(packing.solid_fraction, rel=1e-12)
    assert found.solid_fraction_wall.dims == ("wall_distance",)


def test_the_mass_density_where_densities_differ():
    """Heavy spheres lie below light ones: the mean over the container is the mass over its volume."""
    position = [(x + 0.5, y + 0.5, z + 0.5) for z in (0, 2) for x in range(3) for y in range(3)]
    told = {"position": position, "shape_id": [0] * 9 + [1] * 9, **FREE}
    bed = Packing.of([BALL, BALL], Box((3, 3, 4)), density=(7800, 2500), **told)
    tree = measure(bed, "profile")["profiles"]
    for axis in "xyz":
        assert float(tree[f"mass_density_{axis}"].mean()) == pytest.approx(bed.masses.sum() / 36)
    along = tree["mass_density_z"].sel(z=slice(0, 1)), tree["solid_fraction_z"].sel(z=slice(0, 1))
    np.testing.assert_allclose(along[0], 7800 * along[1])
    along = tree["mass_density_z"].sel(z=slice(2, 3)), tree["solid_fraction_z"].sel(z=slice(2, 3))
    np.testing.assert_allclose(along[0], 2500 * along[1])
    one = Packing.of([BALL], Box((3, 3, 4)), position=position, density=7800)
    assert "mass_density_z" not in measure(one, "profile")["profiles"]


@pytest.mark.parametrize("shape", [BALL, CUBE])
def test_bins_whose_windows_are_too_small_have_no_value(shape):
    places = np.stack(np.meshgrid(*[np.arange(-3, 4) * 1.01] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    places = places[np.linalg.norm(places, axis=1) < 2.9]
    profile = wall_profile(Packing.of([shape], Sphere(4.0), position=places, **FREE))
    # the shell of a bin, half a diameter wider on both sides
    d = shape.diameter
    outer, inner = 4.0 - profile.edges[:-1] + d / 2, (4.0 - profile.edges[1:] - d / 2).clip(min=0)
    room = 4 / 3 * math.pi * (outer.clip(max=4.0) ** 3 - inner**3)
    known = np.isfinite(profile.solid_fraction)
    assert known[room > 3 * WINDOW * shape.volume].all()
    assert not known[room < 0.9 * WINDOW * shape.volume].any()
    assert 2 <= (~known).sum() <= 10
    assert (profile.error[known] <= DOUBT).all()
    assert (profile.solid_fraction[known] < 1.2).all()
    # caps of the sphere are slices of no use, too
    along = axis_profile(Packing.of([BALL], Sphere(1.3), position=[(0, 0, 0)]), "x").solid_fraction
    assert np.isnan(along[[0, -1]]).all()
    assert np.isfinite(along[2:-2]).all()


def test_bins_that_are_asked_for_have_values_whatever_their_windows():
    packing = Packing.of([BALL], Box((1, 1, 1)), position=[[0.5, 0.5, 0.5]])
    assert np.isfinite(axis_profile(packing, "z", bins=9).solid_fraction).all()
    assert np.isnan(axis_profile(packing, "z").solid_fraction).all()
    assert np.isfinite(wall_profile(packing, step=0.1).solid_fraction).all()


@pytest.mark.filterwarnings("ignore:the bulk holds")
@pytest.mark.parametrize("container", [Box((4, 4, 12)), Cylinder(2.5, 12), Box((4, 4, 12), periodic="xy")])
def test_of_a_bed_the_room_above_it_is_part_of_no_profile_across_gravity(container):
    bed = pack(BALL, container, "gravity", count=60, seed=1)
    found = measure(bed, which=["density", "profile"])
    room = float(found.bed_solid_fraction) * np.array([1.0, 1.0])
    for axis, wanted in zip("xy", room, strict=True):
        profile = axis_profile(bed, axis, bins=1)
        assert profile.solid_fraction[0] == pytest.approx(wanted, rel=1e-9)
    # along gravity the whole container is shown
    assert axis_profile(bed, "z", bins=1).solid_fraction[0] == pytest.approx(bed.solid_fraction, rel=1e-9)
    surface = bed.surface_areas.sum() / bed.volumes.sum() * float(found.bed_solid_fraction)
    assert float(found.specific_surface) == pytest.approx(surface, rel=1e-9)


def test_a_bed_of_two_materials_ends_at_one_height():
    bed = pack([BALL, BALL], Box((4, 4, 12), periodic="xy"), "gravity", count=60, density=(2.0, 3.0), seed=1)
    found = measure(bed, "profile")["profiles"]
    low, high = found.solid_fraction_x * 2.0, found.solid_fraction_x * 3.0
    assert ((found.mass_density_x >= low - 1e-12) & (found.mass_density_x <= high + 1e-12)).all()


def test_layers_on_the_floor_and_rings_at_the_mantle_are_told_apart():
    # spheres on the axis of a cylinder, and a layer in the middle of its height that reaches its mantle
    layer = [(math.cos(a) * 3.5, math.sin(a) * 3.5, 5.0) for a in np.arange(21) * 2 * math.pi / 21]
    packing = Packing.of([BALL], Cylinder(4, 10), position=[*((0, 0, z + 0.5) for z in range(10)), *layer], **FREE)
    radial, axial = cylinder_profiles(packing)
    inner = radial.middle < 0.5
    # the column, away from the ends, and nothing beside it up to the layer
    rings = math.pi * np.diff(radial.edges**2) * 7
    held = np.nan_to_num(radial.solid_fraction) * rings
    assert (radial.solid_fraction[(radial.middle > 0.6) & (radial.middle < 2.9)] == 0).all()
    assert held[radial.middle > 3].sum() == pytest.approx(21 * math.pi / 6, rel=1e-6)
    assert held[inner].sum() < 7 * math.pi / 6 + 1e-9
    # along the axis the layer at the mantle is left out: each sphere of the column shows its width
    assert axial.solid_fraction.mean() * math.pi * 2.5**2 * 10 == pytest.approx(10 * math.pi / 6, rel=1e-6)
    cubes = Packing.of([CUBE], packing.container, position=packing.position, scale=[0.7] * 31, **FREE)
    sampled, core = cylinder_profiles(cubes)[1], 4 - 1.5 * float(cubes.diameters[0])
    assert sampled.solid_fraction.mean() * math.pi * core**2 * 10 == pytest.approx(10 * 0.343, abs=0.05)
    assert "solid_fraction_radial" not in measure(Packing.of([BALL], Box((3, 3, 3)), position=[[1, 1, 1]]), "profile")
