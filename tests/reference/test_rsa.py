"""Random sequential addition to saturation in continuous space, against published solid fractions."""

import math

import numpy as np
import pytest
from kit import references

import voxgran as vg

VALUES = references("rsa_saturation")
SQUARE = {"vertices": ((0, 0), (1, 0), (1, 1), (0, 1))}


@pytest.mark.parametrize(
    ("name", "shape", "room", "runs", "aligned"),
    [
        ("spheres_3d", vg.make_shape("sphere"), vg.Box((18, 18, 18), "xyz"), 16, False),
        ("disks_2d", vg.make_shape("disk"), vg.Rectangle((90, 90), "xy"), 24, False),
        ("aligned_squares", vg.make_shape("polygon", **SQUARE), vg.Rectangle((90, 90), "xy"), 24, True),
        ("aligned_cubes", vg.make_shape("box", lengths=(1, 1, 1)), vg.Box((20, 20, 20), "xyz"), 16, True),
    ],
)
def test_saturated_solid_fractions(name, shape, room, runs, aligned):
    found = []
    for seed in range(runs):
        packing = vg.pack(shape, room, method="rsa", until="saturated", seed=seed, aligned=aligned)
        assert packing.provenance["saturation"]["proven"]
        found.append(packing.solid_fraction)
    value, error = VALUES[name]["value"], VALUES[name]["error"]
    own = np.std(found, ddof=1) / math.sqrt(runs)
    assert abs(np.mean(found) - value) < 3 * math.hypot(own, error), (np.mean(found), own)
    # and the runs are not so noisy that this says nothing
    assert own < 0.002 * value


def test_intervals_on_a_line():
    """Squares in a strip of their own height are intervals: the constant of Renyi."""
    strip, square = vg.Rectangle((400, 1), "x"), vg.make_shape("polygon", **SQUARE)
    found = [
        vg.pack(square, strip, method="rsa", until="saturated", seed=seed, aligned=True).solid_fraction
        for seed in range(16)
    ]
    own = np.std(found, ddof=1) / 4
    assert abs(np.mean(found) - VALUES["renyi_1d"]["value"]) < 3 * own
    assert own < 0.003


def test_the_last_places_fill_slowly():
    """Feder's law: what is missing to saturation goes with the tries to the power -1 / d."""
    disk, room, late = vg.make_shape("disk"), vg.Rectangle((60, 60), "xy"), []
    for tries in (20, 80, 320):
        packings = [
            vg.pack(disk, room, method="rsa", scheme="2", retry="next", tries=tries, seed=seed) for seed in range(4)
        ]
        missing = VALUES["disks_2d"]["value"] - np.mean([packing.solid_fraction for packing in packings])
        late.append((math.log(packings[0].provenance["counters"]["attempts"]), math.log(missing)))
    slope = np.polyfit(*np.array(late).T, 1)[0]
    assert slope == pytest.approx(-1 / 2, abs=0.06)
