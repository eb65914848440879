import math

import numpy as np
import pytest

from voxgran._base.errors import InputError, UnknownNameError
from voxgran.shapes.families.random.convex_polyhedron import ConvexPolyhedron
from voxgran.shapes.family import make_shape, make_shapes, seeds_of_shapes, shape_families

NAMES = shape_families()


def test_families_are_found():
    assert tuple(sorted(NAMES)) == NAMES
    assert set(NAMES) >= {"sphere", "ellipsoid", "box", "cylinder", "cone", "disk", "convex_polyhedron", "solid_union"}


def test_sizes_in_place_of_the_diameter():
    assert make_shape("box", lengths=(1, 2, 3)).volume == pytest.approx(6)
    assert make_shape("box", aspect=(1, 2, 3)).geometry.dimensions[2] == pytest.approx(3 * (math.pi / 36) ** (1 / 3))
    assert make_shape("ellipsoid", semi_axes=(1, 2, 3)).volume == pytest.approx(8 * math.pi)
    assert make_shape("cylinder", radius=1, height=2).volume == pytest.approx(2 * math.pi)
    assert make_shape("cone", radius=1, height=3).volume == pytest.approx(math.pi)
    assert make_shape("sphere", diameter=2).volume == pytest.approx(4 / 3 * math.pi)
    assert make_shape("disk", diameter=2).volume == pytest.approx(math.pi)
    assert make_shape("cylinder", aspect=2).geometry.dimensions[1] == pytest.approx(
        4 * make_shape("cylinder", aspect=2).geometry.dimensions[0]
    )
    corners = [[0, 0], [2, 0], [0, 1]]
    assert make_shape("polygon", vertices=corners).volume == pytest.approx(1.0)
    assert make_shape("polygon", corners=4, stretch=2.0).volume == pytest.approx(math.pi / 4)


def test_convex_polyhedra_are_convex():
    shape = make_shape("convex_polyhedron", seed=4, points=30, aspect=(1, 2, 3))
    a, b, c = np.moveaxis(shape.vertices[shape.faces], 1, 0)
    normals = np.cross(b - a, c - a)
    heights = np.einsum("fi,vi->fv", normals, shape.vertices) - np.einsum("fi,fi->f", normals, a)[:, None]
    assert heights.max() < 1e-14
    assert len(shape.vertices) == 30
    assert len(make_shape("convex_polyhedron", points=4).faces) == 4


BAD = [
    ("sphere", {"diameter": 0.0}, "diameter is 0.0"),
    ("sphere", {"diameter": "large"}, "it must be a number"),
    ("box", {"lengths": (1, 2)}, "list of 3"),
    ("box", {"lengths": (1, 2, -3)}, "above 0"),
    ("box", {"lengths": (1, 2, 3), "diameter": 1.0}, "leave one out"),
    ("box", {"lengths": (1, 2, 3), "aspect": (1, 1, 1)}, "aspect and lengths are both given"),
    ("ellipsoid", {"semi_axes": (1, 2, 3), "diameter": 1.0}, "leave one out"),
    ("ellipsoid", {"semi_axes": (1, 2, 3), "aspect": (1, 0.8, 0.6)}, "aspect and semi_axes are both given"),
    ("cylinder", {"radius": 1.0}, "without height"),
    ("cylinder", {"radius": 1.0, "height": 2.0, "aspect": 1.0}, "aspect and radius are both given"),
    ("cone", {"radius": 1.0, "height": 2.0, "aspect": 1.0}, "aspect and radius are both given"),
    ("cone", {"aspect": -1.0}, "aspect is -1.0"),
    ("cone", {"diameter": -1.0}, "diameter is -1.0"),
    ("polygon", {"corners": 2}, "corners is 2"),
    ("polygon", {"vertices": [[0, 0], [1, 0]]}, "at least 3"),
    ("polygon", {"vertices": [[0, 0], [1, 0], [0, 1]], "diameter": 1.0}, "leave one out"),
    ("polygon", {"vertices": [[0, 0], [1, 0], [0, 1]], "corners": 6}, "corners and vertices are both given"),
    ("polygon", {"vertices": [[0, 0], [1, 0], [0, 1]], "stretch": 1.0}, "stretch and vertices are both given"),
    ("convex_polyhedron", {"points": 3}, "points is 3"),
    ("convex_polyhedron", {"aspect": (1, 1, 0)}, "aspect is 0"),
    ("polygon", {"corners": 10**9}, "corners is 1000000000: it must be at most 10000; give less"),
    ("convex_polyhedron", {"points": 10**9}, "points is 1000000000: it must be at most 100000"),
    ("convex_polyhedron", {"points": 1e300}, "points is 1.*: it must be at most 100000; give less"),
    ("polyhedron", {"points": 1e300}, "points is 1.*: it must be at most 100000; give less"),
    ("polyhedron", {"points": (4, 1e300)}, "points is 1.*: it must be at most 100000; give less"),
    ("solid_union", {"solids": 1e300}, "solids is 1.*: it must be at most 1000; give less"),
    ("solid_union", {"counts": (1e300, 0, 0, 0, 0)}, "counts is 1.*: it must be at most 1000; give less"),
    ("sierpinski_sponge", {"levels": 1e300}, "levels is 1.*: at most 256 cells.*take at most 4"),
    ("voronoi_fragment", {"cell": 1e300}, "cell is 1.*: it must be at most 63; give less"),
    ("sphere", {"diameter": 10**70}, "diameter is 1e.70: it must be between 1e-60 and 1e.60"),
    ("polygon", {"vertices": [[0, 0], [10**70, 0], [0, 1]]}, "vertices is 1e.70: it must be between 1e-60 and 1e.60"),
    ("solid_union", {"solids": 10**6}, "solids is 1000000: it must be at most 1000"),
    ("solid_union", {"solids": 0}, "solids is 0"),
    ("sierpinski_sponge", {"levels": 6}, "levels is 6 with divisions 3.*take at most 4"),
    ("sierpinski_sponge", {"kind": "menger", "divisions": 4, "hole": 3}, "hole is 3 with divisions 4.*take 2 to 2"),
    ("sierpinski_sponge", {"kind": "menger", "divisions": 2}, "hole is 2 with divisions 2.*divisions of at least 3"),
    ("sierpinski_sponge", {"kind": "menger", "removed": 7}, "removed is given: only kind 'random' takes it"),
    ("sierpinski_sponge", {"hole": 1}, "hole is given: cells are removed at random places"),
    ("sierpinski_sponge", {"removed": 7, "kept": 0.5}, "removed and kept are both given"),
    ("sierpinski_sponge", {"removed": 27}, "removed is 27: it must be at most 26"),
    ("sierpinski_sponge", {"diameter": 1.0, "edge": 1.0}, "diameter and edge are both given"),
    ("voxel_rain", {"cubes": -1}, "cubes is -1"),
    ("voxel_rain", {"width": (0, 4)}, "width is 0"),
    ("voxel_rain", {"plate": 0}, "plate is 0"),
    ("voxel_rain", {"deposition": "snow"}, "deposition is 'snow'"),
    ("voxel_rain", {"cubes": 4000, "width": (1024, 1024), "plate": 1024}, "at most 200000000 voxels are made"),
    ("random_growth", {"cubes": 0}, "cubes is 0"),
    ("random_growth", {"power": 5.0}, "power is 5.0"),
    ("random_growth", {"aspect": (1, 2, 3), "rates": (1, 1, 1)}, "rates and aspect are both given"),
    ("random_growth", {"aspect": (1, 1, 20)}, "largest to the smallest aspect is 20.0"),
    ("random_growth", {"aspect": (1, 4, 4), "cubes": 20}, "cubes is 20: too few for the aspect.*take at least 68"),
    ("cube_rain", {"cubes": 1001}, "cubes is 1001"),
    ("cube_rain", {"overlap": 0.0}, "overlap is 0.0"),
    ("cube_rain", {"edges": (1.0, 0.5)}, "edges is 1.0"),
    ("cube_rain", {"fall": "up"}, "fall is 'up'"),
    ("solid_union", {"solids": (4, 2)}, "solids is 2"),
    ("solid_union", {"kinds": []}, "kinds is empty"),
    ("solid_union", {"kinds": ["torus"]}, "torus"),
    ("solid_union", {"lengths": (0.01, 1.0)}, "lengths gives dimensions from 0.01 to 1.0: the smallest .* 0.02 of the"),
    ("solid_union", {"box": (1.0, (0.01, 0.5), 1.0)}, "box gives dimensions from 0.01 to 1.0"),
    ("solid_union", {"box": (1.0, 1.0)}, "list of 3"),
    ("solid_union", {"cone": ((0.5, 0.4), 1.0)}, "cone is 0.5: it must be .* at most 0.4"),
    ("solid_union", {"sphere": -1.0}, "sphere is -1.0"),
    ("solid_union", {"chord_error": 0.0}, "chord_error is 0.0: it must be finite and at least 1e-05"),
    ("solid_union", {"chord_error": 0.5}, "chord_error is 0.5: .* at most 0.1"),
    ("solid_union", {"counts": (1, 2)}, "counts has 2 entries and kinds has 5"),
    ("solid_union", {"counts": (0, 0, (0, 2), 0, 0)}, "counts may all be 0"),
    ("solid_union", {"counts": (600, 0, 500, 0, 0)}, "sum of counts is 1100: it must be at most 1000"),
    ("solid_union", {"counts": (1, 1, (2, 1), 0, 0)}, "counts is 1"),
    ("solid_union", {"lengths": (2.0, 1.0)}, "at most 1"),
    ("sphere_assembly", {"base": "disk"}, "base is 'disk', which is plane"),
    ("sphere_assembly", {"base": "sheet"}, "base is 'sheet': its surfaces are open"),
    ("sphere_assembly", {"base": make_shape("sheet")}, "open surface: base volumes need a solid"),
    ("sphere_assembly", {"base": "no_such"}, "shape family 'no_such' is unknown"),
    ("sphere_assembly", {"base": {"seed": 3}}, "base is a table without family"),
    ("spherical_harmonics", {"like": {"seed": 3}}, "like is a table without family"),
    ("sphere_assembly", {"base": {"family": "box", "length": 3}}, "did you mean 'lengths'"),
    ("sphere_assembly", {"base": 3}, "it must be text or Shape or a table"),
    ("sphere_assembly", {"probability": 0.0}, "probability is 0.0"),
    ("sphere_assembly", {"radii": (0.9, 0.6)}, "radii is 0.9: .* at most 0.6"),
    ("sphere_assembly", {"radii": 4.0}, "radii is 4.0: .* at most 3"),
    ("sphere_assembly", {"spacing": 0.01}, "spacing is 0.01"),
    ("sphere_assembly", {"spacing": 0.5, "base": {"family": "box", "aspect": (1, 1, 1e-4)}}, "too thin; try 0.25"),
    ("superspherize", {"base": "polygon"}, "base is 'polygon', which is plane"),
    ("superspherize", {"inflations": 0}, "inflations is 0"),
    ("superspherize", {"amounts": (0.5, 1.5)}, "amounts is 1.5"),
    ("superspherize", {"radii": (0.6, 0.5)}, "radii is 0.6: .* at most 0.5"),
    ("superspherize", {"half_angles": 181.0}, "half_angles is 181.0"),
    ("superspherize", {"longest_edge": 0.001}, "longest_edge is 0.001"),
    (
        "superspherize",
        {
            "base": {
                "family": "superspherize",
                "base": {
                    "family": "superspherize",
                    "base": {
                        "family": "superspherize",
                        "base": {"family": "superspherize", "base": {"family": "superspherize"}},
                    },
                },
            }
        },
        "inside of 4 others",
    ),
    ("sheet", {"lengths": (1, 1), "aspect": (2, 1)}, "aspect and lengths are both given"),
    ("sheet", {"lengths": (1, 1), "diameter": 1.0}, "leave one out"),
    ("sheet", {"roll": -30.0}, r"roll is -30.0: it must be finite and at least 0"),
    ("sheet", {"roll": 360.0}, "meets itself at 360; give less"),
    ("random_surface", {"max_frequency": 1e6}, "max_frequency is 1000000.0: .* at most 64"),
    ("random_surface", {"waves": 10**13}, "at most 10000; give less"),
    ("random_surface", {"waves": 10**30}, "at most 10000; give less"),
    ("random_surface", {"height": 1e9}, "at most 10"),
    ("rough_sheet", {"lengths": (1, 1), "diameter": 1.0}, "leave one out"),
    ("rough_sheet", {"method": "whitehouse", "hurst": 0.5}, "hurst is given and method is 'whitehouse'"),
    ("rough_sheet", {"rms": -0.1}, "rms is -0.1"),
    ("rough_sheet", {"correlation_length": (0.1, 0.2, 0.3)}, "the field has 2 axes"),
    ("crumpled", {"fold_length": 0.01}, "fold_length is 0.01: .* at least 0.1"),
    ("crumpled", {"angles": (90, 20)}, "angles is 20"),
    ("crumpled", {"angles": (20, 180)}, "folded through 180 degrees"),
    ("polyhedron", {"points": 3}, "points is 3"),
    ("polyhedron", {"points": (8, 10**6)}, "points is 1000000: it must be at most 100000"),
    ("polyhedron", {"solid": "snub_cube", "points": 8}, "which has its own corners; leave it out"),
    ("polyhedron", {"solid": "snub"}, "must be one of 'random', 'tetrahedron'"),
    ("polyhedron", {"rounding": -0.1}, "rounding is -0.1: .* at least 0"),
    ("polyhedron", {"tolerance": 0.0}, "tolerance is 0.0: .* at least 0.0001"),
    ("polyhedron", {"aspect": (1, 1, 0)}, "aspect is 0"),
    ("superquadric", {"e1": 0.0}, "e1 is 0.0: .* at least 0.02"),
    ("superquadric", {"e2": 5.0}, "e2 is 5.0: .* at most 4"),
    ("superquadric", {"semi_axes": (1, 1, 1), "aspect": (1, 1, 2)}, "aspect and semi_axes are both given"),
    ("spherocylinder", {"aspect": 0.9}, "aspect is 0.9: .* at least 1"),
    ("spherocylinder", {"radius": 1.0}, "without height"),
    ("spherocylinder", {"radius": 1.0, "height": 1.9}, "height is 1.9: the two ends alone have 2; give at least that"),
    ("torus", {"aspect": 1.0}, "aspect is 1.0: .* at most 0.999"),
    ("torus", {"minor_radius": 1.0}, "without major_radius"),
    ("ring", {"radius": 1.0, "height": 1.0}, "without hole_radius"),
    ("ring", {"bore": 0.5, "radius": 1.0, "height": 1.0, "hole_radius": 0.5}, "bore and radius are both given"),
    ("hollow_cylinder", {"holes": 4, "bore": 0.5}, "with 4 holes it must be at most 0.4101"),
    ("hollow_cylinder", {"radius": 2.0, "height": 1.0, "hole_radius": 1.0}, "hole_radius is 1: .* at most 0.8201"),
    ("tablet", {"aspect": 0.3, "cap": 0.2}, "cap is 0.2: .* at most 0.15"),
    ("tablet", {"radius": 1.0, "height": 4.0, "cap_height": 1.5}, "cap_height is 1.5: .* at most 1,"),
    ("torus", {"major_radius": 1.0, "minor_radius": 1.0}, "between 0.001 and 0.999 of the major radius 1"),
    ("voronoi_fragment", {"seeds": 1}, "seeds is 1"),
    ("voronoi_fragment", {"seeds": 50, "process": "jittered"}, "cubic lattice; give 64"),
    ("voronoi_fragment", {"cell": 64}, "cell is 64: it must be at most 63"),
    ("voronoi_fragment", {"lengths": (1, 1, 1), "aspect": (1, 1, 2)}, "aspect and lengths are both given"),
    ("mollon_zhao", {"d_8": 0.05}, "give d_8 of at most"),
    ("mollon_zhao", {"harmonics": 7}, "harmonics is 7"),
    ("mollon_zhao", {"subdivisions": 9}, "subdivisions is 9: it must be at most 7"),
    ("mollon_zhao_2d", {"d_2": 0.9}, "above 0.95 the radius may fall to 0"),
    ("mollon_zhao_2d", {"beta": 1.0}, "beta is 1.0: .* at most 0"),
]


@pytest.mark.parametrize(("family", "parameters", "message"), BAD)
def test_bad_parameters_are_refused(family, parameters, message):
    with pytest.raises(InputError, match=message):
        make_shape(family, **parameters)


def test_unknown_names_give_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'sphere'"):
        make_shape("spere")
    with pytest.raises(UnknownNameError, match="did you mean 'lengths'"):
        make_shape("box", length=(1, 1, 1))
    with pytest.raises(InputError, match="seed is -1"):
        make_shape("solid_union", seed=-1)


def test_many_shapes_have_seeds_of_their_own():
    shapes = make_shapes("convex_polyhedron", count=5, seed=3, points=(8, 20))
    seeds = seeds_of_shapes(3, 5)
    assert seeds_of_shapes(3, 3) == seeds[:3]
    assert len(set(seeds)) == len({shape.key for shape in shapes}) == 5
    assert make_shape("convex_polyhedron", seed=seeds[4], points=(8, 20)) == shapes[4]
    assert make_shapes("sphere", count=0) == []


def test_ranges_are_drawn_for_each_shape():
    corners = [len(shape.vertices) for shape in make_shapes("convex_polyhedron", count=60, points=[4, 6])]
    assert set(corners) == {4, 5, 6}
    lengths = [
        shape.geometry.dimensions for shape in make_shapes("box", count=40, lengths=(1, (2, 3), np.array([4, 5])))
    ]
    x, y, z = np.transpose(lengths)
    assert (x == 1).all()
    assert 2 <= y.min() < 2.2 < 2.8 < y.max() <= 3
    assert np.corrcoef(y, z)[0, 1] < 0.9
    by_object = make_shape(ConvexPolyhedron(points=(4, 300)), seed=2)
    assert by_object == make_shape("convex_polyhedron", points=(4, 300), seed=2)
    # a family that takes a range itself draws it with its own numbers
    assert make_shape("solid_union", solids=(2, 2), seed=1) == make_shape("solid_union", solids=[2, 2], seed=1)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"points": (20, 8)}, r"points is \(20, 8\): a range goes from the smaller to the larger number; swap them"),
        ({"points": (1, 3)}, "points is [123]: it must be a whole number, at least 4"),
        ({"points": (8, 9, 10)}, "it must be a whole number"),
        ({"points": (8.5, 9)}, "it must be a whole number"),
        ({"aspect": (1, 1, (2, 1))}, r"aspect is \(2, 1\): a range goes"),
    ],
)
def test_wrong_ranges_are_refused(parameters, message):
    with pytest.raises(InputError, match=message):
        make_shapes("convex_polyhedron", count=3, **parameters)
