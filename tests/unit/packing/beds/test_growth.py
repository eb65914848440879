"""Seeds in a column, and the beds that grow from them."""

import re

import kit
import numpy as np
import pytest
from kit import slow
from manifold3d import Manifold
from scipy.stats import spearmanr

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran.packing.beds.expected import expected_bed, warn_of_height
from voxgran.packing.beds.filling import AT_SURFACE, AT_WALLS, ROOM, usual_solid_fraction, volume_at_rest
from voxgran.packing.beds.seeds import column_top, random_seeds

SPHERE = vg.make_shape("sphere")
UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    "container",
    [vg.Box((6, 6, 8), periodic="xy"), vg.Box((6, 6, 8)), vg.Cylinder(radius=3.0, height=8.0), vg.Sphere(radius=4.0)],
    ids=["periodic", "walls", "cylinder", "sphere"],
)
def test_seeds_do_not_overlap(container):
    """Nor do they reach beyond a wall or the top of the column; large and small ones are mixed."""
    generator = np.random.default_rng(3)
    radii = np.exp(generator.normal(-1.2, 0.5, 150))
    lower = np.array(container.bounds[0])
    top = float(lower[2] + 6.0)
    centers, made = random_seeds(container, radii, up=UP, top=top, generator=generator)
    packing = vg.Packing.of([SPHERE], container, position=centers, scale=2 * made)
    assert packing.verify(tolerance=1e-12).ok
    assert (centers @ UP + made <= top + 1e-12).all()
    assert (made <= radii).all()


def test_seeds_without_room_become_smaller_and_then_are_refused():
    generator = np.random.default_rng(1)
    box = vg.Box((2, 2, 2))
    centers, made = random_seeds(box, np.full(30, 0.5), up=UP, top=2.0, generator=generator)
    assert made.min() < 0.5
    assert vg.Packing.of([SPHERE], box, position=centers, scale=2 * made).verify(tolerance=1e-12).ok
    with pytest.raises(InputError, match="find no place for their seeds"):
        random_seeds(vg.Box((2, 2, 9)), np.full(30, 0.5), up=UP, top=0.001, generator=generator)


@pytest.mark.parametrize("gravity", ["-z", "+x"])
def test_few_grains_in_a_wide_container(gravity):
    """A layer of them has room in the column, and points are drawn in it alone."""
    packing = vg.pack(SPHERE, vg.Box((500, 400, 300)), "gravity", count=5, gravity=gravity)
    assert packing.forces.share_at_rest == 1.0
    low = packing.position[:, 2] if gravity == "-z" else 500 - packing.position[:, 0]
    np.testing.assert_allclose(low, 0.5, atol=1e-3)


def test_the_column_holds_the_volume():
    """A box to the share of its height, a sphere to the height of its cap."""
    generator = np.random.default_rng(2)
    box = vg.Box((3, 4, 10))
    level, room = column_top(box, UP, 0.4 * box.volume, generator)
    assert level - box.bounds[0][2] == pytest.approx(4.0, abs=0.1)
    assert room == box.volume
    level, room = column_top(box, UP, 0.4 * box.volume, generator, box.bounds[0][2] + 3.0)
    assert level - box.bounds[0][2] == pytest.approx(7.0, abs=0.1)
    assert room == pytest.approx(0.7 * box.volume, rel=0.02)
    round_container = vg.Sphere(radius=2.0)
    middle, _ = column_top(round_container, UP, 0.5 * round_container.volume, generator)
    assert middle == pytest.approx(float(np.mean(round_container.bounds, axis=0)[2]), abs=0.06)


@pytest.mark.slow
def test_beds_of_graded_spheres_are_not_sorted():
    """Spearman's correlation of diameter and height; 200 lognormal spheres."""
    sizes = vg.sizes.lognormal(median=1.0, sigma=0.3)
    for seed in range(2):
        bed = vg.pack(SPHERE, vg.Box((6, 6, 20), periodic="xy"), "gravity", count=200, sizes=sizes, seed=seed)
        assert bed.stop_reason == "settled"
        assert bed.verify().ok
        assert abs(spearmanr(bed.diameters, bed.position[:, 2])[0]) < 0.15


def test_more_grains_than_fit_are_left_out():
    with pytest.warns(PackingWarning, match="were placed"):
        bed = vg.pack(SPHERE, vg.Box((5, 5, 5), periodic="xy"), "gravity", count=200)
    assert bed.stop_reason == "full"
    assert 100 <= bed.count <= 115
    assert bed.provenance["settling"]["resting"] >= 0.95
    assert bed.position[:, 2].max() <= 4.5
    assert bed.verify().ok


@pytest.mark.parametrize(
    ("shape", "container", "parameters"),
    [
        slow(SPHERE, vg.Box((10, 10, 8.2)), {}),
        slow(SPHERE, vg.Box((8, 8, 8)), {"sizes": vg.sizes.lognormal(1.0, 0.4)}),
        (SPHERE, vg.Cylinder(2.0, 6.0), {}),
        slow(SPHERE, vg.Sphere(4.0), {}),
        slow(vg.make_shape("platonic", solid="tetrahedron"), vg.Box((6, 6, 6)), {}),
        slow(vg.make_shape("box", aspect=(1, 1, 8)), vg.Box((8, 8, 8)), {}),
        (vg.make_shape("disk"), vg.Rectangle((12, 12)), {}),
        (vg.make_shape("polygon", corners=3), vg.Rectangle((12, 12)), {}),
        (vg.make_shape("polygon", corners=4), vg.Rectangle((12, 12)), {}),
    ],
    ids=["walls", "graded", "cylinder", "sphere", "tetrahedra", "rods", "disks", "triangles", "squares"],
)
def test_by_default_a_container_is_filled_to_below_its_top(shape, container, parameters):
    """The bed rests, with a free surface, whatever walls and grains are, and takes most of the container."""
    bed = vg.pack(shape, container, "gravity", **parameters)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    up = -np.array(bed.gravity)
    level = np.quantile(bed.position @ up, 0.95) - min(bound @ up for bound in container.bounds)
    height = (container.bounds[1] - container.bounds[0]) @ up
    assert 0.6 * height < level < height - 0.5


@pytest.mark.parametrize(
    ("shape", "container", "count", "parameters"),
    [
        (SPHERE, vg.Box((1.07, 1.07, 3.1)), 3, {}),
        (SPHERE, vg.Box((1.07, 1.07, 5.0)), 3, {}),
        (vg.make_shape("sphere", diameter=28.0), vg.Box((30, 30, 84)), 3, {}),
        (SPHERE, vg.Cylinder(0.53, 3.1), 3, {}),
        (vg.make_shape("disk"), vg.Rectangle((1.07, 3.1)), 3, {}),
        (vg.make_shape("box"), vg.Box((1.8, 1.8, 4)), 2, {}),
        (SPHERE, vg.Box((3.1, 1.07, 1.07)), 3, {"gravity": "-x"}),
        (SPHERE, vg.Box((10, 1.07, 1.07)), 9, {}),
        (SPHERE, vg.Box((10, 1.02, 1.001)), 9, {}),
        (SPHERE, vg.Box((1.07, 1.07, 3.3)), 3, {"gravity": (1.0, 0.0, -1.0)}),
        (SPHERE, vg.Box((10, 1.07, 1.07), periodic="x"), 9, {}),
        (SPHERE, vg.Box((10, 10, 1.05)), 60, {}),
        (SPHERE, vg.Box((10, 10, 1.07)), 75, {}),
        (SPHERE, vg.Box((10, 10, 1.07), periodic="xy"), 75, {}),
        (SPHERE, vg.Box((4.3, 1.07, 4.3)), 16, {}),
        (SPHERE, vg.Box((10, 10, 2)), 130, {}),
    ],
    ids=[
        "spheres",
        "higher",
        "tight",
        "cylinder",
        "disks",
        "cubes",
        "along x",
        "lying",
        "without clearance",
        "leaning",
        "periodic",
        "one layer",
        "full layer",
        "periodic layer",
        "slit",
        "low",
    ],
)
def test_narrow_and_low_containers_hold_what_fits(shape, container, count, parameters):
    bed = vg.pack(shape, container, "gravity", count=count, **parameters)
    assert bed.count == count
    assert bed.stop_reason == "settled"
    assert bed.verify().ok


def test_a_leaning_column_is_filled_to_the_height():
    """A sphere at x has its top at (x + 0.5) / sqrt(2) + 0.5 or a little above: that of the fifth is nearest to 4."""
    with pytest.warns(PackingWarning, match="or below the height that is asked for"):
        bed = vg.pack(SPHERE, vg.Box((10, 1.07, 1.07)), "gravity", count=9, height=4.0, gravity=(-1.0, 0.0, -1.0))
    assert bed.count == 5


@pytest.mark.parametrize(
    ("container", "least", "most"),
    [(vg.Box((1.3, 1.3, 10)), 10, 10), (vg.Box((1.5, 1.5, 10)), 11, 13), (vg.Box((1.6, 1.6, 10)), 13, 17)],
)
def test_narrow_columns_hold_no_more_than_a_zigzag(container, least, most):
    """Spheres of which no two lie side by side rise by sqrt(1 - w^2) at least, w the width that is left."""
    across = np.sqrt(2.0) * (container.lengths[0] - 1.0)
    assert most <= 1 + 9.0 / np.sqrt(1.0 - across**2)
    with pytest.warns(PackingWarning, match="no more are expected to come to rest below the top of the container"):
        bed = vg.pack(SPHERE, container, "gravity", count=20)
    assert least <= bed.count <= most
    assert bed.verify().ok


@pytest.mark.parametrize(
    ("container", "count"),
    [(vg.Box((6, 6, 12), periodic="xy"), 250), (vg.Box((8, 8, 12)), 400), (vg.Cylinder(4, 12), 350),
     slow(vg.Sphere(4.5), 250)],
    ids=["periodic", "walls", "cylinder", "sphere"],
)  # fmt: skip
def test_the_expected_bed_is_the_one_that_comes(container, count):
    """To 10 percent: the height below which 95 percent of the grains have their tops, and the grains of the bulk."""
    expected = expected_bed(kit.task_of("gravity", SPHERE, container, count=count).problem)
    bed = vg.pack(SPHERE, container, "gravity", count=count)
    tops = np.quantile(bed.position[:, 2] + 0.5, 0.95) - container.bounds[0][2]
    assert expected.depth == pytest.approx(tops, rel=0.1)
    assert expected.bulk == pytest.approx(int(bed.measure("density")["bulk_count"]), rel=0.2)
    assert expected.note == ""


@pytest.mark.slow
def test_a_bed_without_a_bulk_is_told_before_it_is_packed():
    """Two layers in a wide cylinder: a solid fraction is asked of them that only a bulk has."""
    steps, options = [], {"method": "gravity", "count": 60, "solid_fraction": 0.6, "time_limit": 0.0}
    with pytest.warns(PackingWarning) as told:
        vg.pack(SPHERE, vg.Cylinder(4.0, 6.0), on_step=steps.append, **options)
    words = r"expected to be about (\d\.\d) median diameters deep, with about 0 grains in its bulk: at least 50"
    depth = float(re.search(words, str(told[0].message))[1])
    assert next(step.text for step in steps if step.stage == "expected bed").startswith("about ")
    # so is it where they settle after they were packed, in any unit of lengths
    loose = vg.pack(SPHERE.scaled(0.5), vg.Cylinder(2.0, 3.0), "rsa", count=60)
    with pytest.warns(PackingWarning) as told:
        vg.settle(loose, gravity="-z", solid_fraction=0.6)
    assert float(re.search(words, str(told[0].message))[1]) == pytest.approx(depth, rel=0.05)
    # without gravity there is no bed, and no depth
    assert expected_bed(kit.task_of("rsa", SPHERE, vg.Box((5, 5, 5)), count=10).problem) is None


def test_a_looser_column_falls_farther():
    """The same grains from a column of half the solid fraction come to rest as well."""
    for fill in (0.25, 0.5):
        bed = vg.pack(SPHERE, vg.Box((5, 5, 20), periodic="xy"), "gravity", count=80, fill=fill)
        assert bed.stop_reason == "settled"
    with pytest.raises(InputError, match=r"fill is 0\.9"):
        vg.pack(SPHERE, vg.Box((5, 5, 20)), "gravity", count=80, fill=0.9)


def pierced(holes, radius, sides=12):
    """Return a cylinder of radius 1 and height 2 with bores of a radius at places (x, y), of the volume of SPHERE."""
    body = Manifold.cylinder(2.0, 1.0, 1.0, sides)
    for x, y in holes:
        body -= Manifold.cylinder(4.0, radius, radius, 8).translate((x, y, -1.0))
    mesh = body.to_mesh()
    found = vg.Shape.from_mesh(np.asarray(mesh.vert_properties, float)[:, :3], np.asarray(mesh.tri_verts, np.int64))
    return found.scaled(1.0 / found.diameter)


def of_unit_size(family, seed):
    """Return a random shape of unit equivalent diameter."""
    shape = vg.make_shape(family, seed=seed)
    return shape.scaled(1.0 / shape.diameter)


def grown(seed):
    """Return a grain of random growth, which is far looser than its hull."""
    return of_unit_size("random_growth", seed)


def of_spheres():
    """Return assemblies of spheres."""
    return [of_unit_size("sphere_assembly", seed) for seed in range(3)]


RING, FOUR = pierced([(0, 0)], 0.55), pierced([(0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5)], 0.27)
WALLED = vg.Box((10, 10, 20))
OPEN = vg.Box((7, 7, 30), periodic="xy")


@pytest.mark.parametrize(
    ("shape", "container", "height", "parameters"),
    [
        (SPHERE, OPEN, 8.0, {}),
        slow(SPHERE, OPEN, 8.0, {"friction": 0.0}),
        (SPHERE, OPEN, 8.0, {"sizes": vg.sizes.lognormal(median=1.0, sigma=0.3)}),
        (SPHERE, vg.Box((10, 10, 20), periodic="xy"), 4.0, {}),
        slow(SPHERE, WALLED, 8.0, {}),
        slow(SPHERE, vg.Box((5, 5, 30)), 20.0, {}),
        (SPHERE, vg.Cylinder(2.0, 6.0), 5.0, {}),
        slow(SPHERE, vg.Sphere(5.0), 6.0, {}),
        (vg.make_shape("disk"), vg.Rectangle((15, 40)), 10.0, {}),
        (vg.make_shape("disk"), vg.Rectangle((20, 40), periodic="x"), 6.0, {}),
        slow([vg.make_shape("convex_polyhedron", seed=seed) for seed in range(3)], vg.Box((7, 7, 20)), 8.0, {}),
        slow(vg.make_shape("box", aspect=(1, 1, 4)), vg.Box((8, 8, 20)), 8.0, {}),
        slow(RING, vg.Box((6, 6, 14), periodic="xy"), 9.0, {}),
        slow(FOUR, vg.Box((6, 6, 14), periodic="xy"), 9.0, {}),
        (SPHERE, vg.Box((5, 5, 16)), 6.0, {"fall_height": 20.0}),
        (grown(0), vg.Box((5, 5, 12)), 6.0, {}),
        slow([grown(seed) for seed in range(3)], vg.Box((6, 6, 16), periodic="xy"), 8.0, {}),
        slow(of_spheres(), vg.Box((6, 6, 14)), 6.0, {"friction": 0.0}),
        slow(of_spheres(), vg.Cylinder(3.0, 10.0), 6.0, {"fall_height": 1.0}),
    ],
    ids=["open", "frictionless", "graded", "low", "walls", "narrow", "cylinder", "sphere", "disks", "open disks",
         "polyhedra", "rods", "rings", "four holes", "fallen", "grown", "grown mixed", "frictionless assemblies",
         "fallen assemblies"],
)  # fmt: skip
def test_a_height_counts_the_grains(shape, container, height, parameters):
    """The bed ends at the height that is asked, between walls or not, whatever the grains are."""
    bed = vg.pack(shape, container, "gravity", height=height, **parameters)
    axis = bed.dimension - 1
    tops = [bed.world_vertices(grain)[:, axis].max() for grain in range(bed.count)]
    if bed.shapes[0].is_sphere:
        tops = bed.position[:, axis] + 0.5 * bed.diameters
    assert bed.stop_reason == "settled"
    # the tops of the uppermost grains, without the few that lie on the others
    assert np.quantile(tops, 0.95) - container.bounds[0][axis] == pytest.approx(height, rel=0.05)


def test_bores_that_grains_hardly_enter_count_as_the_hull_that_they_are_in():
    """Bores make a bed lighter by nearly their share of the hull, however large their surface is."""
    box, found = vg.Box((8, 8, 20), periodic="xy"), []
    for shape in (pierced([], 0.0), RING, FOUR):
        task = kit.task_of("gravity", shape, box, count=50)
        found.append(usual_solid_fraction(task.problem))
    shares = [vg.describe(shape).convexity.item() for shape in (RING, FOUR)]
    assert found[1:] == pytest.approx([found[0] * share**0.85 for share in shares], rel=1e-6)


def test_a_bed_that_is_made_again_for_its_height_goes_on_from_its_checkpoint(tmp_path):
    """The second bed has grains of the same draw, and a run that is stopped anywhere ends with the same bits."""
    box, asked = vg.Box((4, 4, 12), periodic="xy"), {"height": 6.0, "fall_height": 30.0}
    whole = vg.pack(SPHERE, box, "gravity", **asked)
    assert whole.provenance["counters"]["met_beds"] > 1
    path, parts = tmp_path / "bed.ckpt", 0
    while (
        vg.pack(SPHERE, box, "gravity", checkpoint=path, resume=True, time_limit=0.1, **asked).stop_reason != "settled"
    ):
        parts += 1
    again = vg.pack(SPHERE, box, "gravity", checkpoint=path, resume=True, **asked)
    assert parts
    assert again.position.tobytes() == whole.position.tobytes()
    assert again.provenance["counters"] == whole.provenance["counters"]


def test_a_height_that_is_missed_is_told():
    """Few large grains in a narrow container reach no height that is expected of many."""
    task = kit.task_of("gravity", SPHERE, vg.Box((4, 4, 20), periodic="xy"), height=5.0)
    bed = vg.pack(SPHERE, vg.Box((4, 4, 20), periodic="xy"), "gravity", count=40)
    with pytest.warns(PackingWarning, match=r"the surface of the bed is at .* instead of 5: .*count=\d+ in place"):
        warn_of_height(task, bed)


def test_a_height_in_the_unit_of_the_container_and_with_a_count():
    box = vg.Box((4e-3, 4e-3, 2e-2), periodic="xy")
    grains = vg.make_shape("sphere", diameter=1e-3)
    bed = vg.pack(grains, box, "gravity", height=3e-3)
    same = vg.pack(SPHERE, vg.Box((4, 4, 20), periodic="xy"), "gravity", height=3.0)
    assert bed.count == same.count > 40
    few = vg.pack(grains, box, "gravity", height=3e-3, count=20)
    assert few.count == 20


def test_heights_that_no_bed_has_are_refused_or_told():
    box = vg.Box((5, 5, 5))
    refused = [
        (6.0, r"height is 6, and the container is 5 high.*give a height within it"),
        (0.01, r"height is 0\.01, and the median diameter of the grains is 1: a bed is at least as high"),
    ]
    for height, words in refused:
        with pytest.raises(InputError, match=words):
            vg.pack(SPHERE, box, "gravity", height=height)
        with pytest.raises(InputError, match=words):
            prepare_cost(height, box)
    with pytest.warns(PackingWarning, match=r"height is 4\.9, and grains are filled to 4\.2 only"):
        bed = vg.pack(SPHERE, box, "gravity", height=4.9)
    assert bed.stop_reason == "settled"


def prepare_cost(height, container):
    """What a plan asks for."""
    task = kit.task_of("gravity", SPHERE, container, count=10, height=height)
    return task.method.cost(task.problem)


def test_a_lid_lies_on_the_bed_that_it_presses():
    bed = vg.pack(SPHERE, vg.Box((4e-3, 4e-3, 8e-3), periodic="xy"), "gravity", count=30, lid={"weight": 2.0},
        sizes=vg.sizes.fixed(1e-3))  # fmt: skip
    top = (bed.position[:, 2] + 0.5 * bed.diameters).max()
    assert bed.lid.normal == pytest.approx([0.0, 0.0, 1.0])
    assert top <= bed.lid.level <= top + 2e-6
    assert (bed.forces.j == -2).any()


def test_grains_that_are_less_round_are_expected_to_pack_looser():
    """Bulk solid fractions that were measured, to 10 percent; friction 0.5."""
    measured = {
        ("sphere", ()): 0.582, ("platonic", (("solid", "cube"),)): 0.546, ("box", (("aspect", (1, 1, 4)),)): 0.433,
        ("box", (("aspect", (1, 1, 8)),)): 0.332, ("ellipsoid", (("aspect", (1, 1, 4)),)): 0.491,
        ("cone", ()): 0.545, ("disk", ()): 0.785,
    }  # fmt: skip
    for (family, parameters), expected in measured.items():
        container = vg.Rectangle((9, 9)) if family == "disk" else vg.Box((9, 9, 9))
        task = kit.task_of("gravity", vg.make_shape(family, **dict(parameters)), container, count=10)
        assert usual_solid_fraction(task.problem) == pytest.approx(expected, rel=0.1)
    free = kit.task_of("gravity", SPHERE, vg.Box((9, 9, 9)), count=10, friction=0.0)
    assert usual_solid_fraction(free.problem) == pytest.approx(0.63, rel=0.01)


def test_the_volume_at_rest_follows_the_closed_form_of_a_cap():
    """Of a sphere that is smaller by the layer at its wall."""
    sphere = vg.Sphere(4.0)
    task = kit.task_of("gravity", SPHERE, sphere, count=10)
    height = 3.0
    radius, depth = 4.0 - AT_WALLS, height - AT_SURFACE - AT_WALLS
    cap = np.pi * depth**2 * (3 * radius - depth) / 3
    found = volume_at_rest(task.problem, UP, height, np.random.default_rng(0))
    assert found == pytest.approx(usual_solid_fraction(task.problem) * cap, rel=0.03)


@pytest.mark.parametrize("thickness", [1.0, 0.3])
def test_below_walls_that_hang_over_there_is_room_as_below_the_top(thickness):
    """A hole of a polygon, also a thin one: the layers at its sides and top, and the room below it, hold no grains."""
    wide, low = 7.0, 4.0
    hole = np.array([(0, 0), (wide, 0), (wide, thickness), (0, thickness)]) + np.array([1.5, low])
    square = [(0, 0), (10, 0), (10, 10), (0, 10)]
    disk, up, height = vg.make_shape("disk"), np.array([0.0, 1.0, 0.0]), 9.0
    open_area = (10 - 2 * AT_WALLS) * (height - AT_SURFACE - AT_WALLS)
    around = thickness * (wide + 2 * AT_WALLS) + wide * AT_WALLS + np.pi * AT_WALLS**2
    for holes, area in (((), open_area), ((hole,), open_area - around - wide * (ROOM + AT_SURFACE))):
        task = kit.task_of("gravity", disk, vg.Polygon(square, holes=holes), count=10)
        found = volume_at_rest(task.problem, up, height, np.random.default_rng(0))
        assert found == pytest.approx(usual_solid_fraction(task.problem) * area, rel=0.01)


@pytest.mark.slow
def test_beds_below_a_sloping_roof_rest_without_being_asked_for_fewer_grains():
    """Filled up to the roof, these pentagons were wedged below it and crept on."""
    roofed = vg.Polygon([(0, 0), (6, 0), (6, 4), (3, 2.5), (0, 4)], holes=[[(2, 1), (3, 1), (3, 2), (2, 2)]])
    pentagon = vg.make_shape("polygon", corners=5)
    bed = vg.pack(pentagon, roofed, "gravity", sizes=vg.sizes.uniform(0.3, 0.5), seed=3)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    assert bed.gravity == (0.0, -1.0, 0.0)
    assert 0.6 < bed.solid_fraction < 0.7


class CountedBox(vg.Box):
    """A box that counts the points whose distance it is asked for."""

    asked = 0

    def signed_distance(self, points):
        CountedBox.asked += len(points)
        return super().signed_distance(points)


def test_the_room_for_grains_is_measured_once_for_the_cost_and_once_for_the_bed():
    """Once takes some 16 points for each of the 20,000 of a sample."""
    CountedBox.asked = 0
    vg.pack(SPHERE, CountedBox((6, 6, 12)), "gravity", count=50)
    assert CountedBox.asked < 2.5 * 16 * 20_000
