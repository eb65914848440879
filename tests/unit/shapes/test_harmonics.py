"""Grains from spherical harmonics: spectra, siblings of a scan, Gaussian random spheres."""

import math
from pathlib import Path

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError
from voxgran._base.seeds import stream
from voxgran.shapes.families.random.noise_star import variances_of
from voxgran.shapes.families.random.spherical_harmonics import SphericalHarmonics, power_law, spectrum_of
from voxgran.shapes.generating.radii import radii_of
from voxgran.shapes.generating.spherical_fields import (
    coefficients_of,
    coefficients_of_powers,
    field_values,
    harmonics,
    powers_of,
    random_coefficients,
    sphere_quadrature,
)
from voxgran.shapes.repairing.diagnose import refuse_dirty
from voxgran.shapes.tessellate import sphere

EROS = str(Path(__file__).parents[3] / "data" / "eros.obj")


def test_quadrature_gives_back_the_coefficients_of_a_field():
    cosines, sines = coefficients_of_powers(np.array([1.0, 0.0, 0.1, 0.02, 0.3]), stream(2, "field"))
    directions, weights = sphere_quadrature(5)
    assert weights.sum() == pytest.approx(1.0)
    values = field_values(cosines, sines, directions)
    for found, given in zip(coefficients_of(5, directions, weights, values), (cosines, sines), strict=True):
        assert found == pytest.approx(given, abs=1e-14)
    # the powers of the degrees are the parts of the mean square
    assert weights @ values**2 == pytest.approx(1.42)


def test_radii_of_solids():
    directions = sphere_quadrature(12)[0]
    box, hidden = radii_of(vg.make_shape("box", lengths=(2, 4, 6)), directions)
    assert box == pytest.approx(
        np.nanmin(np.array([1, 2, 3]) / np.maximum(np.abs(directions), 1e-300), axis=1), rel=1e-12
    )
    assert hidden == 0.0
    assert radii_of(vg.make_shape("sphere", radius=2.0), directions)[0] == pytest.approx(np.full(len(directions), 2.0))


def test_rays_that_leave_a_solid_more_than_once_end_at_the_last_place():
    from voxgran.shapes.boolean import united
    from voxgran.shapes.tessellate import unit_box

    vertices, faces, _ = unit_box()
    # a cube, a bar from it, and a plate at the end of the bar
    parts = [(2, 2, 2, 0), (1, 0.2, 0.2, 1.4), (0.5, 3, 3, 2.1)]
    bodies = [(vertices * size + np.array([at, 0, 0]), faces) for *size, at in parts]
    solid = vg.Shape.from_mesh(*united(bodies))
    center = solid.offset[0]
    assert 0 < center < 1
    through_the_gap = np.array([2.35 - center, 1.0, 0.3])
    radii, hidden = radii_of(
        solid, np.array([[0.0, 0.0, 1.0], through_the_gap / np.linalg.norm(through_the_gap), [-1.0, 0.0, 0.0]])
    )
    assert hidden == pytest.approx(1 / 3)
    assert radii == pytest.approx([1.0, np.linalg.norm(through_the_gap), 1.0 + center])


@pytest.mark.parametrize("degree", [4, 16])
def test_grains_of_a_power_law_have_its_powers_exactly(degree):
    wanted = power_law(SphericalHarmonics(degree=degree, roughness=0.1, exponent=2.0))
    assert math.sqrt(wanted[1:].sum()) == pytest.approx(0.1)
    assert wanted[4] / wanted[2] == pytest.approx(2.0**-2)
    found = powers_of(*coefficients_of_powers(wanted, stream(1, "powers")))
    assert found == pytest.approx(wanted, abs=1e-15)
    shape = vg.make_shape("spherical_harmonics", degree=degree, roughness=0.1, exponent=2.0, seed=3)
    assert shape.record["powers"] == pytest.approx(wanted)
    refuse_dirty(shape.vertices, shape.faces, "grain")


def test_directions_of_the_coefficients_are_uniform():
    generator = stream(5, "directions")
    drawn = [coefficients_of_powers(np.array([0.0, 0.0, 0.2]), generator) for _ in range(3000)]
    rows = np.array([[*cosines[2, :3], *sines[2, 1:3]] for cosines, sines in drawn])
    assert (rows**2).sum(axis=1) == pytest.approx(np.ones(3000))
    error = np.sqrt(1 / 5 * (1 - 1 / 5) / 3000)
    assert np.abs((rows**2).mean(axis=0) - 1 / 5).max() < 4 * error
    assert np.abs(rows.mean(axis=0)).max() < 4 / math.sqrt(5 * 3000)


def test_expansion_of_an_ellipsoid_converges():
    shape = vg.make_shape("ellipsoid", semi_axes=(1.0, 1.2, 1.5))
    directions, weights = sphere_quadrature(60)
    radii = radii_of(shape, directions)[0]
    exact = 1 / np.sqrt(((directions / [1.0, 1.2, 1.5]) ** 2).sum(axis=1))
    assert radii == pytest.approx(exact, rel=3e-3)
    errors = []
    for degrees in (3, 5, 9, 13):
        field = field_values(*coefficients_of(degrees, directions, weights, exact), directions)
        errors.append(float(np.sqrt(weights @ (field - exact) ** 2)))
    assert (np.diff(np.log(errors)) < -1.0).all()
    assert errors[-1] < 1e-5
    # its volume is the mean of r^3 over directions
    assert 4 / 3 * math.pi * (weights @ field**3) == pytest.approx(shape.volume, rel=1e-5)


def test_siblings_of_a_scan_have_its_powers():
    scan = vg.load_shape(EROS)
    powers, hidden = spectrum_of(scan, 12)
    assert hidden < 0.01
    siblings = vg.make_shapes("spherical_harmonics", like=scan, degree=12, count=3, seed=1, subdivisions=5)
    assert len({one.key for one in siblings}) == 3
    for one in siblings:
        assert one.record["powers"] == pytest.approx(powers)
        assert one.diameter == pytest.approx(1.0)
        refuse_dirty(one.vertices, one.faces, "sibling")
        # measured from its vertices about the origin of the harmonics, which is not the centroid
        rays = one.vertices + np.array(one.offset)
        radius = np.linalg.norm(rays, axis=1)
        parts = list(harmonics(13, rays / radius[:, None]))
        basis = np.column_stack([part for _, _, cosine, sine in parts for part in (cosine, sine)])
        solved = np.linalg.lstsq(basis, np.log(radius), rcond=None)[0].reshape(-1, 2)
        found = np.zeros(13)
        for (degree, _, _, _), pair in zip(parts, solved, strict=True):
            found[degree] += (pair**2).sum() / (2 * degree + 1)
        assert found[1:] == pytest.approx(powers[1:], rel=1e-8)
    assert vg.make_shape("spherical_harmonics", like=EROS, seed=4) == vg.make_shape(
        "spherical_harmonics", like=scan, seed=4
    )


def test_a_high_degree_gives_back_the_volume_of_a_scan():
    scan = vg.load_shape(EROS)
    directions, weights = sphere_quadrature(64)
    radii = radii_of(scan, directions)[0]
    assert 4 / 3 * math.pi * (weights @ radii**3) == pytest.approx(scan.volume, rel=2e-3)
    errors = []
    for degrees in (5, 11, 21):
        field = field_values(*coefficients_of(degrees, directions, weights, radii), directions)
        errors.append(float(np.sqrt(weights @ (field - radii) ** 2) / radii.mean()))
    assert errors[0] > 2 * errors[1] > 3 * errors[2]
    assert errors[2] < 0.015


@pytest.mark.slow
def test_gaussian_spheres_are_log_normal():
    # means over grains and directions that are far from each other
    directions = sphere(1)[0]
    variances = variances_of(0.3, 40.0)
    assert variances.sum() == pytest.approx(math.log(1.09), rel=1e-5)
    generator = stream(3, "stars")
    drawn = [random_coefficients(variances, generator) for _ in range(4000)]
    fields = np.array([field_values(*coefficients, directions) for coefficients in drawn])
    length = 2 * math.sin(math.radians(20))
    cosines = directions @ directions.T
    expected = math.log(1.09) * np.exp(-(1 - cosines) / length**2)
    # of normal fields the covariance has the standard error sqrt((v^2 + c^2) / n)
    error = np.sqrt((math.log(1.09) ** 2 + expected**2) / len(fields))
    assert np.abs(fields.T @ fields / len(fields) - expected).max() < 5 * error.max()
    radius = np.exp(fields)
    mean, spread = radius.mean(), radius.std()
    assert spread / mean == pytest.approx(0.3, rel=0.03)
    # the mean volume over that of a sphere of radius exp(0): E r^3 = exp(9 s^2 / 2)
    volume = (radius**3).mean(axis=1)
    assert volume.mean() == pytest.approx(math.exp(4.5 * math.log(1.09)), abs=4 * volume.std() / math.sqrt(len(volume)))


@pytest.mark.parametrize("family", ["spherical_harmonics", "noise_star"])
def test_grains_are_one_clean_solid(family):
    for seed in range(10):
        shape = vg.make_shape(family, seed=seed, subdivisions=3)
        refuse_dirty(shape.vertices, shape.faces, f"seed {seed}")
    # small amplitudes come to a sphere, whose facets lack a part of the area
    name = "roughness" if family == "spherical_harmonics" else "deviation"
    assert vg.describe(vg.make_shape(family, **{name: 0.0}), "sphericity").sphericity.item() == pytest.approx(
        1, abs=2e-3
    )


@pytest.mark.slow
@pytest.mark.parametrize("family", ["spherical_harmonics", "noise_star"])
def test_a_thousand_grains_are_one_clean_solid(family):
    for seed in range(1000):
        shape = vg.make_shape(family, seed=seed)
        refuse_dirty(shape.vertices, shape.faces, f"seed {seed}")


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"like": "torus"}, "like is 'torus', which only .* of the rays from its centroid meet"),
        ({"like": "box", "roughness": 0.1}, "like and roughness are both given"),
        ({"like": "box", "exponent": 1.0}, "like and exponent are both given"),
        ({"like": "sheet"}, "surfaces are open"),
        ({"degree": 1}, "degree is 1"),
        ({"roughness": 1.5}, "roughness is 1.5"),
    ],
)
def test_bad_parameters_are_refused(parameters, message):
    with pytest.raises(InputError, match=message):
        vg.make_shape("spherical_harmonics", **parameters)


def test_a_wrong_name_is_explained():
    with pytest.raises(UnknownNameError, match="did you mean 'ellipsoid'"):
        vg.make_shape("spherical_harmonics", like="elipsoid")
