"""Unions of base solids: facets, volumes, orientations, counts."""

import math

import numpy as np
import pytest
from scipy import stats

from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.shapes.families.random.solid_union import (
    CORE,
    BaseSolid,
    SolidUnion,
    base_solids,
    faceted,
    frequency_for,
    sides_for,
    union_of,
)
from voxgran.shapes.family import make_shape
from voxgran.shapes.generating.star import is_star_shaped
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.repairing.diagnose import diagnose
from voxgran.shapes.tessellate import geodesic, sphere, unit_box

KINDS = ("box", "cylinder", "cone", "ellipsoid", "sphere")
ROUND = [
    Primitive("sphere", (0.7,)),
    Primitive("ellipsoid", (0.3, 1.1, 0.6), (0.5, 0.5, -0.5, 0.5)),
    Primitive("cylinder", (0.4, 1.3)),
    Primitive("cone", (0.4, 0.8), (0.8, 0.0, 0.6, 0.0)),
]


def difference_of_polygon(sides):
    """Area between a circle and the regular polygon of equal area, relative to it: the segments outside, twice."""
    out = math.sqrt(2 * math.pi / (sides * math.sin(2 * math.pi / sides)))
    near = out * math.cos(math.pi / sides)
    return 2 * sides * (math.acos(near) - near * math.sqrt(1 - near * near)) / math.pi


def difference_of_polyhedron(frequency):
    """Upper bound of the volume between a sphere and the geodesic polyhedron of equal volume: its caps, twice."""
    mesh = Mesh(*geodesic(frequency))
    scale = math.cbrt(4 / 3 * math.pi / mesh.volume)
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    depth = 1 - scale * np.einsum("fi,fi->f", normals, a) / np.linalg.norm(normals, axis=1)
    return 2 * (math.pi / 3 * depth**2 * (3 - depth)).sum() / (4 / 3 * math.pi)


def volume_between(one, two):
    """Volume of the points that lie inside exactly one of two meshes."""
    library = load("manifold3d")
    a, b = (
        library.Manifold(library.Mesh64(np.array(vertices), np.array(faces, dtype=np.uint64)))
        for vertices, faces in (one, two)
    )
    return (a - b).volume() + (b - a).volume()


def random_points(low, high, count, seed):
    return low + (high - low) * stream(seed, "points").random((count, 3))


def inside(solids, points):
    return np.any([base.solid.contains(points - base.position) for base in solids], axis=0)


def test_numbers_of_facets_follow_from_the_error():
    for error in np.geomspace(1e-5, 0.1, 60):
        assert difference_of_polygon(sides_for(error)) <= error
        assert sides_for(error) < 6 or difference_of_polygon(sides_for(error) - 1) > 0.97 * error
    for error in np.geomspace(4e-4, 0.1, 20):
        assert difference_of_polyhedron(frequency_for(error)) <= error
    assert 20 * frequency_for(2e-3) ** 2 == 1280
    assert sides_for(2e-3) == 36


@pytest.mark.parametrize("frequency", [1, 2, 3, 7, 10])
def test_geodesic_polyhedra_are_closed_and_converge_to_the_sphere(frequency):
    vertices, faces = geodesic(frequency)
    assert len(vertices) == 10 * frequency**2 + 2
    assert len(faces) == 20 * frequency**2
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(np.ones(len(vertices)), abs=1e-15)
    assert is_star_shaped(vertices, faces, np.zeros(3))
    # area of a face: a regular one lacks 10.88 / number of faces
    assert 1 - Mesh(vertices, faces).volume / (4 / 3 * math.pi) == pytest.approx(
        10.9 / len(faces), rel=0.28 / frequency
    )


@pytest.mark.parametrize("solid", ROUND, ids=lambda solid: solid.kind)
@pytest.mark.parametrize("error", [0.1, 0.02, 2e-3])
def test_facets_keep_volume_and_centroid_and_stay_within_the_error(solid, error):
    vertices, faces = faceted(solid, error)
    mesh = Mesh(vertices, faces)
    assert mesh.volume == pytest.approx(solid.volume, rel=1e-13)
    assert mesh.centroid == pytest.approx(np.zeros(3), abs=1e-14)
    assert diagnose(vertices, faces).ok
    fine = faceted(solid, 1e-4 if error < 0.01 else error / 20)
    between = volume_between(fine, (vertices, faces))
    assert 0.25 * error * solid.volume < between < 1.06 * error * solid.volume


@pytest.mark.parametrize("kind", KINDS)
def test_base_solids_hold_a_sphere_around_the_origin(kind):
    thin = {"box": ((0.1, 1.0),) * 3, "ellipsoid": (0.05, (0.5, 1.0), 1.0), "cone": ((0.1, 2.0), (0.2, 1.0))}
    for number in range(30):
        parameters = SolidUnion(kinds=(kind,), solids=1, **{key: value for key, value in thin.items() if key == kind})
        (base,) = base_solids(parameters, stream(number, kind))
        triangles = Mesh(*faceted(base.solid, 1e-3)).triangles + base.position
        a, b, c = np.moveaxis(triangles, 1, 0)
        normals = np.cross(b - a, c - a)
        depth = (np.einsum("fi,fi->f", normals, a) / np.linalg.norm(normals, axis=1)).min()
        d = base.solid.dimensions
        inscribed = {
            "box": min(d) / 2,
            "cylinder": min(d[0], d[-1] / 2),
            "cone": d[0] * d[-1] / (d[0] + math.hypot(d[0], d[-1])),
            "ellipsoid": min(d),
            "sphere": d[0],
        }[kind]
        assert depth > 0.99 * CORE * inscribed


def test_origins_are_uniform_in_the_shrunk_solid():
    """The second moments of the shifts of a solid of given size are those of the solid, times (1 - CORE)**2."""
    for kind in KINDS:
        parameters = SolidUnion(kinds=(kind,), lengths=(1.0, 1.0), solids=1000)
        solids = base_solids(parameters, stream(3, kind))
        points = np.array([-base.solid.matrix.T @ base.position for base in solids])
        solid = solids[0].solid
        moment = np.trace(solid.inertia) / 2 / solid.volume
        spread = ((points - points.mean(axis=0)) ** 2).sum(axis=1)
        assert spread.mean() == pytest.approx((1 - CORE) ** 2 * moment, abs=4 * spread.std() / math.sqrt(len(spread)))


def test_work_planes_are_uniform_on_the_sphere():
    solids = base_solids(SolidUnion(solids=1000), stream(5, "planes"))
    normals = np.array([base.solid.matrix[:, 2] for base in solids])
    sides = np.array([base.solid.matrix[:, 0] for base in solids])
    for axis in range(3):
        assert stats.kstest(normals[:, axis], stats.uniform(-1, 2).cdf).pvalue > 0.001
        assert stats.kstest(sides[:, axis], stats.uniform(-1, 2).cdf).pvalue > 0.001
    assert stats.kstest(np.arctan2(normals[:, 1], normals[:, 0]), stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > 0.001


def test_volume_of_unions_is_that_of_the_true_solids():
    """Monte Carlo with the closed forms of the base solids, which know nothing of facets and Boolean operations."""
    for seed in range(4):
        solids = base_solids(SolidUnion(), stream(seed, "unions"))
        mesh = Mesh(*union_of(solids, 2e-3))
        low, high = mesh.vertices.min(axis=0) - 0.01, mesh.vertices.max(axis=0) + 0.01
        found = inside(solids, random_points(low, high, 100_000, seed))
        share, box = found.mean(), float(np.prod(high - low))
        error = box * math.sqrt(share * (1 - share) / len(found))
        assert mesh.volume == pytest.approx(box * share, abs=4 * error)


def test_error_of_unions_is_below_the_chord_error():
    errors = []
    for seed in range(6):
        solids = base_solids(SolidUnion(), stream(seed, "unions"))
        fine, coarse = (union_of(solids, error) for error in (1e-3, 1e-2))
        errors.append(Mesh(*coarse).volume / Mesh(*fine).volume - 1)
        assert volume_between(fine, coarse) < 1.1e-2 * Mesh(*fine).volume
    # the two sides cancel: the volume is far better than the error
    assert np.abs(errors).max() < 1e-3


def test_small_solids_have_fewer_facets():
    large, small = (BaseSolid(Primitive("sphere", (radius,)), np.zeros(3)) for radius in (1.0, 0.5))
    apart = BaseSolid(small.solid, np.array([1.0, 0.0, 0.0]))
    alone = len(union_of([large], 2e-3)[1])
    assert len(union_of([small], 2e-3)[1]) == alone == 1280
    assert len(union_of([large, apart], 2e-3)[1]) < 1.5 * alone


def test_counts_of_each_kind():
    parameters = SolidUnion(kinds=("box", "sphere", "cone"), counts=(2, (0, 3), 1))
    seen = set()
    for seed in range(40):
        kinds = [base.solid.kind for base in base_solids(parameters, stream(seed, "counts"))]
        assert (kinds.count("box"), kinds.count("cone")) == (2, 1)
        seen.add(kinds.count("sphere"))
    assert seen == {0, 1, 2, 3}
    number = [len(base_solids(SolidUnion(solids=(2, 4)), stream(seed, "number"))) for seed in range(60)]
    assert set(number) == {2, 3, 4}
    kinds = [base.solid.kind for base in base_solids(SolidUnion(solids=1000), stream(0, "kinds"))]
    assert stats.chisquare([kinds.count(kind) for kind in KINDS]).pvalue > 0.001


def test_ranges_of_each_kind():
    parameters = SolidUnion(
        solids=500,
        lengths=(0.9, 1.0),
        box=(0.5, (0.6, 0.7), (0.8, 0.9)),
        cylinder=(0.4, (1.2, 1.4)),
        cone=((0.2, 0.3), 0.9),
        sphere=(0.1, 0.3),
    )
    found = {kind: [] for kind in KINDS}
    for base in base_solids(parameters, stream(1, "ranges")):
        found[base.solid.kind].append(base.solid.dimensions)
    expected = {
        "box": [(0.5, 0.5), (0.6, 0.7), (0.8, 0.9)],
        "cylinder": [(0.2, 0.2), (1.2, 1.4)],
        "cone": [(0.1, 0.15), (0.9, 0.9)],
        "ellipsoid": [(0.45, 0.5)] * 3,
        "sphere": [(0.05, 0.15)],
    }
    for kind, ranges in expected.items():
        for values, (low, high) in zip(np.transpose(found[kind]), ranges, strict=True):
            assert low - 1e-15 <= values.min() <= low + 0.1 * (high - low) + 1e-15
            assert high - 0.1 * (high - low) - 1e-15 <= values.max() <= high + 1e-15


def test_ranges_and_counts_by_the_public_call():
    shape = make_shape("solid_union", kinds=["box"], counts=[1], box=(1.0, 1.0, 2.0), seed=4)
    assert len(shape.faces) == 12
    assert shape.record["kinds"] == ("box",)
    assert np.ptp(np.sort(np.linalg.eigvalsh(shape.inertia))[1:]) < 1e-12
    assert make_shape("solid_union", sphere=(0.5, 0.6), kinds=["sphere"], seed=3) == make_shape(
        "solid_union", lengths=(0.5, 0.6), kinds=["sphere"], seed=3
    )


def test_unions_are_one_clean_solid():
    for seed in range(20):
        shape = make_shape("solid_union", seed=seed, solids=5)
        found = diagnose(shape)
        assert found.ok, (seed, found.sentences())
        assert found.cavities == 0
        assert found.bodies == 1
        assert len(shape.faces) <= 5000


@pytest.mark.slow
def test_many_unions_are_one_clean_solid():
    for seed in range(1000):
        shape = make_shape("solid_union", seed=seed)
        found = diagnose(shape)
        assert found.ok, (seed, found.sentences())
        assert found.bodies == 1
        assert found.cavities == 0
        assert np.isfinite(shape.vertices).all()


def test_union_of_one_box_is_a_box():
    shape = make_shape("solid_union", seed=2, solids=1, kinds=["box"])
    assert len(shape.faces) == 12
    assert len(make_shape("solid_union", seed=2, solids=[2, 2], kinds=["sphere", "cone"]).faces) > 100


def test_star_shapes_are_known():
    vertices, faces, _ = sphere(2)
    assert is_star_shaped(vertices, faces, np.zeros(3))
    assert is_star_shaped(vertices, faces, np.array([0.9, 0.0, 0.0]))
    assert not is_star_shaped(vertices, faces, np.array([1.1, 0.0, 0.0]))
    assert not is_star_shaped(vertices, faces[:, ::-1], np.zeros(3))
    assert not is_star_shaped(vertices, faces[1:], np.zeros(3))
    twice = np.concatenate([faces, faces + len(vertices)])
    assert not is_star_shaped(np.concatenate([vertices, 2 * vertices]), twice, np.zeros(3))
    assert not is_star_shaped(vertices, np.concatenate([faces, faces]), np.zeros(3))
    box, sides, _ = unit_box()
    assert is_star_shaped(box, sides, np.zeros(3))
    # a dent that the center does not see
    dented = vertices.copy()
    dented[vertices[:, 2] > 0.99] *= -0.5
    assert not is_star_shaped(dented, faces, np.zeros(3))


def test_counts_must_fit():
    with pytest.raises(InputError, match="counts and solids are both given"):
        make_shape("solid_union", solids=4, counts=[1] * 5)
