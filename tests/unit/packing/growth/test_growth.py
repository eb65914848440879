"""Seeds in a column, and the beds that grow from them."""

import numpy as np
import pytest
from scipy.stats import spearmanr

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran.packing.growth.seeds import column_top, container_levels, random_seeds, volume_below

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


def test_the_column_holds_the_volume():
    """A box to the share of its height, a sphere to the height of its cap."""
    generator = np.random.default_rng(2)
    box = vg.Box((3, 4, 10))
    level = column_top(box, UP, 0.4 * box.volume, generator) - box.bounds[0][2]
    assert level == pytest.approx(4.0, abs=0.1)
    ball = vg.Sphere(radius=2.0)
    middle = column_top(ball, UP, 0.5 * ball.volume, generator)
    assert middle == pytest.approx(float(np.mean(ball.bounds, axis=0)[2]), abs=0.06)


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
    assert bed.count == int(0.52 * 125 / SPHERE.volume)
    assert bed.position[:, 2].max() <= 4.5
    assert bed.verify().ok


def test_a_looser_column_falls_farther():
    """The same grains from a column of half the solid fraction come to rest as well."""
    for fill in (0.25, 0.5):
        bed = vg.pack(SPHERE, vg.Box((5, 5, 20), periodic="xy"), "gravity", count=80, fill=fill)
        assert bed.stop_reason == "settled"
    with pytest.raises(InputError, match=r"fill is 0\.9"):
        vg.pack(SPHERE, vg.Box((5, 5, 20)), "gravity", count=80, fill=0.9)


def test_a_height_counts_the_grains():
    """The bed ends at the height that is asked, also without friction and above a bed of lognormal spheres."""
    box = vg.Box((7, 7, 30), periodic="xy")
    for parameters in ({}, {"friction": 0.0}, {"sizes": vg.sizes.lognormal(median=1.0, sigma=0.3)}):
        bed = vg.pack(SPHERE, box, "gravity", height=8.0, **parameters)
        tops = bed.position[:, 2] + 0.5 * bed.diameters
        assert bed.stop_reason == "settled"
        # the tops of the uppermost grains, without the few that lie on the others
        assert np.quantile(tops, 0.95) - box.bounds[0][2] == pytest.approx(8.0, rel=0.07)


def test_a_height_in_the_unit_of_the_container_and_with_a_count():
    box = vg.Box((4e-3, 4e-3, 2e-2), periodic="xy")
    grains = vg.make_shape("sphere", diameter=1e-3)
    bed = vg.pack(grains, box, "gravity", height=3e-3)
    assert bed.volumes.sum() == pytest.approx(0.57 * 4e-3 * 4e-3 * 3e-3, rel=0.03)
    few = vg.pack(grains, box, "gravity", height=3e-3, count=20)
    assert few.count == 20


def test_a_height_above_the_container_is_refused():
    with pytest.raises(InputError, match=r"height is 6, and the container is 5 high.*give a height within it"):
        vg.pack(SPHERE, vg.Box((5, 5, 5)), "gravity", height=6.0)


def test_a_lid_lies_on_the_bed_that_it_presses():
    bed = vg.pack(SPHERE, vg.Box((4e-3, 4e-3, 8e-3), periodic="xy"), "gravity", count=30, lid={"weight": 2.0},
        sizes=vg.sizes.fixed(1e-3))  # fmt: skip
    top = (bed.position[:, 2] + 0.5 * bed.diameters).max()
    assert bed.lid.normal == pytest.approx([0.0, 0.0, 1.0])
    assert top <= bed.lid.level <= top + 2e-6
    assert (bed.forces.j == -2).any()


def test_volume_below_a_level_follows_the_closed_form_of_a_cap():
    ball = vg.Sphere(4.0)
    lower, upper = container_levels(ball, UP)
    assert (upper - lower) == pytest.approx(8.0)
    depth = 3.0
    cap = np.pi * depth**2 * (3 * 4.0 - depth) / 3
    assert volume_below(ball, UP, lower + depth, np.random.default_rng(0)) == pytest.approx(cap, rel=0.03)
