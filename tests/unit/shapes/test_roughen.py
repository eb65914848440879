"""Rough skins: displacements, volumes and what is refused."""

import math

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, TooLargeError
from voxgran.geometry.crossing import count_crossings
from voxgran.shapes.finer import vertex_normals
from voxgran.shapes.roughness.roughen import diffused, largest_if_none, refined

METHODS = ["spectral", "patir", "whitehouse", "midpoint"]


def placed(shape):
    """Return the vertices in the coordinates that a shape was made from."""
    return shape.vertices + np.array(shape.offset)


@pytest.mark.parametrize("method", [slow(name) if name in ("midpoint", "patir") else name for name in METHODS])
def test_a_rough_sphere_is_displaced_along_its_radii(method):
    sphere = vg.make_shape("sphere", diameter=2.0)
    rough = vg.roughen(sphere, method=method, rms=0.05, seed=4)
    assert vg.diagnose(rough).ok
    vertices, faces = refined(sphere, rough.record["roughness_shortest"] / 4)
    assert (faces == rough.faces).all()
    heights = np.linalg.norm(placed(rough), axis=1) - 1.0
    # vertex normals of the mesh are radial but for its error
    assert placed(rough) / np.linalg.norm(placed(rough), axis=1, keepdims=True) == pytest.approx(vertices, abs=1e-3)
    areas = np.linalg.norm(np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2))), axis=1)
    weights = np.bincount(faces.ravel(), np.repeat(areas, 3)) / (3 * areas.sum())
    assert heights @ weights == pytest.approx(0.0, abs=1e-5)
    assert math.sqrt(heights**2 @ weights) == pytest.approx(0.05, rel=1e-4)
    assert rough.record["roughness_rms"] == pytest.approx(0.05, rel=1e-12)
    assert rough.record["roughness_skewness"] == pytest.approx(heights**3 @ weights / 0.05**3, abs=1e-3)
    found = vg.surface_statistics(rough, smooth=sphere)
    # peaks have more area on the rough surface than on the smooth one
    assert found.rms == pytest.approx(0.05, rel=0.05)
    assert found.kurtosis == pytest.approx(rough.record["roughness_kurtosis"], rel=0.1)
    assert found.correlation_length == pytest.approx(rough.record["roughness_correlation_length"], rel=0.15)


def test_roughness_vanishes_at_the_right_rate():
    sphere = vg.make_shape("sphere")
    volume = vg.roughen(sphere, rms=0.0).volume
    heights, changes = [], []
    for rms in (0.02, 0.01, 0.005):
        rough = vg.roughen(sphere, rms=rms, seed=2)
        heights.append(np.abs(np.linalg.norm(placed(rough), axis=1) - 0.5).max())
        changes.append(rough.volume / volume - 1.0)
    assert np.divide(heights[:-1], heights[1:]) == pytest.approx(2.0, rel=1e-3)
    # the volume is of second order
    assert np.divide(changes[:-1], changes[1:]) == pytest.approx(4.0, rel=0.1)


@pytest.mark.slow
def test_volume_of_a_rough_sphere():
    """The mean volume is 4/3 pi R^3 (1 + 3 s^2 / R^2). Heights of mean 0 and given variance meet it one by one but for
    their third moment, and meshes with the square of their edges, in correlation lengths.
    """
    sphere, errors = vg.make_shape("sphere"), []
    smooth = vg.roughen(sphere, rms=0.0, shortest=0.2)
    sides = [np.roll(smooth.vertices[smooth.faces], 1, axis=1) - smooth.vertices[smooth.faces]]
    square = (np.linalg.norm(sides[0], axis=2) ** 2).mean()
    ratio = 0.02 / 0.5
    for length in (0.6, 0.3, 0.15):
        kinds = {"method": "patir", "autocorrelation": "gaussian", "correlation_length": length, "shortest": 0.2}
        found = []
        for seed in range(3):
            rough = vg.roughen(sphere, rms=0.02, seed=seed, **kinds)
            third = rough.record["roughness_skewness"] * ratio**3
            found.append((rough.volume / smooth.volume - 1.0 - third) / (3 * ratio**2) - 1.0)
        # products of heights at the ends of edges are smaller than squares by the autocorrelation
        errors.append(np.mean(found) / (math.exp(-square / length**2) - 1.0))
    assert errors[2] == pytest.approx(1.0, abs=0.2)
    assert errors[1] == pytest.approx(1.0, abs=0.4)


@pytest.mark.parametrize("family", ["box", "cylinder", "convex_polyhedron", "solid_union"])
def test_edges_do_not_make_a_skin_meet_itself(family):
    shape = vg.make_shape(family, seed=1)
    rough = vg.roughen(shape, seed=1)
    assert vg.diagnose(rough).ok
    assert rough.record["roughness_rms"] == pytest.approx(0.02, rel=1e-9)
    assert rough.volume == pytest.approx(shape.volume, rel=0.02)
    assert rough.name == family
    assert not rough.is_open


def test_too_great_heights_are_refused_with_those_that_do():
    box, rest = vg.make_shape("box"), {"seed": 3, "shortest": 0.4, "correlation_length": 0.3}
    with pytest.raises(InputError, match="cuts through itself; give at most ") as caught:
        vg.roughen(box, rms=0.5, **rest)
    most = float(str(caught.value).rsplit(" ", 1)[1])
    assert 0.01 < most < 0.5
    assert vg.diagnose(vg.roughen(box, rms=most, **rest)).ok
    with pytest.raises(InputError, match="cuts through itself"):
        vg.roughen(box, rms=1.3 * most, **rest)


@pytest.mark.parametrize("family", ["sphere", "disk"])
def test_heights_larger_than_the_solid_are_refused_before_the_work(family, monkeypatch):
    """The largest ones that do not cut the surface would be searched for many seconds."""
    monkeypatch.setattr("voxgran.shapes.roughness.roughen.random_heights", None)
    with pytest.raises(InputError, match=r"rms is 1e\+09: with heights larger than the solid, whose"):
        vg.roughen(vg.make_shape(family), rms=1e9)


def test_normals_diffuse_along_the_surface():
    box = vg.make_shape("box")
    vertices, faces = refined(box, 0.05)
    normals = vertex_normals(vertices, faces)
    smooth = diffused(normals, vertices, faces, 0.1)
    assert np.linalg.norm(smooth, axis=1) == pytest.approx(1.0)
    half = vertices.max()
    # at the middle of a face as before, within an edge more gradual
    middle = np.abs(vertices / half).max(axis=1) - np.sort(np.abs(vertices / half), axis=1)[:, 1] > 0.8
    assert (smooth[middle] * normals[middle]).sum(axis=1).min() > 0.995
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    turn = [np.linalg.norm(n[ends[:, 0]] - n[ends[:, 1]], axis=1).max() for n in (normals, smooth)]
    assert turn[1] < 0.6 * turn[0]
    # on a sphere normals stay
    vertices, faces = vg.make_shape("sphere").vertices, vg.make_shape("sphere").faces
    assert diffused(2 * vertices, vertices, faces, 0.2) == pytest.approx(2 * vertices, abs=0.01)


def test_open_surfaces_and_outlines():
    shell = vg.make_shape("shell")
    rough = vg.roughen(shell, rms=0.01, seed=1)
    assert rough.is_open
    assert count_crossings(rough.vertices, rough.faces) == 0
    disk = vg.make_shape("disk", diameter=4.0)
    rough = vg.roughen(disk, rms=0.05, shortest=0.2, seed=1)
    heights = np.linalg.norm(rough.geometry.vertices + np.array(rough.offset[:2]), axis=1) - 2.0
    assert math.sqrt((heights**2).mean()) == pytest.approx(0.05, rel=1e-3)
    # in the plane the area is pi R^2 (1 + s^2 / R^2)
    assert rough.volume == pytest.approx(disk.volume * (1 + (0.05 / 2) ** 2), rel=6e-4)
    square = vg.make_shape("polygon", corners=4)
    assert vg.roughen(square, rms=0.01, seed=2).volume == pytest.approx(square.volume, rel=0.02)


def test_a_skin_is_repeatable_and_keeps_place_unit_and_record():
    sphere = vg.Shape.of(vg.make_shape("sphere").geometry, name="pearl", unit="mm", record={"found": "Bahrain"})
    moved = vg.Shape(sphere.geometry, "pearl", (5.0, 0.0, 0.0), "mm", record=sphere.record)
    rough = vg.roughen(moved, seed=7)
    assert (rough.unit, rough.name, rough.record["found"]) == ("mm", "pearl", "Bahrain")
    assert np.linalg.norm(np.array(rough.offset) - [5.0, 0.0, 0.0]) < 0.02
    assert rough == vg.roughen(moved, seed=7)
    assert rough != vg.roughen(moved, seed=8)
    assert vg.roughen(moved, rms=0).volume == pytest.approx(len(rough.faces) and moved.volume, rel=0.01)


@pytest.mark.parametrize(
    ("keywords", "error", "message"),
    [
        ({"shortest": 0.001}, TooLargeError, "at most 400000 are made; give at least 0.01"),
        ({"shortest": 5.0}, InputError, "the correlation length is 0.25: .* give less than 0.5"),
        ({"rms": -1.0}, InputError, "rms is -1.0"),
        ({"hurst": 0.5, "method": "patir"}, InputError, "it is a parameter of spectral and midpoint; leave it out"),
        ({"skewness": 0.5, "method": "midpoint"}, InputError, "skewness is given and method is 'midpoint'"),
        ({"correlation_length": (0.1, 0.2)}, InputError, "the field has 3 axes; give one length, or 3"),
        ({"method": "perlin"}, InputError, "it must be one of 'spectral', 'patir'"),
        ({"hurst": 1.5}, InputError, "hurst is 1.5"),
    ],
)
def test_bad_parameters_are_refused(keywords, error, message):
    with pytest.raises(error, match=message):
        vg.roughen(vg.make_shape("sphere"), **keywords)


def test_a_solid_has_no_heights_of_its_own():
    with pytest.raises(InputError, match="give it as smooth="):
        vg.surface_statistics(vg.make_shape("box"))


def test_far_too_fine_fields_are_refused():
    outline = vg.make_shape("disk")
    with pytest.raises(TooLargeError, match="corners, at most 5000 are made; give at least"):
        vg.roughen(outline, shortest=1e-4)
    with pytest.raises(TooLargeError, match=r"the random field would need .* points"):
        vg.roughen(vg.make_shape("box", aspect=(1, 1, 1)), method="patir", shortest=0.02, correlation_length=3.0)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["sphere", "box", "solid_union"])
def test_many_rough_grains_are_one_clean_solid(family):
    refused = 0
    for seed in range(100):
        smooth, given = vg.make_shape(family, seed=seed), {"method": METHODS[seed % 4], "seed": seed}
        try:
            rough = vg.roughen(smooth, rms=0.01, **given)
        except InputError as error:  # narrow gaps of a union allow lower heights only
            refused += 1
            rough = vg.roughen(smooth, rms=float(str(error).rsplit(" ", 1)[1]), **given)
        assert vg.diagnose(rough).ok, seed
    assert refused <= (15 if family == "solid_union" else 0)


@pytest.mark.slow
@pytest.mark.parametrize("spacing", [slow(0.15), 0.3])
def test_an_assembly_of_spheres_takes_a_skin(spacing):
    """Its necks are narrower than the triangles: points that are put on the spheres would pass each other."""
    clump = vg.make_shape("sphere_assembly", spacing=spacing)
    rough = vg.roughen(clump, rms=3e-4, seed=1)
    assert count_crossings(rough.vertices, rough.faces) == 0
    assert rough.record["roughness_rms"] == pytest.approx(3e-4)
    assert rough.volume == pytest.approx(clump.volume, rel=0.03)


def test_a_surface_that_touches_itself_is_refused_without_a_search():
    counted = []

    def never(factor):
        counted.append(factor)

    with pytest.raises(InputError, match=r"however small the heights are, .* take another shape, or repair it"):
        largest_if_none(0.1, never, least=1e-5)
    assert len(counted) == 2
    with pytest.raises(InputError, match="however small the heights are"):
        vg.roughen(vg.make_shape("voxel_rain", cubes=50, width=(4, 4)), rms=0.01)


# heights above the radius are refused before any surface is made
@pytest.mark.parametrize("rms", [0.3, slow(0.45)])
def test_the_height_that_is_proposed_can_be_made(rms):
    sphere = vg.make_shape("sphere")
    with pytest.raises(InputError, match="give at most") as caught:
        vg.roughen(sphere, rms=rms)
    proposed = float(str(caught.value).rsplit(" ", 1)[1])
    assert 0.05 < proposed < 0.3
    assert vg.roughen(sphere, rms=proposed).record["roughness_rms"] == pytest.approx(proposed)
