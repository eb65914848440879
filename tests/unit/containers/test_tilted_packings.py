"""Packings in tilted periodic cells: density, proofs and measures beside those in upright ones."""

import itertools
import math

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import GrainTooLargeError, InputError
from voxgran.containers.model import periods_of
from voxgran.measures.model import measure_registry
from voxgran.measures.registered.profile import axis_profile
from voxgran.report.colors import _nearest

SPHERE = vg.make_shape("sphere")
CELL = vg.Box((6, 5, 7), "xyz", tilt=(2.5, -1.7, 2.1), origin=(1, -2, 0.5))

pytestmark = pytest.mark.filterwarnings("ignore:the bulk holds", "ignore:.*grains were placed before")


@pytest.fixture(scope="module")
def jammed():
    return vg.pack(SPHERE, CELL, "jam", seed=3, count=250)


def distances(packing, most=3):
    """Return the distances (n, n, images) of all centroids and all images, without those of a centroid from itself."""
    turns = np.array(list(itertools.product(range(-most, most + 1), repeat=3)))
    shifts = np.unique(turns @ periods_of(packing.container), axis=0)
    apart = packing.position[:, None, None] - packing.position[None, :, None] - shifts
    found = np.linalg.norm(apart, axis=3)
    found[found == 0.0] = np.inf
    return found


def test_random_sequential_addition_saturates_as_in_upright_cells():
    fractions = []
    for seed in range(4):
        made = vg.pack(SPHERE, vg.Box((7, 7, 7), "xyz", tilt=(3, -2, 2.5)), "rsa", count=10_000, seed=seed)
        assert made.stop_reason == "saturated"
        assert made.verify().ok
        fractions.append(made.solid_fraction)
    # 0.3841 of infinite packings (Zhang & Torquato 2013), with the scatter of 250 spheres
    assert np.mean(fractions) == pytest.approx(0.384, abs=0.007)


def test_grains_of_any_shape_at_random_do_not_meet_images_of_themselves():
    rods = vg.make_shape("ellipsoid", aspect=(5, 1, 1), diameter=2)
    made = vg.pack(rods, vg.Box((6, 5, 3), "xyz", tilt=(2.5, -1.4, 2.1)), "rsa", seed=1, count=6)
    assert made.count > 3
    assert made.verify().ok
    # spheres that fit the lengths but not the shortest sum of periods
    narrow = vg.Box((3, 1.2, 1.2), "xyz", tilt=(1.5, 0, 0.6))
    assert vg.pack(SPHERE, narrow, "rsa", count=1).verify().ok
    # a cell that is thinner than the sphere, whose images lie beside each other, and one that has no room for it
    thin = vg.Box((3, 0.9, 3), "xyz", tilt=(1.4, 0, 0))
    placed = vg.pack(SPHERE, thin, "rsa", count=1)
    assert placed.count == 1
    assert placed.verify().ok
    with pytest.raises(GrainTooLargeError, match="none can fit in the container"):
        vg.pack(SPHERE, vg.Box((3, 0.9, 3), "xyz", tilt=(0.3, 0, 0)), "rsa", count=1)


def test_spheres_jam_as_in_upright_cells(jammed):
    assert jammed.verify().ok
    assert 0.63 < jammed.solid_fraction < 0.65
    found = jammed.measure(["density", "coordination"])
    assert float(found["bulk_solid_fraction"]) == pytest.approx(jammed.solid_fraction, rel=1e-12)
    assert float(found["coordination_without_rattlers"]) == pytest.approx(6.0, abs=0.1)
    flat = vg.pack(vg.make_shape("disk"), vg.Rectangle((10, 12), "xy", tilt=3), "expand", count=110, solid_fraction=0.7)
    assert flat.verify().ok
    assert flat.solid_fraction == pytest.approx(0.7)


def test_a_compressed_cell_keeps_its_form_and_bears_its_stress():
    made = vg.pack(SPHERE, CELL, "compress", seed=3, count=150, friction=0.5)
    assert made.stop_reason == "compressed"
    assert made.verify().ok
    lengths, (xy, xz, yz) = made.container.lengths, made.container.tilt
    shares = (xy / lengths[0], xz / lengths[0], yz / lengths[1])
    assert shares == pytest.approx((2.5 / 6, -1.7 / 6, 2.1 / 5), rel=1e-12)
    proof = vg.equilibrium(made, stress=1.0)
    assert float((proof.residual < 0.05).mean()) > 0.97
    stress = np.asarray(made.forces.stress)
    assert stress.diagonal() / np.trace(stress) * 3 == pytest.approx(np.ones(3), abs=0.01)


def test_a_bed_in_a_tilted_cell_rests():
    bed = vg.pack(SPHERE, vg.Box((6, 5, 9), "xy", tilt=(2.5, 0, 0)), "gravity", seed=3, count=120)
    assert bed.stop_reason == "settled"
    assert bed.verify().ok
    assert float((vg.equilibrium(bed).residual < 0.01).mean()) > 0.98
    # without the tilt it overlaps across the faces
    upright = vg.Packing.of(SPHERE, vg.Box((6, 5, 9), "xy"), position=bed.position, scale=bed.scale)
    assert upright.verify().overlapping_pairs > 10


def test_rocks_settle_around_an_obstacle_in_a_tilted_cell():
    box = vg.Box((4, 4, 6), "xy", tilt=(1.5, 0, 0))
    obstacle = vg.Packing.of(vg.make_shape("sphere", diameter=1.5), box, position=[(0.2, 0.2, 1)])
    rock = vg.make_shape("convex_polyhedron", seed=1)
    bed = vg.pack(rock, box, "gravity", seed=3, count=15, obstacles=obstacle)
    assert bed.count == 16
    assert bed.verify().ok


@pytest.mark.slow
def test_pairs_and_waves_are_those_of_all_images(jammed):
    found = jammed.measure("rdf")["/profiles"]
    edges = np.concatenate([[0], found.pair_distance.values])
    # edges lie between the middles; the first bin has half a width
    width = edges[3] - edges[2]
    ends = np.concatenate([[0], (np.arange(len(found.pair_distance)) + 0.5) * width]) * jammed.diameters.mean()
    every = distances(jammed)
    counts = np.histogram(every[np.isfinite(every)], ends)[0]
    shell = 4 / 3 * math.pi * np.diff(ends**3) * jammed.count**2 / CELL.volume
    free = shell * (1 - 1 / jammed.count)
    assert found.radial_distribution.values == pytest.approx(counts / free, rel=1e-9)
    assert _nearest(jammed) == pytest.approx(every.min(axis=(1, 2)), rel=1e-12)
    # a lattice scatters on its own reciprocal vectors only
    box = vg.Box((4, 4, 4), "xyz", tilt=(1, -1, 2))
    places = np.indices((4, 4, 4)).reshape(3, -1).T / 4 @ box.vectors
    crystal = vg.Packing.of(vg.make_shape("sphere", diameter=0.5), box, position=places)
    waves = crystal.measure("rdf")["/profiles"].structure_factor
    shortest = 2 * math.pi * np.linalg.norm(np.linalg.inv(box.vectors / 4).T, axis=1).min() * 0.5
    near = waves.wave_number.values < 0.9 * shortest
    assert near.any()
    assert np.abs(waves.values[near]).max() < 1e-18


def test_volumes_in_windows_are_those_of_points(jammed):
    low, high = np.array([2.0, -3.0, 1.0]), np.array([5.0, 0.5, 6.0])
    found = vg.window_solid_fraction(jammed, low, high)
    points = low + np.random.default_rng(1).random((20_000, 3)) * (high - low)
    turns = np.array(list(itertools.product(range(-2, 3), repeat=3))) @ periods_of(CELL)
    centers = (jammed.position[:, None] + turns).reshape(-1, 3)
    near = centers[((centers > low - 1) & (centers < high + 1)).all(axis=1)]
    nearest = np.linalg.norm(points[:, None] - near, axis=2).min(axis=1)
    assert float(found) == pytest.approx((nearest < jammed.bounding_radii[0]).mean(), abs=0.012)
    whole = vg.window_solid_fraction(jammed, *CELL.bounds)
    assert float(whole) == pytest.approx(jammed.solid_fraction, rel=1e-12)
    # moved anywhere, the box holds each point once
    assert float(vg.window_solid_fraction(jammed, *(CELL.bounds + 1.3))) == pytest.approx(jammed.solid_fraction)
    assert axis_profile(jammed, "z").solid_fraction.mean() == pytest.approx(jammed.solid_fraction, rel=1e-12)
    with pytest.raises(InputError, match="a profile along x takes upright containers only"):
        axis_profile(jammed, "x")
    image = vg.to_image(jammed, voxel_size=0.1)
    assert image.shape == (60, 50, 70)
    assert (image > 0).mean() == pytest.approx(jammed.solid_fraction, abs=2e-3)


def test_what_takes_upright_containers_only_says_so(jammed):
    registry = measure_registry()
    unable = {name for name in registry.names() if not registry.get(name).tilted}
    assert {"voids", "homogeneity", "local_density"} <= unable
    for name in unable:
        with pytest.raises(InputError, match=f"measure '{name}' takes upright containers only") as caught:
            jammed.measure(name)
        assert "\n" not in str(caught.value)
    # those that are not named are left out
    assert "/voids" not in jammed.measure("all").groups
    with pytest.raises(InputError, match=r"method 'digital' takes upright .*of advancing_front, .*rsa"):
        vg.pack(SPHERE, CELL, "digital", count=3)
    with pytest.raises(InputError, match="an inlet takes upright containers only"):
        vg.pour(SPHERE, vg.Box((9, 9, 9), "xy", tilt=(3, 0, 0)), count=9, inlet=vg.Inlet(radius=2))


@pytest.mark.parametrize("act", [slow("deform"), "grow", "inscribe", slow("compress")])
def test_packings_of_true_shapes_in_tilted_cells(act, jammed):
    rock = vg.make_shape("convex_polyhedron", seed=2)
    if act == "inscribe":
        assert vg.inscribe(jammed, [rock]).verify().ok
        return
    rocks = vg.pack(rock, vg.Box((4, 4, 4), "xyz", tilt=(1.5, 0, 1)), "rsa", seed=3, count=20)
    if act == "deform":
        few = vg.pack(SPHERE, vg.Box((2.2, 2.2, 2.2), "xyz", tilt=(1, -0.7, 0.8)), "jam", seed=3, count=12)
        wide = vg.Packing.of(SPHERE, few.container, position=few.position, scale=few.scale * 1.01)
        assert vg.deform(wide, stiffness=1.0, spacing=0.25).image.any()
        return
    made = vg.grow(rocks) if act == "grow" else vg.compress(rocks, friction=0.3)
    assert made.solid_fraction > rocks.solid_fraction
    assert made.verify().ok


@pytest.mark.parametrize("mode", ["loose", "dense"])
def test_a_front_grows_across_tilted_faces(mode):
    made = vg.pack(SPHERE, vg.Box((7, 6, 7), "xyz", tilt=(3, -2, 2)), "advancing_front", mode=mode, seed=1)
    assert made.verify().ok
    assert made.solid_fraction > (0.4 if mode == "loose" else 0.5)
    # each sphere touches three others when it is placed
    assert float(made.measure("coordination")["mean_coordination_number"]) > 5.5


@pytest.mark.parametrize("name", ["a.csv", "a.txt"])
def test_text_keeps_the_tilt(name, tmp_path):
    tilted = vg.Packing.of(SPHERE, CELL, position=[(3, 0, 3)])
    vg.save(tilted, tmp_path / name)
    again = vg.load(tmp_path / name)
    assert again.container == CELL
    np.testing.assert_array_equal(again.position, tilted.position)
    # what reads tables of upright containers reads it, too, once it skips comments
    rows = [line for line in (tmp_path / name).read_text().splitlines() if not line.startswith("#")]
    assert rows[-1].replace(",", " ") == "3.0 0.0 3.0 0.5"
