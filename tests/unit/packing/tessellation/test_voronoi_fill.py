"""The method voronoi_fill: solid fractions, gradations, containers, cells as grains."""

import warnings

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran.packing.draw import Request
from voxgran.packing.pack import prepare_task
from voxgran.shapes.sizes import size_distance

GRADED = vg.sizes.lognormal(1, 0.3)
BENT = vg.Polygon([(0, 0), (20, 0), (20, 8), (8, 8), (8, 16), (0, 16)])


def filled(shape, container, **options):
    """Return a packing that is proven to be free of overlap."""
    packing = vg.pack(shape, container, method="voronoi_fill", **options)
    proof = vg.verify(packing)
    assert proof.ok, proof.summary()
    return packing


def drawn_diameters(shape, container, **options):
    """Return the sizes that are drawn for the same request, sorted."""
    problem = prepare_task(Request(shape, container, "voronoi_fill", **options)).problem
    return np.sort(problem.diameter * problem.unit_length)


@pytest.mark.parametrize(
    ("shape", "container", "solid_fraction"),
    [
        (vg.make_shape("sphere"), vg.Box((6, 6, 6), "xyz"), 0.5),
        (vg.make_shape("box"), vg.Box((6, 6, 6)), 0.34),
        ([vg.make_shape("cone"), vg.make_shape("solid_union", seed=3)], vg.Box((6, 5, 6), "y"), 0.33),
        slow(vg.make_shape("ellipsoid"), vg.Cylinder(3, 6), 0.45),
        slow(vg.make_shape("sphere"), vg.Sphere(4), 0.45),
        (vg.make_shape("disk"), vg.Rectangle((15, 15), "x"), 0.74),
        (vg.make_shape("polygon"), vg.Disk(8), 0.55),
        (vg.make_shape("disk"), BENT, 0.6),
    ],
)
def test_a_solid_fraction_is_met_exactly_and_sizes_follow(shape, container, solid_fraction):
    packing = filled(shape, container, solid_fraction=solid_fraction, sizes=GRADED, seed=2)
    assert packing.solid_fraction == pytest.approx(solid_fraction, rel=1e-9)
    assert packing.stop_reason == "solid_fraction"
    told = packing.provenance["tessellation"]
    assert told["gradation_distance"] < 0.09
    assert told["volume_error"] < 0.021
    # the median grain has about the size that is asked for
    assert np.median(packing.diameters) == pytest.approx(1, abs=0.15)


def test_a_loose_packing_has_exactly_the_sizes_that_were_drawn():
    packing = filled(vg.make_shape("box"), vg.Box((7, 7, 7)), solid_fraction=0.2, sizes=GRADED, seed=5)
    told = packing.provenance["tessellation"]
    assert told["gradation_distance"] == 0
    assert told["factor"] == pytest.approx(1, abs=1e-12)
    counted = filled(vg.make_shape("box"), vg.Box((7, 7, 7)), count=60, sizes=GRADED, seed=5)
    drawn = drawn_diameters(vg.make_shape("box"), vg.Box((7, 7, 7)), count=60, sizes=GRADED, seed=5)
    assert np.sort(counted.diameters) == pytest.approx(drawn, rel=1e-9)
    assert counted.stop_reason == "count"


@pytest.mark.slow
def test_more_than_there_is_room_for_is_told_with_what_is_reached():
    with pytest.warns(PackingWarning, match=r"the solid fraction is 0\.\d+ instead of 0\.6"):
        packing = filled(vg.make_shape("box"), vg.Box((6, 6, 6)), solid_fraction=0.6, sizes=GRADED)
    assert 0.36 < packing.solid_fraction < 0.5
    assert packing.stop_reason == "full"
    with pytest.warns(PackingWarning, match=r"\d+ of 200 grains have sizes below those that were drawn"):
        short = filled(vg.make_shape("box"), vg.Box((6, 6, 6)), count=200, sizes=vg.sizes.fixed(1.03))
    assert short.count == 200
    assert short.diameters.max() == pytest.approx(1.03)
    assert short.diameters.min() < 1


def test_without_a_target_grains_are_as_large_as_their_cells_allow():
    packing = filled(vg.make_shape("sphere"), vg.Box((6, 6, 6), "xyz"), sizes=GRADED)
    assert packing.stop_reason == "full"
    assert 0.5 < packing.solid_fraction < 0.66
    assert vg.pack(vg.make_shape("sphere"), vg.Box((6, 6, 6)), method="voronoi_fill", count=0).count == 0


def test_smoothing_and_rounds_make_packings_denser():
    found = [
        filled(vg.make_shape("sphere"), vg.Box((6, 6, 6), "xyz"), sizes=GRADED, smoothing=m, rounds=n).solid_fraction
        for m, n in ((0, 0), (20, 0), (20, 8))
    ]
    assert found[1] > found[0] + 0.1
    assert found[2] > found[1] + 0.015


@pytest.mark.parametrize(
    ("container", "solid_fraction"),
    [
        slow(vg.Box((6, 6, 6), "xy"), 0.7),
        slow(vg.Box((6, 6, 6)), 0.999),
        slow(vg.Rectangle((15, 15), "xy"), 0.9),
        slow(vg.Cylinder(3, 6), 0.9),
        (vg.Disk(7), 0.9),
    ],
)
def test_cells_are_grains_of_any_solid_fraction(container, solid_fraction):
    shape = vg.make_shape("sphere" if container.dimension == 3 else "disk")
    packing = filled(shape, container, solid_fraction=solid_fraction, sizes=GRADED, fill="cells", seed=3)
    assert packing.solid_fraction == pytest.approx(solid_fraction, rel=1e-5)
    assert len(packing.shapes) == packing.count
    assert packing.stop_reason == "solid_fraction"
    told = packing.provenance["tessellation"]
    assert told["gradation_distance"] < 0.03
    # neighbours have parallel faces, and the gap between them is that of the shrinking
    gap = 1.5 * (1 - solid_fraction ** (1 / container.dimension))
    assert len(packing.contacts(gap).i) > packing.count


def test_cells_have_the_drawn_volumes():
    whole = filled(vg.make_shape("sphere"), vg.Box((6, 6, 6)), sizes=GRADED, fill="cells", seed=4)
    assert whole.solid_fraction == pytest.approx(1, abs=1e-5)
    # volumes are those of the draw, so that their distribution is that of many draws within the error of sampling
    drawn = GRADED.sample(20000, np.random.default_rng(0), dimension=3)
    assert size_distance(drawn, whole.diameters) < 1.4 / np.sqrt(whole.count)
    loose = filled(vg.make_shape("sphere"), vg.Box((6, 6, 6)), count=50, sizes=GRADED, fill="cells", seed=4)
    drawn = drawn_diameters(vg.make_shape("sphere"), vg.Box((6, 6, 6)), count=50, sizes=GRADED, seed=4)
    assert np.sort(loose.diameters) == pytest.approx(drawn, rel=1e-4)


def test_units_and_density_of_cells():
    shape = vg.make_shape("sphere", diameter=2.0)
    packing = filled(shape, vg.Box((9, 9, 9)), count=60, fill="cells", unit="mm", density=2.5)
    assert packing.unit == "mm"
    assert packing.density == 2.5
    assert packing.diameters == pytest.approx(2, rel=1e-4)
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        thousand = filled(vg.make_shape("sphere", diameter=2048.0), vg.Box((9216,) * 3), count=60, fill="cells")
    assert thousand.position / 1024 == pytest.approx(packing.position, abs=1e-9)


def test_grains_of_cells_survive_a_file(tmp_path):
    packing = filled(vg.make_shape("disk"), vg.Rectangle((5, 5)), solid_fraction=0.8, fill="cells")
    vg.save(packing, tmp_path / "cells.vtp")
    assert vg.load(tmp_path / "cells.vtp") == packing


def test_what_is_refused():
    start = vg.pack(vg.make_shape("sphere"), vg.Box((5, 5, 5)), method="voronoi_fill", count=5)
    with pytest.raises(InputError, match="start has 5 grains, and method 'voronoi_fill' fills the whole container"):
        vg.pack([], vg.Box((5, 5, 5)), method="voronoi_fill", start=start)
    for name, value in (("smoothing", -1), ("orientations", 0), ("rounds", -1), ("fill", "air")):
        with pytest.raises(InputError, match=name):
            vg.pack(vg.make_shape("sphere"), vg.Box((5, 5, 5)), method="voronoi_fill", count=5, **{name: value})


def test_cells_of_spheres_are_denser_than_any_spheres():
    sphere = vg.make_shape("sphere")
    packing = vg.pack(sphere, vg.Box((4, 4, 4)), "voronoi_fill", fill="cells", solid_fraction=0.9)
    assert packing.solid_fraction == pytest.approx(0.9, abs=1e-9)
    with pytest.raises(InputError, match="densest lattice"):
        vg.pack(sphere, vg.Box((4, 4, 4)), "voronoi_fill", solid_fraction=0.9)
