"""Material and contact law: closed formulas, defaults, and what is refused."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning, UnknownNameError
from voxgran.decks.contact_law import contact_law, damping_ratio
from voxgran.decks.write import as_material

MASS, DIAMETER = np.array([2.0, 1.0, 4.0]), 0.5


def law_of(load=1.0, radius=0.2, **material):
    size = {"mass": MASS, "quickest": (radius, 2500.0), "diameter": DIAMETER}
    return contact_law(vg.Material(**material), density=2500.0, load=(load, DIAMETER), **size)


@pytest.mark.parametrize("restitution", [0.05, 0.3, 0.9])
@pytest.mark.parametrize("masses", [(1.0, 1.0), (0.2, 7.0)])
def test_the_damping_gives_back_the_restitution(restitution, masses):
    effective = masses[0] * masses[1] / sum(masses)
    law = law_of(stiffness=1e4, restitution=restitution)

    def motion(_, state):
        return [state[1], -(law.stiffness * state[0] + law.damping(effective) * state[1]) / effective]

    def parted(_, state):
        return state[0]

    parted.terminal, parted.direction = True, -1
    found = solve_ivp(motion, (0, 10), [0.0, 1.0], events=parted, rtol=1e-10, atol=1e-14)
    assert -found.y[1, -1] == pytest.approx(restitution, rel=1e-6)


def test_an_elastic_collision_is_not_damped():
    assert damping_ratio(1.0) == 0.0


def test_the_stable_step_of_the_linear_law_is_a_share_of_the_shortest_collision():
    law = law_of(stiffness=800.0)
    assert law.stable_step == pytest.approx(math.pi * math.sqrt(0.5 / 800.0) / 50)
    assert law.shear_stiffness == pytest.approx(800.0 * 2 / 7)


def test_the_stable_step_of_hertz_is_a_share_of_the_rayleigh_time():
    law = law_of(law="hertz", young_modulus=1e8, poisson_ratio=0.3)
    rayleigh = math.pi * 0.2 * math.sqrt(2500 * 2.6 / 1e8) / (0.1631 * 0.3 + 0.8766)
    assert law.stable_step == pytest.approx(0.2 * rayleigh)


def test_the_usual_stiffness_keeps_the_overlap_at_a_thousandth():
    assert law_of(load=3.0).stiffness == pytest.approx(3.0 / (1e-3 * DIAMETER))


def test_youngs_modulus_gives_the_stiffness_of_a_bar():
    assert law_of(young_modulus=1e6).stiffness == pytest.approx(math.pi / 4 * 1e6 * DIAMETER)


@pytest.mark.parametrize("given", [{"stiffness": 30.0}, {"law": "hertz", "young_modulus": 4.0}])
def test_soft_grains_are_refused_and_softish_ones_warned_of(given):
    with pytest.raises(InputError, match="presses grains into each other"):
        law_of(load=2.0, **given)


def test_the_remedy_for_soft_grains_is_enough():
    with pytest.warns(PackingWarning, match="give about 4000"):
        law_of(load=2.0, stiffness=100.0)
    law_of(load=2.0, stiffness=4e3)


def test_the_overlap_of_hertz_is_that_of_two_spheres():
    # force of two spheres of the radius d / 2: 4/3 E* sqrt(R*) overlap^1.5, with R* = d / 4
    modulus, overlap = 1e5, 0.009 * DIAMETER
    effective = modulus / (2 * (1 - 0.25**2))
    load = 4 / 3 * effective * math.sqrt(DIAMETER / 4) * overlap**1.5
    law_of(load=load, law="hertz", young_modulus=modulus)
    with pytest.warns(PackingWarning, match=r"by 0\.01 of"):
        law_of(load=load * (10.1 / 9) ** 1.5, law="hertz", young_modulus=modulus)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"law": "hertz"}, "young_modulus is missing"),
        ({"law": "hooke"}, "law"),
        ({"restitution": 0.0}, "restitution"),
        ({"restitution": 1.1}, "restitution"),
        ({"friction": -0.1}, "friction"),
        ({"poisson_ratio": 0.6}, "poisson_ratio"),
        ({"stiffness": 0.0}, "stiffness"),
        ({"density": math.nan}, "density"),
        ({"cohesion": 0.1}, "give law='hertz'"),
    ],
)
def test_bad_materials_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        vg.Material(**given)


def test_a_mapping_is_a_material():
    assert as_material({"friction": 0.2}) == vg.Material(friction=0.2)
    assert as_material(None) == vg.Material()
    with pytest.raises(UnknownNameError, match="did you mean 'friction'"):
        as_material({"fricton": 0.2})
    with pytest.raises(InputError, match="a Material"):
        as_material(3)
