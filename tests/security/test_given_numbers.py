"""What a user gives is kept, or refused, and a warning states all that it knows."""

import pytest

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning

BALL = vg.shapes.sphere()
CELL = vg.Box((4, 4, 8), periodic="xy")


def friction_tried(bed):
    sought = bed.provenance["settling"]["sought"]
    return {sought[name]["friction"] for name in ("loosest", "densest")} | {sought["friction"]}


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_a_friction_is_kept_where_a_solid_fraction_is_sought():
    loose = vg.pack(BALL, CELL, "rsa", count=30, seed=2)
    beds = [
        vg.settle(loose, gravity="-z", friction=0.2, solid_fraction=0.5, fall_time=3.0),
        vg.pack(BALL, CELL, "gravity", count=30, friction=0.2, solid_fraction=0.5, fall_time=3.0),
        vg.pack(BALL, CELL, "rsa", count=30, seed=2, settle=False),
    ]
    assert [friction_tried(bed) for bed in beds[:2]] == [{0.2}, {0.2}]
    assert all(bed.forces.friction == 0.2 for bed in beds[:2])
    mapping = {
        "shape": [{"family": "sphere"}],
        "container": {"kind": "box", "lengths": [4, 4, 8], "periodic": "xy"},
        "packing": {"method": "gravity", "count": 30, "solid_fraction": 0.5, "friction": 0.2},
    }
    (line,) = (line for line in vg.Scene.from_mapping(mapping).plan().computed if line.startswith("settle them"))
    assert "at a solid fraction of 0.5, with friction 0.2, by shaking" in line


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_layers_keep_a_friction_where_a_solid_fraction_is_sought():
    cell, layer = vg.Box((2, 2, 8), periodic="xy"), {"shapes": BALL, "count": 4}
    bed = vg.pack_layers([layer, {**layer, "solid_fraction": 0.5}], cell, friction=0.2, fall_time=2.0)
    assert friction_tried(bed) == {0.2} == {bed.forces.friction}


def test_a_solid_fraction_is_refused_of_grains_that_are_poured():
    with pytest.raises(InputError, match="solid_fraction is given: grains are poured by a count alone; leave it out"):
        vg.pour(BALL, CELL, 30, friction=0.2, solid_fraction=0.5)
    assert vg.pour(BALL, CELL, 3, batch=3, friction=0.2, fall_time=1.0).forces.friction == 0.2


def test_without_a_friction_the_usual_one_holds_or_it_is_found():
    loose = vg.pack(BALL, CELL, "rsa", count=30, seed=2)
    assert vg.settle(loose, gravity="-z", fall_time=3.0).forces.friction == 0.5
    bed = vg.pack(BALL, CELL, "gravity", count=30, fall_time=3.0)
    assert bed.forces.friction == bed.provenance["settling"]["parameters"]["friction"] == 0.5
    assert vg.methods.Gravity().friction is None


@pytest.mark.parametrize("asked", [{"solid_fraction": 0.6}, {"height": 3.0, "axes": "z"}])
def test_a_friction_beside_what_it_decides_is_refused(asked):
    loose = vg.pack(BALL, vg.Box((4, 4, 4), periodic="xyz"), "rsa", count=20, seed=2)
    name = next(iter(asked))
    words = rf"{name} is \S+ and friction is 0\.2: the friction is found that gives .*; leave one of them out"
    with pytest.raises(InputError, match=words):
        vg.compress(loose, friction=0.2, **asked)
    with pytest.raises(InputError, match=words):
        vg.pack(BALL, vg.Box((4, 4, 4), periodic="xyz"), "compress", count=20, friction=0.2, **asked)
    with pytest.raises(InputError, match=words):
        vg.Scene.from_mapping(
            {
                "shape": [{"family": "sphere"}],
                "container": {"kind": "box", "lengths": [4, 4, 4], "periodic": "xyz"},
                "packing": {"method": "rsa", "count": 20},
                "compress": {"friction": 0.2, **asked},
            }
        )


@pytest.mark.parametrize("count", [60, 400])
def test_a_warning_of_overlaps_counts_all_or_states_its_sample(count):
    rods = vg.shapes.spherocylinder(aspect=3.0)
    box = vg.Box((9, 9, 9)) if count > 200 else vg.Box((5, 5, 5))
    with pytest.warns(PackingWarning) as heard:
        bed = vg.pack(rods, box, "digital_rsa", count=count, cover="center", voxel_size=0.2, seed=1)
    proof = vg.verify(bed)
    text = next(str(one.message) for one in heard if "overlap by up to" in str(one.message))
    if count < 200:
        assert text.startswith(f"{proof.overlapping_pairs} pairs of grains overlap by up to {proof.deepest:.2g} mean")
    else:
        assert " mean diameters in a sample of 30 of 400 grains, others perhaps by more, since" in text
        assert int(text.split()[0]) < proof.overlapping_pairs
