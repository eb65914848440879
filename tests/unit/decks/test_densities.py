"""Decks of grains of several densities: masses and inertia that engines read, contact law, and what is refused."""

import dataclasses
from functools import cache

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.decks.engine import engine_registry

STEEL, GLASS, WOOD = 7800.0, 2500.0, 600.0
READERS = [name for name in engine_registry().names() if engine_registry().get(name).read is not None]


@cache
def mixed(density=(STEEL, GLASS, WOOD, GLASS), unit="mm"):
    """Return spheres of two densities, in turn, and two kinds of clumps."""
    sphere = vg.shapes.sphere()
    rods = [vg.fit_clump(vg.shapes.box(lengths=(1, 1, long)), max_spheres=4).to_shape() for long in (1.5, 2)]
    places = [(1 + 2 * (k % 4), 1 + 2 * (k // 4), 2) for k in range(12)]
    return vg.Packing.of(
        [sphere, sphere, *rods], vg.Box((8, 6, 4)), position=places, shape_id=[0, 1, 2, 3] * 3,
        scale=np.linspace(0.8, 1.1, 12), density=density, unit=unit,
    )  # fmt: skip


def true_masses(packing):
    return np.array(
        [
            packing.density[k] * packing.shapes[k].volume * (1e-3 * s) ** 3
            for k, s in zip(packing.shape_id, packing.scale, strict=True)
        ]
    )


@pytest.mark.parametrize("engine", READERS)
def test_engines_read_the_masses_of_several_materials(engine, tmp_path):
    packing = mixed()
    if "clump" not in engine_registry().get(engine).kinds:
        packing = packing[packing.shape_id < 2]
    deck = vg.write_deck(packing, tmp_path, engine)
    held = engine_registry().get(engine).read(tmp_path)
    np.testing.assert_allclose(held.mass, true_masses(packing), rtol=1e-6)
    np.testing.assert_allclose(held.inertia, deck.simulation.bodies.inertia, rtol=1e-5, atol=1e-20)
    together = "".join(path.read_text() for path in deck.files)
    assert "density 7800, 2500, 600" in together


@pytest.mark.parametrize("engine", READERS)
def test_a_deck_of_one_density_is_as_before(engine, tmp_path):
    """Equal densities for all shapes, and one number, are the same files."""
    packing = mixed()
    if "clump" not in engine_registry().get(engine).kinds:
        packing = packing[packing.shape_id < 2]
    one, equal = (vg.write_deck(dataclasses.replace(packing, density=rho), tmp_path / str(k), engine)
                  for k, rho in enumerate((GLASS, [GLASS] * 4)))  # fmt: skip
    assert [path.read_bytes() for path in one.files] == [path.read_bytes() for path in equal.files]


def test_the_time_step_of_hertz_is_that_of_the_sphere_that_waves_cross_first():
    sphere, law = vg.shapes.sphere(), {"law": "hertz", "young_modulus": 1e7}

    def step(density, scale):
        packing = vg.Packing.of(
            [sphere, sphere], vg.Box((8, 8, 8)), position=[(2, 2, 2), (5, 5, 5)], shape_id=[0, 1], scale=scale,
            density=density, unit="mm",
        )  # fmt: skip
        from voxgran.decks.write import described

        return described(packing, engine_registry().get("lammps"), law)[0].law.stable_step

    # radius times root of density: 1 * sqrt(7800) > 1 * sqrt(2500); 0.5 * sqrt(7800) < 1 * sqrt(2500)
    assert step([STEEL, GLASS], [1, 1]) == pytest.approx(step(GLASS, [1, 1]))
    assert step([STEEL, GLASS], [0.5, 1]) == pytest.approx(step(STEEL, [0.5, 1]))


@pytest.mark.parametrize(
    ("density", "material", "message"),
    [
        ((STEEL, GLASS, WOOD, GLASS), {"density": 2650}, "material density is 2650: .*leave it out"),
        ((STEEL, 1.0, WOOD, GLASS), {}, "density of the packing is 1: .*no solid.*dataclasses.replace"),
    ],
)
def test_densities_that_are_no_solids_or_are_stated_twice_are_refused(density, material, message, tmp_path):
    with pytest.raises(InputError, match=message):
        vg.write_deck(mixed(density), tmp_path / "new", "lammps", material=material)
    assert not (tmp_path / "new").exists()


def test_molecules_of_lammps_have_the_mass_of_their_material(tmp_path):
    packing = mixed()
    deck = vg.write_deck(packing, tmp_path, "lammps")
    found = {path.stem[-1]: path.read_text() for path in deck.files if path.suffix == ".mol"}
    for number in (2, 3):
        line = next(line for line in found[str(number)].splitlines() if line.endswith(" mass"))
        expected = packing.density[number] * packing.shapes[number].volume * 1e-9
        assert float(line.split()[0]) == pytest.approx(expected, rel=1e-9)
