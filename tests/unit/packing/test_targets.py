"""Targets that are met, and those that are missed: the reason, the numbers and the warning."""

import warnings

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import PackingWarning

SPHERE, BOX = vg.make_shape("sphere"), vg.Box((4, 4, 4))


def pack(container=BOX, **asked):
    """Return what random addition makes of a target; a missed one warns."""
    return vg.pack(SPHERE, container, method="rsa", **asked)


def test_a_missed_solid_fraction_warns_with_both_numbers_and_a_remedy():
    with pytest.warns(PackingWarning) as found:
        packing = pack(solid_fraction=0.45)
    (sentence,) = (str(entry.message) for entry in found)
    assert sentence.startswith(f"the solid fraction is {packing.solid_fraction:.4g} instead of 0.45 where the method")
    assert "ask for less" in sentence
    assert packing.provenance["missed"]["solid_fraction"] == pytest.approx(0.45 - packing.solid_fraction)


def test_where_neither_target_is_reached_both_are_missed():
    with pytest.warns(PackingWarning, match=r"of 50 grains were placed .* and the solid fraction is .* instead of 0.3"):
        packing = pack(count=50, solid_fraction=0.3)
    missed = packing.provenance["missed"]
    # 0.3 is reached by 37 spheres, before the 50th
    assert packing.count < 37
    assert missed["count"] == 50 - packing.count
    assert missed["solid_fraction"] == pytest.approx(0.3 - packing.solid_fraction)


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        ({"count": 5}, "count"),
        ({"count": 5, "solid_fraction": 0.3}, "count"),
        ({"solid_fraction": 0.1}, "solid_fraction"),
        ({"count": 500, "solid_fraction": 0.1}, "solid_fraction"),
    ],
)
def test_whichever_comes_first_ends_it_and_nothing_is_missed(asked, reason):
    with warnings.catch_warnings(action="error"):
        packing = pack(**asked)
    assert packing.stop_reason == reason
    assert packing.provenance["missed"]["count"] == 0
    assert packing.provenance["missed"].get("solid_fraction", 0.0) == 0.0
    if reason == "solid_fraction":
        # no more than the last grain goes beyond
        assert 0.1 <= packing.solid_fraction < 0.1 + SPHERE.volume / BOX.volume


def test_grains_that_were_there_count_for_no_target():
    start = vg.Packing.of([SPHERE], BOX, position=[(1, 1, 1), (3, 3, 3)])
    packing = pack(solid_fraction=0.1, start=start)
    further = packing.solid_fraction - start.solid_fraction
    assert 0.1 <= further < 0.1 + SPHERE.volume / BOX.volume
    assert packing.stop_reason == "solid_fraction"
    with pytest.warns(PackingWarning, match="of 60 grains were placed"):
        packing = pack(count=60, start=start)
    assert packing.provenance["missed"]["count"] == 60 - (packing.count - 2)
    with pytest.warns(PackingWarning, match="solid fraction"):
        packing = pack(solid_fraction=0.5, start=start)
    further = packing.solid_fraction - start.solid_fraction
    assert packing.provenance["missed"]["solid_fraction"] == pytest.approx(0.5 - further)


def test_a_front_misses_and_says_that_no_grain_finds_room():
    with pytest.warns(PackingWarning, match=r"instead of 0\.62 where the method stopped \(full\): no grain finds room"):
        packing = vg.pack(SPHERE, vg.Box((6, 6, 6)), method="advancing_front", solid_fraction=0.62)
    assert packing.solid_fraction < 0.6


def test_grains_that_cannot_fit_are_missing_to_the_solid_fraction():
    sizes = vg.sizes.discrete([0.5, 5.0], [0.9, 0.1])
    with pytest.warns(PackingWarning) as found:
        packing = pack(solid_fraction=0.05, sizes=sizes, seed=1)
    texts = [str(entry.message) for entry in found]
    missed = packing.provenance["missed"]
    assert missed["cannot_fit_count"] > 0
    assert missed["solid_fraction"] == pytest.approx(0.05 - packing.solid_fraction)
    assert any("cannot fit" in text for text in texts)
    assert any("instead of 0.05" in text for text in texts)
    assert np.isin(packing.diameters.round(9), [0.5]).all()


def test_the_plan_promises_no_solid_fraction():
    scene = vg.Scene.from_mapping(
        {
            "shape": [{"family": "sphere"}],
            "container": {"kind": "box", "lengths": [6, 6, 6]},
            "packing": {"method": "advancing_front", "solid_fraction": 0.62},
        }
    )
    assert "if all find room" in str(scene.plan())


def by_scene(**asked):
    base = {"shape": [{"family": "sphere"}], "container": BOX.to_mapping(), "packing": {"method": "rsa", **asked}}
    return vg.Scene.from_mapping(base).plan().grains


@pytest.mark.parametrize("share", [0.2, 0.25])
def test_a_porosity_and_a_void_ratio_say_the_same_as_a_solid_fraction(share):
    words = {"solid_fraction": share, "porosity": 1 - share, "void_ratio": 1 / share - 1}
    many = round(share * 64 / SPHERE.volume)
    for name, value in words.items():
        packing = pack(**{name: value})
        assert (packing.stop_reason, packing.count) == ("solid_fraction", pytest.approx(many, abs=1))
        assert by_scene(**{name: value}) == packing.count
        for parameters in (vg.methods.Compress, vg.methods.Gravity):
            held = parameters(**{name: value})
            assert (held.solid_fraction, held.porosity, held.void_ratio) == (pytest.approx(share), None, None)
    for call in (pack, by_scene, vg.methods.Compress, lambda **asked: vg.compress(pack(count=5), **asked)):
        with pytest.raises(vg.VoxgranError, match=r"porosity is 0\.8 and void_ratio is .*; give one"):
            call(porosity=0.8, void_ratio=4.0)
        with pytest.raises(vg.VoxgranError, match=r"at most 0\.9999"):
            call(porosity=1.0)
