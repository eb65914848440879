"""Layers that are compacted one by one, and the profile of the bed."""

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
COLUMN = vg.Box((8, 8, 16), periodic="xy")


def layered(container=COLUMN, **options):
    """Return a bed that is proven to be free of overlap."""
    shape = DISK if container.dimension == 2 else SPHERE
    bed = vg.pack(shape, container, method="multilayer", **options)
    assert vg.verify(bed).ok
    return bed


def slope_of(bed):
    """Return the change of the solid fraction from the floor to the lid, by exact volumes between five levels."""
    height, radius, z = bed.container.lengths[2], bed.diameters / 2, bed.position[:, 2]
    levels = np.linspace(1.5, height - 1.5, 6)
    cut = np.clip((levels[:, None] - z) / radius, -1, 1)
    below = (np.pi * radius**3 * (cut - cut**3 / 3)).sum(axis=1)
    fractions = np.diff(below) / (np.diff(levels) * bed.container.volume / height)
    return np.polyfit((levels[1:] + levels[:-1]) / 2 / height, fractions, 1)[0]


@pytest.mark.parametrize("wanted", [slow(0.5), slow(0.58)])
def test_the_profile_is_level_with_undercompaction_and_not_without(wanted):
    def slopes(**more):
        return np.mean([slope_of(layered(solid_fraction=wanted, seed=seed, **more)) for seed in range(2)])

    without, usual, much = slopes(undercompaction=0.0), slopes(), slopes(undercompaction=0.6)
    # layers below are compacted by those above
    assert without < -0.045
    assert abs(usual) < 0.04
    assert much > 0.03


@pytest.mark.parametrize(
    ("container", "options"),
    [
        slow(COLUMN, {"solid_fraction": 0.55, "sizes": vg.sizes.uniform(0.7, 1.3)}),
        slow(vg.Box((6, 6, 6)), {"solid_fraction": 0.5, "count": 200}),
        (vg.Rectangle((12, 12)), {"solid_fraction": 0.75, "sizes": vg.sizes.uniform(0.7, 1.3)}),
        (vg.Box((5, 5, 5)), {"solid_fraction": 0.4, "layers": 1}),
    ],
)
def test_the_solid_fraction_is_met_and_the_gradation_kept(container, options):
    bed = layered(container, **options)
    assert bed.stop_reason == "solid_fraction"
    assert bed.solid_fraction == pytest.approx(options["solid_fraction"], abs=1e-9)
    assert bed.gravity == ((0, 0, -1) if bed.dimension == 3 else (0, -1, 0))


def test_void_ratios_of_layers_fall_by_the_rule():
    bed = layered(solid_fraction=0.5, count=600, layers=4, undercompaction=0.3)
    heights = np.array(bed.provenance["compression"]["layer_heights"])
    volume = np.cumsum(bed.volumes)[[149, 299, 449, 599]]
    void = heights * COLUMN.volume / volume - 1
    assert void == pytest.approx([1.3, 1.2, 1.1, 1.0], rel=1e-9)


def test_grains_of_a_layer_stay_about_where_they_appeared():
    bed = layered(solid_fraction=0.55, count=1000)
    middle = bed.position[:, 2].reshape(5, 200).mean(axis=1)
    assert middle == pytest.approx(16 * (np.arange(5) + 0.5) / 5, abs=0.4)


@pytest.mark.slow
def test_without_a_target_the_bed_is_a_little_looser_than_jammed():
    assert layered(vg.Box((8, 8, 8))).solid_fraction == pytest.approx(0.59, abs=0.01)


@pytest.mark.parametrize(
    ("container", "options", "words"),
    [
        (vg.Cylinder(3, 6), {"solid_fraction": 0.5}, "layers lie on the floor of a box"),
        (vg.Box((4, 4, 4), periodic="z"), {"solid_fraction": 0.5}, "not periodic along z"),
        (COLUMN, {"solid_fraction": 0.7, "sizes": vg.sizes.uniform(0.9, 1.1)}, "jam at about 0.6"),
        (COLUMN, {"solid_fraction": 0.5, "layers": 0}, "layers"),
        (
            COLUMN,
            {"count": 9, "obstacles": vg.Packing.of(SPHERE, COLUMN, position=[(4, 4, 4)])},
            "finds the heights of its layers",
        ),
    ],
)
def test_what_cannot_be_is_refused(container, options, words):
    with pytest.raises(InputError, match=words):
        vg.pack(SPHERE, container, method="multilayer", **options)
