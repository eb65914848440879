"""Solid fractions of the whole and of the bulk, for every container."""

import math
from dataclasses import replace

import numpy as np
import pytest
from kit import lattice

from voxgran._base.errors import PackingWarning
from voxgran._base.seeds import stream
from voxgran.contacts.find import find_contacts
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.measures.model import measure
from voxgran.measures.region import Regions, SampledRegion, Samples, gravity_of, held_height
from voxgran.measures.registered.density import bulk_solid_fraction
from voxgran.measures.window import Solids
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.tessellate import revolved, unit_box

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
CUBE = Shape.of(Primitive("box", (1.0, 1.0, 1.0)), name="cube")
CYLINDER = Shape.of(Primitive("cylinder", (0.5, 1.0)), name="cylinder")
DISK = Shape.of(Outline("disk", radius=0.5), name="disk")


def stacked(shape, counts, container, **more):
    """Return grains of diameter 1 side by side from the origin on."""
    position = lattice(*counts)
    if len(counts) == 2:
        position = np.column_stack([position, np.zeros(len(position))])
    return Packing.of([shape], container, position=position, **more)


def test_the_bulk_of_a_filled_box():
    packing = stacked(BALL, (8, 8, 12), Box((8, 8, 12)))
    # 1.5 diameters from five walls, and 85 % of 12 layers is within the third row from the top
    region = Regions(packing).at(1.5)
    height = held_height(Solids(packing), 2, -1)
    assert region.lower == pytest.approx([1.5] * 3)
    assert region.upper[:2] == pytest.approx([6.5] * 2)
    assert region.upper[2] == height
    # 0.2 of the eleventh layer is missing: the cap of height h has the volume 0.2 pi / 6
    share = 0.85 * 12 - 10
    cap = height - 10
    assert math.pi * cap**2 * (1.5 - cap) / 3 == pytest.approx(share * math.pi / 6, rel=1e-12)
    layers = math.pi / 6 * 25 * 8.5 + 25 * share * math.pi / 6
    # in x and y the region ends in the middle of spheres: five whole ones in place of four and two halves
    assert bulk_solid_fraction(packing) == pytest.approx(layers / (25 * (height - 1.5)), rel=1e-12)


@pytest.mark.parametrize(
    ("gravity", "axis", "sign"),
    [("-x", 0, -1), ("+x", 0, 1), ("-y", 1, -1), ("+z", 2, 1), ((0.1, -0.2, -3), 2, -1), ((0, 5, 1), 1, 1)],
)
def test_the_bulk_ends_below_the_free_surface_wherever_gravity_acts(gravity, axis, sign):
    packing = stacked(BALL, (8, 8, 8), Box((8, 8, 8)), gravity=gravity)
    assert gravity_of(packing) == (axis, sign)
    limits = Regions(packing).limits
    edge = limits[0 if sign > 0 else 1, axis]
    assert np.isinf(limits).sum() == 5
    filled = edge if sign < 0 else 8 - edge
    # 0.85 * 8 = 6.8 layers
    cap = 7 - filled
    assert math.pi * cap**2 * (1.5 - cap) / 3 == pytest.approx(0.2 * math.pi / 6, rel=1e-12)


def test_without_gravity_the_walls_alone_count():
    walls = Box((8, 8, 8), periodic=(False, False, True))
    packing = stacked(BALL, (8, 8, 8), walls)
    assert gravity_of(packing) is None
    assert bulk_solid_fraction(packing) == pytest.approx(math.pi / 6, rel=1e-12)
    free = stacked(BALL, (8, 8, 8), Box((8, 8, 8)), gravity=None)
    assert gravity_of(free) is None
    assert Regions(free).at(1.5).upper.tolist() == [6.5] * 3
    told = stacked(BALL, (2, 2, 2), Box((2, 2, 2)), provenance={"parameters": {"gravity": "+x"}})
    assert gravity_of(told) == (2, -1)
    flat = stacked(DISK, (8, 8), Rectangle((8, 8)))
    assert gravity_of(flat) == (1, -1)


def test_few_grains_give_nan_and_a_warning():
    for packing, held in [
        (stacked(BALL, (4, 4, 4), Box((4, 4, 4))), 8),
        (stacked(BALL, (5, 5, 5), Box((5, 5, 5), periodic=(False, False, True))), 45),
        (stacked(BALL, (2, 2, 2), Box((2, 2, 2))), 0),
    ]:
        with pytest.warns(PackingWarning, match=f"the bulk holds {held} of the grains"):
            found = bulk_solid_fraction(packing)
        assert math.isnan(found)
        assert math.isnan(found.error)


def test_disks_in_a_rectangle():
    packing = stacked(DISK, (16, 16), Rectangle((16, 16), periodic=(True, False)))
    found = bulk_solid_fraction(packing)
    height = held_height(Solids(packing), 1, -1)
    filled = 0.85 * 16 - 1.5
    assert found == pytest.approx(math.pi / 4 * filled / (height - 1.5), rel=1e-12)


def test_overlap_counts_once_in_the_bulk():
    packing = stacked(CUBE, (8, 8, 8), Box((8, 8, 8), periodic=(True, True, True)), scale=np.full(512, 1.25))
    assert packing.solid_fraction == pytest.approx(1.25**3)
    spheres = stacked(BALL, (8, 8, 8), Box((8, 8, 8), periodic=(True, True, True)), scale=np.full(512, 1.2))
    cap = math.pi * 0.1**2 * (3 * 0.6 - 0.1) / 3
    wanted = 4 / 3 * math.pi * 0.6**3 - 6 * cap
    assert bulk_solid_fraction(spheres) == pytest.approx(wanted, rel=1e-12)
    few = stacked(CUBE, (2, 2, 2), Box((2, 2, 2), periodic=(True, True, True)), scale=np.full(8, 1.25))
    assert Solids(few).volume(np.zeros(3), np.full(3, 2.0)) == pytest.approx(8.0, rel=1e-9)


def inside_cylinder(radius, height):
    """Return stacked spheres that lie in a cylinder, at random heights above each other."""
    packing = stacked(BALL, (2 * radius, 2 * radius, height), Box((2 * radius, 2 * radius, height)))
    position = packing.position - np.array([radius, radius, 0])
    held = np.hypot(position[:, 0], position[:, 1]) <= radius - 0.5
    return position[held]


def test_spheres_in_a_cylinder():
    packing = Packing.of(
        [BALL], Cylinder(5, 12, origin=(1, 2, 3)), position=inside_cylinder(5, 12) + np.array([1, 2, 3])
    )
    found = bulk_solid_fraction(packing)
    region = Regions(packing).at(1.5)
    assert (region.radius, region.lower) == (3.5, 4.5)
    # the same with points
    steps = 90
    axis = (np.arange(steps) + 0.5) / steps * 7 - 3.5
    tall = region.lower + (np.arange(steps) + 0.5) / steps * (region.upper - region.lower) - 3
    points = np.stack(np.meshgrid(axis, axis, tall, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[np.hypot(points[:, 0], points[:, 1]) <= 3.5]
    # spheres lie around half-integer coordinates
    solid = (np.abs(points - np.floor(points) - 0.5) ** 2).sum(axis=1) <= 0.25
    assert found == pytest.approx(solid.mean(), abs=2e-3)
    assert 0 <= found.error < 1e-9


def test_overlapping_spheres_in_a_cylinder_state_the_cut_overlap():
    position = inside_cylinder(5, 12)
    container = Cylinder(5, 12)
    bare = bulk_solid_fraction(
        Packing.of([BALL], container, position=position, provenance={"parameters": {"gravity": "none"}})
    )
    fat = Packing.of(
        [BALL],
        container,
        position=position,
        scale=np.full(len(position), 1.02),
        provenance={"parameters": {"gravity": "none"}},
    )
    region = Regions(fat).at(1.53)
    found = region.solid(Regions(fat).solids)
    assert found.error > 0
    cap = math.pi * 0.01**2 * (3 * 0.51 - 0.01) / 3
    wanted = 4 / 3 * math.pi * 0.51**3 - 6 * cap
    assert found / region.volume == pytest.approx(bare * wanted / (math.pi / 6), rel=0.02)


def test_grains_in_cylinders_and_closed_meshes_are_sampled_with_an_error():
    position = inside_cylinder(5, 12)
    wanted = bulk_solid_fraction(Packing.of([BALL], Cylinder(5, 12), position=position))
    # spheres as meshes: the same number by points
    mesh = Shape.from_mesh(BALL.vertices, BALL.faces, name="mesh")
    scale = np.full(len(position), 1 / mesh.diameter)
    sampled = bulk_solid_fraction(Packing.of([mesh], Cylinder(5, 12), position=position, scale=scale))
    assert sampled.error > 0
    assert abs(sampled - wanted) < 4 * sampled.error
    assert sampled.error < 0.01 * wanted
    round_wall = Shape.from_mesh(*revolved([(0.0, 5.0), (12.0, 5.0)], sides=200)[:2], name="wall")
    walled = bulk_solid_fraction(Packing.of([BALL], ClosedMesh(round_wall), position=position))
    assert abs(walled - wanted) < 4 * walled.error
    assert walled.error < 0.02 * wanted


def test_a_closed_mesh_that_is_a_box():
    vertices, faces, _ = unit_box()
    packing = stacked(CUBE, (9, 9, 9), ClosedMesh(Shape.from_mesh((vertices + 0.5) * 9, faces, name="box")))
    found = bulk_solid_fraction(packing)
    assert abs(found - 1.0) < 4 * found.error
    assert found.error < 0.02


def test_cylinders_as_grains_state_a_bound():
    packing = stacked(CYLINDER, (8, 8, 8), Box((8, 8, 8), periodic=(True, True, True)))
    assert bulk_solid_fraction(packing) == pytest.approx(math.pi / 4, rel=1e-12)
    walled = stacked(CYLINDER, (8, 8, 8), Box((8, 8, 8)), provenance={"parameters": {"gravity": "none"}})
    regions = Regions(walled)
    found, room = regions.at(1.5).solid(regions.solids), regions.at(1.5).volume
    assert abs(found - math.pi / 4 * room) <= found.error
    assert 0 < found.error < 1e-4 * room


def test_the_numbers_in_the_tree():
    packing = stacked(BALL, (8, 8, 8), Box((8, 8, 8), periodic=(True, True, True)), unit="mm")
    root = measure(packing, which=["density"]).to_dataset()
    assert float(root.solid_fraction) == packing.solid_fraction
    assert float(root.porosity) == 1 - packing.solid_fraction
    assert int(root["count"]) == int(root.bulk_count) == 512
    assert float(root.container_volume) == float(root.bulk_volume) == 512.0
    assert float(root.grain_volume) == pytest.approx(512 * math.pi / 6)
    assert root.container_volume.attrs["units"] == "mm^3"
    assert root.mean_diameter.attrs["units"] == "mm"
    assert root.bulk_solid_fraction.attrs["error"] == 0.0


def test_a_scene_in_other_units_gives_the_same_bits():
    generator = stream(7, "bits")
    position = generator.uniform(0.5, 7.5, (200, 3))
    scale = generator.uniform(0.5, 1.0, 200)
    found = []
    for factor in (1.0, 2.0**20, 2.0**-20):
        container = Box((8, 8, 8), periodic=(True, True, False)).scaled(factor)
        packing = Packing.of([BALL], container, position=position * factor, scale=scale * factor)
        found.append(float(bulk_solid_fraction(packing)))
    assert found[0] == found[1] == found[2]


@pytest.mark.filterwarnings("ignore:the bulk holds")
def test_the_solid_fraction_below_the_surface_of_a_bed_reaches_from_wall_to_wall():
    """85 % of 12 layers of spheres: ten whole ones and 0.2 of the next, up to the height where that is reached."""
    packing = stacked(BALL, (3, 3, 12), Box((3, 3, 20)), gravity="-z")
    height = held_height(Solids(packing), 2, -1)
    root = measure(packing, which="density")
    assert float(root["bed_solid_fraction"]) == pytest.approx(0.85 * 12 * math.pi / 6 / height, rel=1e-9)
    assert 10 < height < 11
    # without gravity there is no surface
    assert "bed_solid_fraction" not in measure(replace(packing, gravity=None), which="density")
    disks = stacked(DISK, (4, 10), Rectangle((4, 30)), gravity="-y")
    height = held_height(Solids(disks), 1, -1)
    root = measure(disks, which="density")
    assert float(root["bed_solid_fraction"]) == pytest.approx(8.5 * math.pi / 4 / height, rel=1e-9)


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-6, 25.4])
def test_centroids_in_a_face_of_the_bulk_count_in_any_unit(unit):
    box = Box((6 * unit, 5 * unit, 5 * unit), periodic="x")
    position = (lattice(6, 5, 5)) * unit
    packing = Packing.of([BALL], box, position=position, scale=np.full(150, unit), gravity=None)
    tree = measure(packing, "density")
    assert int(tree.bulk_count) == 54
    assert float(tree.bulk_solid_fraction) == pytest.approx(math.pi / 6)


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-6, 25.4])
def test_centroids_in_the_faces_of_a_cylinder_and_of_a_sampled_region_count_in_any_unit(unit):
    turns = np.arange(12) * np.pi / 6
    ring = np.column_stack([3.3 * np.cos(turns), 3.3 * np.sin(turns), np.full(12, 1.7)])
    for position in (ring, ring + np.array([0, 0, 4.6])):
        packing = Packing.of([BALL], Cylinder(5 * unit, 8 * unit), position=position * unit, scale=np.full(12, unit))
        assert Regions(packing).at(1.7 * unit).grains(packing).sum() == 12
        sampled = SampledRegion(Samples.of(packing), 1.7 * unit, np.array([[-np.inf] * 3, [np.inf] * 3]))
        assert sampled.grains(packing).sum() == 12
        beyond = SampledRegion(sampled.samples, 0.0, sampled.limits, until=1.7 * unit)
        assert not beyond.grains(packing).any()
        assert not Regions(packing).at(1.71 * unit).grains(packing).any()


@pytest.mark.filterwarnings("ignore:.*bulk")
def test_overlaps_and_the_wetted_surface_take_the_same_contacts(monkeypatch):
    """Finding contacts of meshes is most of the time of the measure."""
    packing = Packing.of(CUBE, Box((4, 4, 4)), position=[(1, 1, 1), (2.0, 1, 1), (2.9, 2, 2)])
    asked = []

    def found(*given):
        asked.append(given)
        return find_contacts(*given)

    monkeypatch.setattr("voxgran.packing.model.find_contacts", found)
    measure(packing, which="density")
    assert len(asked) == 1
