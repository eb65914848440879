"""Distributions of orientations, against closed forms, published relations and SciPy."""

import math

import numpy as np
import pytest
from scipy import integrate, special, stats

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError
from voxgran._base.seeds import stream
from voxgran.geometry.orientation_laws.directional import bingham_moments
from voxgran.geometry.orientation_laws.fibres import squares_of, variances_of
from voxgran.geometry.rotation import random_rotations, rotation_matrices, rotations_between

MANY = 40_000
WAY = (1.0, -2.0, 0.5)
ROUGH = [[0.5, 0.1, 0.05], [0.1, 0.3, -0.1], [0.05, -0.1, 0.2]]
LAWS = {
    "random": vg.orientations.random(),
    "aligned": vg.orientations.aligned(WAY),
    "fisher, weak": vg.orientations.fisher(WAY, 1e-3),
    "fisher": vg.orientations.fisher(WAY, 3.0),
    "fisher, strong": vg.orientations.fisher("-z", 1e9),
    "watson": vg.orientations.watson(WAY, 4.0),
    "watson, strong": vg.orientations.watson("y", 1e9),
    "girdle": vg.orientations.watson(WAY, -8.0),
    "thin girdle": vg.orientations.watson("x", -1e9),
    "bingham": vg.orientations.bingham((1, 1, 0), 5.0, (1, -1, 0), second_kappa=-3.0),
    "tensor": vg.orientations.tensor(ROUGH),
    "tensor of a plane": vg.orientations.tensor([[0.7, 0, 0], [0, 0, 0], [0, 0, 0.3]]),
}
PLANE = {
    "random": vg.orientations.random(),
    "aligned": vg.orientations.aligned((1, 2)),
    "fisher": vg.orientations.fisher((1, 2), 3.0),
    "watson": vg.orientations.watson((1, 2), 4.0),
    "girdle": vg.orientations.watson("x", -4.0),
    "bingham": vg.orientations.bingham((1, 2), 5.0, (-2, 1), second_kappa=2.0),
    "tensor": vg.orientations.tensor([[0.8, 0.2], [0.2, 0.2]]),
}


@pytest.mark.parametrize("dimension", [2, 3])
def test_second_moments_of_samples_are_those_of_the_law(dimension):
    for name, law in (PLANE if dimension == 2 else LAWS).items():
        ways = law.directions(MANY, stream(3, name), dimension=dimension)
        assert np.linalg.norm(ways, axis=1) == pytest.approx(1.0, abs=1e-14)
        assert dimension == 3 or not ways[:, 2].any()
        each = ways[:, :dimension, None] * ways[:, None, :dimension]
        error = each.std(axis=0) / math.sqrt(MANY) + 1e-12
        moment = law.moment(dimension=dimension)
        assert np.trace(moment) == pytest.approx(1.0, abs=1e-14)
        assert np.abs((each.mean(axis=0) - moment) / error).max() < 4.5, name


@pytest.mark.parametrize("kappa", [1e-3, 0.5, 4.0, 40.0, 700.0])
def test_moments_are_those_of_closed_forms(kappa):
    root = math.sqrt(kappa)
    about = 1.0 / (2.0 * root * special.dawsn(root)) - 1.0 / (2.0 * kappa)
    girdle = 1.0 / (2.0 * kappa) - math.exp(-kappa) / (math.sqrt(math.pi * kappa) * special.erf(root))
    langevin = special.spherical_in(1, kappa) / special.spherical_in(0, kappa)
    ratio = special.ive(1, 0.5 * kappa) / special.ive(0, 0.5 * kappa)
    for law, expected, dimension in (
        (vg.orientations.watson("x", kappa), about, 3),
        (vg.orientations.watson("x", -kappa), girdle, 3),
        (vg.orientations.fisher("x", kappa), 1.0 - 2.0 * langevin / kappa, 3),
        (vg.orientations.watson("x", kappa), 0.5 * (1.0 + ratio), 2),
        (vg.orientations.fisher("x", kappa), 1.0 - special.ive(1, kappa) / special.ive(0, kappa) / kappa, 2),
    ):
        # the closed forms lose digits for small concentrations
        assert law.moment(dimension=dimension)[0, 0] == pytest.approx(expected, abs=1e-11), law


def test_moments_of_strong_concentrations_are_those_of_a_plane_or_a_line():
    assert vg.orientations.watson("z", -1e9).moment(dimension=3)[2, 2] == pytest.approx(0.5e-9, rel=1e-6)
    assert 1.0 - vg.orientations.watson("z", 1e6).moment(dimension=3)[2, 2] == pytest.approx(1e-6, rel=1e-5)
    assert 1.0 - vg.orientations.fisher("z", 1e6).moment(dimension=3)[2, 2] == pytest.approx(2e-6, rel=1e-5)


def test_moments_of_bingham_are_those_of_a_cubature():
    kappas = np.array([3.0, -2.0, 0.7])

    def density(azimuth, cosine, k=None):
        flat = 1.0 - cosine**2
        squares = flat * math.cos(azimuth) ** 2, flat * math.sin(azimuth) ** 2, cosine**2
        return math.exp(kappas @ squares) * (1.0 if k is None else squares[k])

    whole, *parts = (
        integrate.dblquad(density, -1, 1, 0, 2 * math.pi, args=(k,), epsabs=1e-10)[0] for k in (None, 0, 1, 2)
    )
    assert bingham_moments(kappas) == pytest.approx(np.array(parts) / whole, abs=1e-9)


def test_cosines_follow_their_distribution_functions():
    kappa, axis = 4.0, np.array(WAY) / np.linalg.norm(WAY)

    def watson(t):
        return 0.5 * (1.0 + special.erfi(math.sqrt(kappa) * t) / special.erfi(math.sqrt(kappa)))

    def girdle(t):
        return 0.5 * (1.0 + special.erf(math.sqrt(kappa) * t) / special.erf(math.sqrt(kappa)))

    def fisher(t):
        return np.expm1(kappa * (t + 1.0)) / np.expm1(2.0 * kappa)

    def azimuth(ways):
        across = np.cross(axis, [0.0, 0.0, 1.0])
        return np.arctan2(ways @ np.cross(axis, across), ways @ across) / (2 * math.pi) + 0.5

    for law, function in (
        (vg.orientations.watson(WAY, kappa), watson),
        (vg.orientations.watson(WAY, -kappa), girdle),
        (vg.orientations.fisher(WAY, kappa), fisher),
    ):
        ways = law.directions(MANY, stream(5, law.kind), dimension=3)
        assert stats.kstest(ways @ axis, function).pvalue > 1e-3
        assert stats.kstest(azimuth(ways), "uniform").pvalue > 1e-3
    angle = np.arctan2(*vg.orientations.fisher("x", kappa).directions(MANY, stream(5, "plane"), dimension=2).T[1::-1])
    assert stats.kstest(angle, stats.vonmises(kappa).cdf).pvalue > 1e-3
    # of von Mises for the doubled angle
    angle = np.arctan2(*vg.orientations.watson("x", kappa).directions(MANY, stream(6, "plane"), dimension=2).T[1::-1])
    doubled = np.angle(np.exp(2j * angle))
    assert stats.kstest(doubled, stats.vonmises(0.5 * kappa).cdf).pvalue > 1e-3
    assert abs((np.abs(angle) < 0.5 * math.pi).mean() - 0.5) < 4 * 0.5 / math.sqrt(MANY)


@pytest.mark.parametrize(
    "values", [(1 / 3, 1 / 3, 1 / 3), (0.6, 0.3, 0.1), (0.98, 0.015, 0.005), (0.5, 0.499, 0.001), (0.8, 0.1, 0.1)]
)
def test_variances_give_the_principal_values(values):
    found = variances_of(np.array(values))
    assert squares_of(found) == pytest.approx(np.array(values), abs=1e-12)
    # the integral over s of the mean of x_i^2 exp(-s |x|^2)
    for k in range(3):
        whole = integrate.quad(
            lambda u, k=k: found[k] / (1 + 2 * found[k] * u / (1 - u)) / np.sqrt(1 + 2 * found * u / (1 - u)).prod()
            / (1 - u) ** 2, 0, 1, epsabs=1e-12, limit=200,
        )[0]  # fmt: skip
        assert whole == pytest.approx(values[k], abs=1e-8)


def test_nearly_flat_tensors_are_met():
    for values in ((0.5, 0.5 - 1e-6, 1e-6), (1 - 2e-8, 1e-8, 1e-8), (0.7, 0.3 - 1e-11, 1e-11), (0.7, 0.3, 0.0)):
        found = variances_of(np.array(values))
        assert squares_of(np.maximum(found, 1e-300)) == pytest.approx(np.array(values), abs=1e-9)


def test_rotations_take_one_vector_to_another():
    a, b = (rotation_matrices(random_rotations(stream(0, name), 500))[:, 0] for name in "ab")
    ends = np.vstack([b, -a, a, -a + 1e-9 * b])
    ends /= np.linalg.norm(ends, axis=1, keepdims=True)
    starts = np.vstack([a] * 4)
    turned = np.einsum("nij,nj->ni", rotation_matrices(rotations_between(starts, ends)), starts)
    assert np.abs(turned - ends).max() < 4e-16 * 4


def test_the_rotation_about_the_axis_of_the_body_is_uniform():
    body = np.tile([[0.6, 0.0, 0.8]], (MANY, 1))
    turns = rotation_matrices(vg.orientations.aligned("y").turns(body, stream(1, "spin"), dimension=3))
    assert np.einsum("nij,nj->ni", turns, body) == pytest.approx(np.tile([[0.0, 1.0, 0.0]], (MANY, 1)), abs=1e-15)
    across = turns @ np.array([0.8, 0.0, -0.6])
    angle = np.arctan2(across[:, 0], across[:, 2]) / (2 * math.pi) + 0.5
    assert stats.kstest(angle, "uniform").pvalue > 1e-3


def test_laws_are_made_again_from_their_mappings():
    for law in (*LAWS.values(), *PLANE.values(), vg.orientations.given([[1, 0, 0, 0]])):
        assert vg.orientations.make_orientations(law.to_mapping()) == law


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: vg.orientations.watson("z", math.nan), "kappa is nan: it must be finite"),
        (lambda: vg.orientations.watson("z", "4"), "kappa is '4': it must be a number"),
        (lambda: vg.orientations.watson("z", 1e13), r"kappa is 10000000000000.0: .* at most 1e\+12"),
        (lambda: vg.orientations.fisher("z", -1), "kappa is -1.0: .* at least 0"),
        (lambda: vg.orientations.aligned((0, 0, 0)), "axis is .* not all 0"),
        (lambda: vg.orientations.aligned("up"), "axis is 'up': .* one of x, y, z"),
        (lambda: vg.orientations.aligned((1, math.inf, 0)), "axis .* finite"),
        (lambda: vg.orientations.aligned("z", body_axis="middle"), "body_axis is 'middle'"),
        (lambda: vg.orientations.bingham("z", 4, (0, 1, 1), second_kappa=1), "cosine 0.707 with axis: .* right angles"),
        (lambda: vg.orientations.tensor(np.eye(3)), "trace 3: .* divide it"),
        (lambda: vg.orientations.tensor(np.diag([1.2, -0.2, 0])), r"principal values \[-0.2, 0.0, 1.2\]"),
        (lambda: vg.orientations.tensor([[0.5, 0.1], [0, 0.5]]), "differs by 0.1 from its transpose"),
        (lambda: vg.orientations.tensor(np.eye(4) / 4), r"shape \(4, 4\)"),
        (lambda: vg.orientations.tensor([[math.nan, 0], [0, 1]]), "matrix"),
        (lambda: vg.orientations.given([[1, 1, 0, 0]]), "length 1.41421 at row 0"),
        (lambda: vg.orientations.make_orientations({"axis": "z"}), "kind is missing"),
        (lambda: vg.orientations.watson("z", 4).moment(dimension=2), "must lie in the plane"),
        (lambda: vg.orientations.tensor(np.eye(3) / 3).moment(dimension=2), "must have 2 x 2"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(call, words):
    with pytest.raises(InputError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_unknown_names_are_told():
    with pytest.raises(UnknownNameError, match="watson"):
        vg.orientations.make_orientations({"kind": "wattson", "axis": "z", "kappa": 4})
    with pytest.raises(AttributeError, match="watson"):
        _ = vg.orientations.wattson
