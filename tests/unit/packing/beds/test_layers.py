"""Layers of different materials, one upon the other, and beds that grow upon a start."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError

BALL, FINE = vg.shapes.sphere(), vg.shapes.sphere(diameter=0.7)
BOX = vg.Box((5, 5, 14), periodic="xy")
TWO = [{"shapes": BALL, "height": 3}, {"shapes": FINE, "height": 2.5}]


@pytest.fixture(scope="module")
def bed():
    return vg.pack_layers(TWO, BOX, friction=0.3)


def test_layers_have_their_heights_and_lie_on_each_other(bed):
    lower, upper = bed.provenance["layers"]
    assert [lower["first"], upper["first"]] == [0, lower["count"]]
    assert upper["first"] + upper["count"] == bed.count
    # pinned, within the 7 % to which heights are met
    assert lower["surface"] == pytest.approx(3.0, rel=0.07)
    assert upper["surface"] == pytest.approx(5.5, rel=0.07)
    tops = bed.position[:, 2] + 0.5 * bed.diameters
    assert np.quantile(tops[: lower["count"]], 0.95) == pytest.approx(lower["surface"], abs=1e-12)
    # the upper layer lies in the surface of the lower one
    lowest = np.sort((bed.position[:, 2] - 0.5 * bed.diameters)[upper["first"] :])
    assert lower["surface"] - 1.2 < lowest[0] < lower["surface"] < np.median(lowest)
    assert bed.diameters[: lower["count"]] == pytest.approx(1.0)
    assert bed.diameters[lower["count"] :] == pytest.approx(0.7)


def test_layers_rest_and_do_not_overlap(bed):
    assert vg.verify(bed).ok
    assert bed.stop_reason == "settled"
    assert vg.equilibrium(bed).attrs["share_at_rest"] > 0.95


def test_one_layer_is_a_packing_and_lower_ones_move_little(bed):
    alone = vg.pack_layers(TWO[:1], BOX, friction=0.3)
    packed = vg.pack(BALL, BOX, "gravity", height=3, friction=0.3)
    assert alone.position.tobytes() == packed.position.tobytes()
    moved = bed.position[: alone.count] - alone.position
    moved[:, :2] -= 5.0 * np.round(moved[:, :2] / 5.0)
    # ten starts: 0.082, with a standard deviation of 0.013
    assert np.median(np.linalg.norm(moved, axis=1)) < 0.15
    again = vg.pack_layers(TWO, BOX, friction=0.3)
    assert again.position.tobytes() == bed.position.tobytes()


def test_layers_have_densities_of_their_own():
    layers = [{"shapes": BALL, "count": 10, "density": 1.0}, {"shapes": FINE, "count": 10, "density": 2.0}]
    bed = vg.pack_layers(layers, vg.Box((3, 3, 9)))
    assert bed.densities.tolist() == [1.0] * 10 + [2.0] * 10


def test_shapes_with_corners_and_in_the_plane():
    cubes, plates = vg.shapes.box(), vg.make_shape("polygon", corners=5)
    bed = vg.pack_layers([{"shapes": BALL, "count": 20}, {"shapes": cubes, "count": 15}], vg.Box((4, 4, 9)))
    assert vg.verify(bed).ok
    layers = bed.provenance["layers"]
    assert layers[0]["surface"] < layers[1]["surface"]
    flat = vg.pack_layers(
        [{"shapes": vg.make_shape("disk"), "height": 3}, {"shapes": plates, "count": 20}], vg.Rectangle((8, 12))
    )
    assert vg.verify(flat).ok
    assert flat.provenance["layers"][0]["surface"] == pytest.approx(3.0, rel=0.1)


def test_deposits_are_layered_too():
    bed = vg.pack_layers([{"shapes": BALL, "count": 50}, {"shapes": FINE, "count": 60}], BOX, "deposition")
    assert vg.verify(bed).ok
    alone = vg.pack(BALL, BOX, "deposition", count=50)
    assert bed.position[:50] == pytest.approx(alone.position, abs=1e-9)
    assert bed.provenance["layers"][1] == {
        "first": 50,
        "count": 60,
        "surface": pytest.approx(float(np.quantile(bed.position[50:, 2] + 0.35, 0.95))),
    }


def test_a_start_alone_settles():
    start = vg.pack(BALL, vg.Box((4, 4, 4)), "gravity", count=20)
    same = vg.pack((), vg.Box((4, 4, 4)), "gravity", start=start)
    assert same.count == 20
    # few grains roll on: over 12 seeds the mean way is 0.004, with a standard deviation of 0.003
    assert np.linalg.norm(same.position - start.position, axis=1).mean() < 0.05


@pytest.mark.parametrize(
    ("layers", "words"),
    [
        ([], "layers is empty"),
        ("sand", "layers is 'sand'"),
        ([BALL], "layer 0 is"),
        ([{"count": 3}], "layer 0 has no shapes"),
        ([{"shapes": BALL, "count": 3, "start": None}], "layer 0 has a start"),
        ([{"shapes": BALL, "count": 3, "height": 2}], "layer 0 has the height 2 and the count 3: .* leave one of them"),
        ([{"shapes": BALL, "count": 3}, {"shapes": FINE, "height": -1}], "height of layer 1 is -1: .* above 0"),
        ([{"shapes": BALL, "count": 3}, {"shapes": FINE, "height": 40}], "height is .* within it"),
        ([{"shapes": BALL, "count": 3, "density": 2}, {"shapes": FINE, "count": 3}], "layer 1 has no density"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(layers, words):
    with pytest.raises(InputError, match=words):
        vg.pack_layers(layers, BOX)


def test_layers_of_a_method_without_gravity_are_refused():
    with pytest.raises(InputError, match="would not lie upon each other"):
        vg.pack_layers([{"shapes": BALL, "count": 3}] * 2, BOX, "rsa")
