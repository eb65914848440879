"""Descriptors of the form, against closed formulas and plain twins."""

import math

import numpy as np
import pytest
from scipy import optimize
from scipy.spatial import ConvexHull

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning, UnknownNameError
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.shapes.describing.curvature import roundness
from voxgran.shapes.describing.inscribed import inscribed_radius
from voxgran.shapes.describing.ratios import principal_lengths
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import sphere


def as_mesh(shape):
    return vg.Shape.from_mesh(shape.vertices, shape.faces)


def turned(shape, seed=0):
    return shape.rotated(random_rotations(stream(seed, "turn"), 1)[0])


def rounded_square(radius, sides=32):
    """Return a square of edge 1 whose corners are arcs."""
    turns = np.pi / 2 * (np.arange(4)[:, None] + np.arange(sides + 1) / sides)
    middles = (0.5 - radius) * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    arcs = middles[:, None] + radius * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    return vg.make_shape("polygon", vertices=arcs.reshape(-1, 2))


@pytest.mark.parametrize(
    ("family", "parameters", "lengths"),
    [
        ("sphere", {"radius": 2.0}, (4, 4, 4)),
        ("box", {"lengths": (2, 1, 3)}, (3, 2, 1)),
        ("ellipsoid", {"semi_axes": (1, 3, 2)}, (6, 4, 2)),
        ("cylinder", {"radius": 1.0, "height": 3.0}, (3, 2, 2)),
    ],
)
def test_principal_lengths_of_solids_in_closed_form(family, parameters, lengths):
    shape = turned(vg.make_shape(family, **parameters))
    assert principal_lengths(shape) == pytest.approx(lengths)
    # the search finds them as well
    assert principal_lengths(as_mesh(shape)) == pytest.approx(lengths, rel=0.02)


def test_a_regular_tetrahedron_lies_in_a_cube_of_three_times_its_volume():
    shape = turned(vg.make_shape("platonic", solid="tetrahedron"), seed=3)
    assert principal_lengths(shape) == pytest.approx([(3 * shape.volume) ** (1 / 3)] * 3, rel=1e-5)


def test_lengths_in_the_plane_are_those_of_the_smallest_rectangle():
    kite = vg.make_shape("polygon", vertices=[[0, 0], [4, 0], [4, 1.5], [1, 2]])
    assert principal_lengths(turned_in_plane(kite, 0.7)) == pytest.approx([4, 2, 0])
    sheet = turned(vg.make_shape("sheet", lengths=(3, 2)))
    assert principal_lengths(sheet) == pytest.approx([3, 2, 0], abs=1e-9)


def turned_in_plane(shape, angle):
    return shape.rotated([math.cos(angle / 2), 0, 0, math.sin(angle / 2)])


def test_no_box_of_many_is_smaller():
    turns = rotation_matrices(random_rotations(stream(1, "turns"), 20_000))
    for seed in range(4):
        shape = vg.make_shape("convex_polyhedron", seed=seed, points=12, aspect=(1, 1.2, 2))
        along = turns @ shape.vertices.T
        assert principal_lengths(shape).prod() <= 1.0005 * (along.max(axis=2) - along.min(axis=2)).prod(axis=1).min()


@pytest.mark.parametrize(
    ("family", "parameters", "radius"),
    [
        ("box", {"lengths": (2, 1, 3)}, 0.5),
        ("cylinder", {"radius": 1.0, "height": 1.0}, 0.5),
        ("cone", {"radius": 3.0, "height": 4.0}, 1.5),
        ("spherocylinder", {"radius": 0.7, "height": 4.0}, 0.7),
        ("ellipsoid", {"semi_axes": (1, 3, 2)}, 1.0),
    ],
)
def test_inscribed_spheres(family, parameters, radius):
    shape = vg.make_shape(family, **parameters)
    assert inscribed_radius(shape) == pytest.approx(radius)
    assert inscribed_radius(as_mesh(turned(shape))) == pytest.approx(radius, rel=0.01)


def test_inscribed_sphere_of_a_solid_that_is_not_convex():
    # two bars of a cross share a cube of edge 1
    bars = vg.Shape.from_mesh(*cross())
    assert inscribed_radius(turned(bars)) == pytest.approx(math.sqrt(0.5), rel=1e-3)
    notched = vg.make_shape("polygon", vertices=[[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3]])
    # of a corner of two strips of width 1: the circle touches two outer sides and the inner corner
    assert inscribed_radius(notched) == pytest.approx(1 / (1 + math.sqrt(0.5)), rel=1e-4)


def sphere_by_every_point(shape, points=60):
    """Return the largest depth on a lattice, and the largest difference from the radius of the inscribed sphere."""
    axes = shape.dimension
    low, high = shape.bounds[:, :axes]
    step = (high - low).max() / points
    places = np.stack(np.meshgrid(*[np.arange(a, b, step) for a, b in zip(low, high, strict=True)], indexing="ij"), -1)
    flat = np.zeros((places[..., 0].size, 3))
    flat[:, :axes] = places.reshape(-1, axes)
    return float(-shape.signed_distance(flat).min()), step * math.sqrt(axes) / 2


@pytest.mark.parametrize(
    ("family", "seed"),
    [("random_growth", 0), ("cube_rain", 1), ("noise_star", 2), ("solid_union", 3), ("mollon_zhao_2d", 4)],
)
def test_inscribed_spheres_against_all_points_of_a_lattice(family, seed):
    shape = vg.make_shape(family, seed=seed)
    radius = inscribed_radius(shape)
    deepest, slack = sphere_by_every_point(shape)
    assert deepest <= radius * (1 + 1e-9)
    assert radius <= deepest + slack


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_inscribed_sphere_of_a_solid_with_known_center_is_exact(scale):
    # two boxes in a row, the larger one of edge 2, joined by a thin bar: the sphere fills the larger one
    from voxgran.shapes.boolean import united
    from voxgran.shapes.tessellate import unit_box

    vertices, faces, _ = unit_box()
    parts = [(vertices * 2, faces), (vertices * 1.9 + [4, 0, 0], faces), (vertices * [4, 0.5, 0.5] + [2, 0, 0], faces)]
    mesh = united(parts)
    shape = turned(vg.Shape.from_mesh(scale * mesh[0], mesh[1]))
    assert inscribed_radius(shape) == pytest.approx(scale, rel=1e-8)


def test_a_ridge_of_equal_spheres_is_found_exactly():
    # an L of two long bars of square section: the sphere in the corner touches two outer sides and the inner edge
    long = vg.make_shape("polygon", vertices=[[0, 0], [40, 0], [40, 1], [1, 1], [1, 30], [0, 30]])
    assert inscribed_radius(turned_in_plane(long, 0.4)) == pytest.approx(1 / (1 + math.sqrt(0.5)), rel=1e-8)


def test_depths_below_the_known_one_are_left_out():
    from voxgran.shapes.describing import inscribed

    shape = vg.make_shape("noise_star", seed=1)
    places = stream(0, "places").uniform(-0.6, 0.6, size=(500, 3))
    depth = -shape.signed_distance(places)
    near = np.full(500, -1)
    found = inscribed._depths(shape._tree, places, near, 0.1, 0.3)
    known = np.isfinite(found)
    assert found[known] == pytest.approx(depth[known], abs=1e-12)
    assert (depth[~known] <= max(0.3, depth.max()) - 0.1).all()
    assert 0 < known.sum() < 450
    # where a triangle is known, that or any other, the depth is the same
    for guess in (near, np.arange(500) % len(shape.faces)):
        again = inscribed._depths(shape._tree, places, guess.copy(), 10.0, 0.0)
        assert again == pytest.approx(depth, abs=1e-12)


@pytest.mark.parametrize("axes", [2, 3])
def test_the_best_step_is_that_of_a_linear_program(axes):
    from voxgran.shapes.describing import inscribed

    generator = stream(axes, "programs")
    for k in range(60):
        ways = generator.normal(size=(int(generator.integers(1, 60)), axes))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        spare = generator.uniform(0, 2, len(ways))
        if k % 4 == 0:
            # rows that are alike, and several that bind at one place
            ways, spare = np.round(2 * ways) / 2, np.round(spare, 1)
        step, most = inscribed._best_step(ways, spare)
        twin = optimize.linprog(
            [0.0] * axes + [-1.0],
            A_ub=np.column_stack([-ways, np.ones(len(ways))]),
            b_ub=spare,
            bounds=[(-1, 1)] * axes + [(None, None)],
        )
        assert most == pytest.approx(-twin.fun, abs=1e-9)
        assert np.abs(step).max() <= 1 + 1e-12
        assert (spare + ways @ step).min() == pytest.approx(most, abs=1e-12)


def test_the_smallest_rectangle_has_a_side_of_the_convex_hull():
    from voxgran.shapes.describing import ratios

    for seed in range(30):
        points = stream(seed, "plane").normal(size=(3 + seed, 2))
        (wide, deep), way = ratios._rectangle(points)
        assert np.linalg.norm(way) == pytest.approx(1.0)
        assert np.ptp(points @ way) == pytest.approx(wide, rel=1e-12)
        corners = points[ConvexHull(points).vertices]
        sides = np.roll(corners, -1, axis=0) - corners
        sides /= np.linalg.norm(sides, axis=1, keepdims=True)
        across = np.column_stack([-sides[:, 1], sides[:, 0]])
        least = (np.ptp(points @ sides.T, axis=0) * np.ptp(points @ across.T, axis=0)).min()
        assert wide * deep == pytest.approx(least, rel=1e-12)


def cross():
    """Return a cross of two bars 3 x 1 x 5, so high that only its plan counts."""
    from voxgran.shapes.boolean import united
    from voxgran.shapes.tessellate import unit_box

    vertices, faces, _ = unit_box()
    return united([(vertices * [3, 1, 5], faces), (vertices * [1, 3, 5], faces)])


def test_roundness_of_rounded_corners_is_their_radius_over_that_of_the_inscribed_circle():
    for radius in (0.05, 0.2, 0.4):
        assert roundness(rounded_square(radius)) == pytest.approx(radius / 0.5, rel=2e-3)
    assert roundness(vg.make_shape("polygon", corners=4)) == 0.0
    assert roundness(vg.make_shape("disk")) == 1.0


def test_roundness_of_an_ellipse_is_the_mean_over_its_narrow_ends():
    ellipse = vg.make_shape("polygon", corners=2000, stretch=2.0)
    a, b = principal_lengths(ellipse)[:2] / 2
    t = (np.arange(200_000) + 0.5) * np.pi / 100_000
    speed = np.hypot(a * np.sin(t), b * np.cos(t))
    curvature = a * b / speed**3
    corner = curvature * b * 0.98 > 1
    expected = speed[corner].sum() / (b * (curvature * speed)[corner].sum())
    assert roundness(ellipse) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("family", ["box", "cylinder", "platonic"])
def test_solids_with_sharp_edges_only_have_no_roundness(family):
    shape = turned(vg.make_shape(family))
    assert roundness(shape) == pytest.approx(0.0, abs=1e-12)
    assert roundness(as_mesh(shape)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("height", [2.0, 0.4, 60.0])
def test_roundness_of_a_spheroid_is_the_mean_over_its_poles_or_its_rim(height):
    # semi-axes 1, 1 and the height; principal curvatures are those along the meridian and around the axis
    shape = vg.make_shape("ellipsoid", semi_axes=(1, 1, height))
    t = (np.arange(1_000_000) + 0.5) * np.pi / 1_000_000
    meridian = np.hypot(np.cos(t), height * np.sin(t))
    along, around = height / meridian**3, height / meridian
    area, larger = np.sin(t) * meridian, np.maximum(along, around)
    inside = min(1.0, height)
    corner = larger * inside * 0.98 > 1
    expected = area[corner].sum() / (inside * (area * larger)[corner].sum())
    assert roundness(turned(shape).scaled(1e-55)) == pytest.approx(expected, rel=5e-4)
    assert roundness(as_mesh(turned(shape))) == pytest.approx(expected, rel=0.02)


def test_roundness_of_an_ellipsoid_is_that_of_a_fine_mesh():
    shape, (points, faces, _) = vg.make_shape("ellipsoid", semi_axes=(1, 2, 4)), sphere(5)
    assert roundness(vg.Shape.from_mesh(points * [1, 2, 4], faces)) == pytest.approx(roundness(shape), rel=4e-3)


@pytest.mark.parametrize(("height", "expected"), [(1.0, 0.0532), (3.0, 0.2524), (10.0, 0.4120)])
def test_roundness_of_a_cone_is_the_mean_over_rim_and_apex(height, expected):
    shape = turned(vg.make_shape("cone", radius=1.0, height=height))
    assert roundness(shape) == pytest.approx(expected, abs=5e-5)
    # rings of the mantle, of which those near the apex are narrow, and the rim, which is sharp
    slant, ring = math.hypot(1.0, height), (np.arange(100_000) + 0.5) / 100_000
    curvature, inside = height / slant / ring, height / (1 + slant)
    area = 2 * np.pi * ring * slant / 100_000
    corner = curvature * inside * 0.98 > 1
    angle = (area * curvature)[corner].sum() + 2 * np.pi * (np.pi - math.acos(1 / slant))
    assert roundness(shape) == pytest.approx(area[corner].sum() / (inside * angle), rel=1e-4)
    # the narrow triangles of its tessellation say nothing of the curvature along them
    assert math.isnan(roundness(as_mesh(shape)))


def test_roundness_of_spheres_is_the_mean_over_what_shows_of_them():
    # a sphere of radius 1 with caps of two of radius 0.5, whose centers lie 0.9 and 1.2 from its center
    shape = vg.Shape.of(Spheres(np.array([[0.0, 0, 0], [0, 0, 0.9], [1.2, 0, 0]]), np.array([1.0, 0.5, 0.5])), name="c")
    cosines = [(d * d + 0.25 - 1) / (2 * d * 0.5) for d in (0.9, 1.2)]
    areas = [2 * np.pi * 0.25 * (1 + c) for c in cosines]
    inside = inscribed_radius(shape)
    assert inside > 0.52
    assert roundness(shape) == pytest.approx(sum(areas) / (inside * sum(areas) / 0.5), rel=1e-12)
    assert roundness(vg.Shape.of(Spheres(np.zeros((1, 3)), np.ones(1), shape.geometry.mass), name="one")) == 1.0


def test_a_mesh_too_coarse_for_a_curvature_has_no_roundness(eros):
    coarse = vg.simplify(eros, faces=300).shape
    with pytest.warns(PackingWarning, match=r"^roundness of 'eros' is NaN: too coarse a mesh"):
        assert math.isnan(vg.describe(coarse, "roundness").roundness.item())
    assert math.isnan(roundness(vg.simplify(eros, faces=100).shape))
    assert 0.3 < roundness(vg.simplify(eros, faces=2000).shape) < 0.45
    # polygons likewise, of which few corners are sharp and many make a curve
    turns = [roundness(vg.make_shape("polygon", corners=corners)) for corners in (8, 10, 20)]
    assert turns == pytest.approx([0.0, math.nan, 1.0], nan_ok=True)


def test_dents_are_no_corners():
    # the inner corner of the cross turns inward; those outside are sharp
    assert roundness(vg.Shape.from_mesh(*cross())) == 0.0
    wavy = rounded_square(0.3).vertices[:, :2]
    dented = vg.make_shape("polygon", vertices=np.vstack([wavy, [[0.0, -0.45]]]))
    assert 0.3 < roundness(dented) < 0.65


def test_numbers_do_not_depend_on_pose_and_size():
    shape = vg.make_shape("solid_union", seed=4)
    other = turned(shape).scaled(7.0)
    assert principal_lengths(other) == pytest.approx(7 * principal_lengths(shape), rel=2e-3)
    assert inscribed_radius(other) == pytest.approx(7 * inscribed_radius(shape), rel=1e-3)
    assert roundness(other) == pytest.approx(roundness(shape), abs=2e-3)


@pytest.mark.parametrize("factor", [1e-55, 1e50])
def test_areas_of_ellipsoids_of_extreme_size_keep_all_digits(factor):
    semi_axes = np.array([1.0, 2.0, 3.0])
    usual, extreme = (vg.describe(vg.make_shape("ellipsoid", semi_axes=semi_axes * f)) for f in (1.0, factor))
    assert extreme.surface_area.item() / factor**2 == pytest.approx(usual.surface_area.item(), rel=1e-13)
    assert extreme.sphericity.item() == pytest.approx(usual.sphericity.item(), rel=1e-13)


def test_table_of_shapes():
    box = vg.make_shape("box", lengths=(4, 2, 1))
    table = vg.describe([box, vg.make_shape("sphere", radius=2.0)])
    assert table.sizes == {"shape": 2}
    assert table["name"].values.tolist() == ["box", "sphere"]
    assert table.elongation.values == pytest.approx([0.5, 1.0])
    assert table.flatness.values == pytest.approx([0.5, 1.0])
    assert table.krumbein_sphericity.values == pytest.approx([(2 / 16) ** (1 / 3), 1.0])
    assert table.corey_shape_factor.values == pytest.approx([1 / math.sqrt(8), 1.0])
    assert table.sphericity.values == pytest.approx([math.pi ** (1 / 3) * 48 ** (2 / 3) / 28, 1.0])
    assert table.convexity.values == pytest.approx([1.0, 1.0])
    assert table.roundness.values == pytest.approx([0.0, 1.0])
    assert table.volume.attrs["units"] == "1"
    assert "Wadell 1932" in table.sphericity.attrs["source"]


def test_convexity_of_a_cross():
    shape = vg.Shape.from_mesh(*cross())
    assert vg.describe(shape, "convexity").convexity.item() == pytest.approx(5 / 7)
    corner = vg.make_shape("polygon", vertices=[[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3]])
    assert vg.describe(corner, "convexity").convexity.item() == pytest.approx(6 / 9)


def test_table_of_a_packing_has_its_grains_at_their_sizes():
    box = vg.Shape.of(Primitive("box", (4.0, 2.0, 1.0)), name="brick", unit="mm")
    packing = vg.Packing.of(
        [box, vg.make_shape("sphere", diameter=1.0)],
        vg.Box((30, 30, 30)),
        position=[[5, 5, 5], [15, 15, 15], [25, 25, 25]],
        shape_id=[0, 1, 0],
        scale=[1.0, 2.0, 3.0],
        unit="mm",
    )
    table = vg.describe(packing, ["volume", "surface_area", "longest_length", "elongation"])
    assert set(table.data_vars) == {"volume", "surface_area", "longest_length", "elongation"}
    assert table.sizes == {"grain": 3}
    assert table["name"].values.tolist() == ["brick", "sphere", "brick"]
    assert table.volume.values == pytest.approx([8, 4 / 3 * math.pi, 216])
    assert table.surface_area.values == pytest.approx([28, 4 * math.pi, 252])
    assert table.longest_length.values == pytest.approx([4, 2, 12])
    assert [table[name].attrs["units"] for name in table.data_vars] == ["mm^3", "mm^2", "mm", "1"]


def test_flat_and_open_shapes_have_what_is_defined():
    flat = vg.describe(vg.make_shape("polygon", corners=4))
    assert flat.sphericity.item() == pytest.approx(math.sqrt(math.pi) / 2)
    assert flat.volume.attrs["units"] == flat.surface_area.attrs["units"] == "1"
    assert math.isnan(flat.flatness.item())
    sheet = vg.describe(vg.make_shape("sheet"))
    assert all(math.isnan(sheet[name].item()) for name in ("sphericity", "convexity", "roundness"))
    assert vg.describe([]).sizes == {"shape": 0}


def test_wrong_calls_are_explained():
    with pytest.raises(InputError, match="what is 3: it must be a packing, a shape"):
        vg.describe(3)
    with pytest.raises(UnknownNameError, match="did you mean 'sphericity'"):
        vg.describe(vg.make_shape("box"), "sphericty")
    shapes = [vg.make_shape("sphere").to_unit("mm"), vg.make_shape("sphere").to_unit("m")]
    with pytest.raises(InputError, match="the shapes have the units m, mm"):
        vg.describe(shapes)


@pytest.mark.parametrize("factor", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize(
    ("solid", "radius"),
    [("tetrahedron", 1 / math.sqrt(24)), ("cube", 0.5), ("octahedron", 1 / math.sqrt(6)),
     ("dodecahedron", math.sqrt((25 + 11 * math.sqrt(5)) / 40)),
     ("icosahedron", (3 * math.sqrt(3) + math.sqrt(15)) / 12)],
)  # fmt: skip
def test_the_largest_sphere_in_a_mesh_is_found_to_rounding(solid, radius, factor):
    body = vg.shapes.platonic(solid=solid)
    edge = np.linalg.norm(np.diff(body.vertices[body.faces[:, :2]], axis=1), axis=2).min()
    turn = rotation_matrices(np.array([[0.5, -0.5, 0.1, 0.7]]))[0].T
    shape = vg.Shape.from_mesh(factor / edge * body.vertices @ turn, body.faces)
    assert inscribed_radius(shape) == pytest.approx(factor * radius, rel=1e-7)


def test_the_largest_sphere_in_a_torus_of_facets_lies_between_those_of_its_section():
    ring = vg.shapes.torus()
    across = np.hypot(ring.vertices[:, 0], ring.vertices[:, 1])
    tube = (across.max() - across.min()) / 2
    assert 0.98 * tube < inscribed_radius(ring) <= tube
