"""The method `compress`: how many grains there are, the form of the container, what it shares with `vg.compress`."""

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError

SPHERE, ROCK = vg.shapes.sphere(), vg.make_shape("convex_polyhedron", seed=4, points=12)


@pytest.mark.parametrize(
    ("shape", "container", "options"),
    [
        (SPHERE, vg.Box((5, 5, 5), periodic="xyz"), {}),
        (SPHERE, vg.Box((5, 4, 6)), {"friction": 0.1}),
        (ROCK, vg.Box((5, 5, 5), periodic="xyz"), {"friction": 0.1}),
        slow(SPHERE, vg.Box((6, 6, 6), periodic="xyz"), {"solid_fraction": 0.61}),
        (vg.make_shape("disk"), vg.Rectangle((9, 7), periodic="xy"), {}),
    ],
)
def test_without_a_count_the_specimen_is_about_as_large_as_the_container(shape, container, options):
    specimen = vg.pack(shape, container, "compress", **options)
    assert specimen.stop_reason == "compressed"
    assert specimen.verify().ok
    assert specimen.container.volume == pytest.approx(container.volume, rel=0.1)
    assert specimen.solid_fraction == pytest.approx(options.get("solid_fraction", specimen.solid_fraction), abs=0.002)


def test_a_container_too_small_for_the_count_is_stretched():
    specimen = vg.pack(SPHERE, vg.Box((3, 3, 6), periodic="xyz"), "compress", count=150, friction=0.2)
    lengths = np.array(specimen.container.lengths)
    assert (specimen.count, specimen.stop_reason) == (150, "compressed")
    # of about the same form
    assert lengths / lengths[0] == pytest.approx((1, 1, 2), rel=0.1)
    listed = vg.pack(container=vg.Box((3, 3, 3), periodic="xyz"), method="compress", grains={"diameter": [1.0] * 60})
    assert sorted(listed.grain_id) == list(range(60))


@pytest.mark.slow
def test_axes_that_stay_are_those_of_the_container():
    specimen = vg.pack(SPHERE, vg.Cylinder(2.5, 5), "compress", axes="z", count=60)
    assert (specimen.count, specimen.container.radius) == (60, 2.5)
    assert specimen.container.height < 5
    # stretched along its axis alone, until the grains fill 0.3 of it
    path = specimen.measure("compression")["compression"]["path_solid_fraction"]
    assert path.values[0] == pytest.approx(0.3, abs=0.01)
    high = vg.pack(SPHERE, vg.Cylinder(2.5, 5), "compress", axes="z", height=6.0)
    assert high.container.height == pytest.approx(6.0, rel=0.005)
    # grains for that height, not for that of the container
    assert high.count == pytest.approx(60 * 6 / specimen.container.height, rel=0.15)


def test_it_is_the_compression_of_loose_grains(tmp_path):
    cube, sizes = vg.Box((4, 4, 4), periodic="xyz"), vg.sizes.lognormal(1.0, 0.2)
    specimen = vg.pack([SPHERE, ROCK], cube, "compress", count=50, sizes=sizes, friction=0.2, stress=(1, 1, 1.2))
    assert np.diag(specimen.forces.stress) == pytest.approx((1, 1, 1.2), rel=0.01)
    assert sorted(specimen.diameters) == pytest.approx(
        sorted(vg.pack([SPHERE, ROCK], vg.Box((9, 9, 9)), "rsa", count=50, sizes=sizes).diameters)
    )
    # the first step of the path begins where the grains fill 0.3 of the cell
    path = specimen.measure("compression")["compression"]["path_solid_fraction"]
    assert path.values[0] == pytest.approx(0.3, abs=0.01)
    loose = vg.pack(SPHERE, cube, "compress", count=50, fill=0.2)
    path = loose.measure("compression")["compression"]["path_solid_fraction"]
    assert path.values[0] == pytest.approx(0.2, abs=0.01)
    vg.save(specimen, tmp_path / "specimen.vtp")
    assert vg.load(tmp_path / "specimen.vtp") == specimen


@pytest.mark.parametrize(
    ("container", "options", "words"),
    [
        (
            vg.Box((4, 4, 4)),
            {"start": vg.pack(SPHERE, vg.Box((4, 4, 4)), "rsa", count=3)},
            "places all grains at random",
        ),
        (vg.ClosedMesh(vg.make_shape("polyhedron").scaled(4.0)), {}, "its walls do not move"),
        (vg.Box((4, 4, 4)), {"height": 3}, "it needs axes='z'"),
        (vg.Box((4, 4, 4)), {"settle": True}, "packs without gravity"),
        (vg.Box((4, 4, 4)), {"fill": 0.6}, "fill"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(container, options, words):
    with pytest.raises(InputError, match=words):
        vg.pack(SPHERE, container, "compress", **({"count": 10} | options))


def test_no_grains_and_open_surfaces():
    assert vg.pack(SPHERE, vg.Box((4, 4, 4)), "compress", count=0).count == 0
    with pytest.raises(InputError, match="open surface"):
        vg.pack(vg.make_shape("sheet"), vg.Box((4, 4, 4)), "compress", count=3)
