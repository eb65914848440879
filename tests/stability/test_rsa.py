"""Random sequential addition at its ends: sizes a thousand to one, one grain, no room to spare, other units."""

import subprocess
import sys

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")


@pytest.mark.parametrize("until", ["tries", "saturated"])
@pytest.mark.parametrize("order", ["given", "largest"])
@pytest.mark.filterwarnings("ignore:.*grains were placed before the method stopped")
def test_sizes_a_thousand_to_one(until, order):
    """Large grains between small ones and small ones between large ones; each level has cells of its own."""
    sizes = vg.sizes.discrete([1000.0, 1.0], [1, 400])
    for shape, room, many in ((DISK, vg.Rectangle((3000, 3000), "x"), 1600), (SPHERE, vg.Box((1500,) * 3), 3000)):
        packing = vg.pack(shape, room, method="rsa", count=many, sizes=sizes, order=order, until=until, seed=3)
        large = packing.diameters > 500
        assert large.any() or order == "given"
        # only large ones find no place
        assert many - packing.count == packing.provenance["missed"]["count"] <= 8
        assert np.count_nonzero(~large) > 0.99 * many
        assert vg.verify(packing).ok


@pytest.mark.parametrize("until", ["tries", "saturated"])
@pytest.mark.parametrize(
    "room", [vg.Box((1, 1, 1)), vg.Box((1, 1, 1), "xyz"), vg.Box((1, 1, 2.5)), vg.Cylinder(0.5, 1), vg.Box((1, 5, 4))]
)
def test_a_container_of_one_grains_size(room, until):
    packing = vg.pack(SPHERE, room, method="rsa", until=until, count=1)
    assert packing.count == 1
    assert packing.stop_reason == "count"
    assert vg.verify(packing).ok
    with pytest.warns(PackingWarning):
        more = vg.pack(SPHERE, room, method="rsa", until=until, count=40, tries=50)
    assert more.stop_reason == ("steps" if until == "tries" else "saturated")
    assert vg.verify(more).ok


@pytest.mark.parametrize("radius", [1e-9, 1e9])
def test_units_do_not_matter(radius):
    """The same packing at any unit, to rounding: nothing is compared with an absolute length."""
    found = []
    for size in (1.0, 2 * radius):
        box = vg.Box(np.array([6.0, 6, 7]) * size, "x", origin=np.array([1.0, -2, 0.5]) * size)
        for how in ({"until": "saturated"}, {"scheme": "3", "tries": 20}, {"scheme": "4a", "tries": 20}):
            packing = vg.pack(SPHERE.scaled(size), box, method="rsa", seed=1, **how)
            assert vg.verify(packing).ok
            found.append(packing.position / size)
    for one, other in zip(found[:3], found[3:], strict=True):
        assert one == pytest.approx(other, abs=1e-9)


def test_coincident_starts_are_refused_and_a_full_start_is_saturated():
    two = vg.Packing.of([SPHERE], vg.Box((4, 4, 4)), position=[(1, 1, 1), (1, 1, 1)])
    with pytest.raises(InputError, match="grain 1 of start finds no place"):
        vg.pack([], two.container, method="rsa", start=two)
    ticks = np.arange(4) + 0.5
    lattice = np.array(np.meshgrid(ticks, ticks, ticks)).reshape(3, -1).T
    full = vg.Packing.of([SPHERE], vg.Box((4, 4, 4), "xyz"), position=lattice)
    # between spheres that touch on a cubic lattice there is no room for another
    with pytest.warns(PackingWarning):
        packing = vg.pack(SPHERE, full.container, method="rsa", start=full, count=1, until="saturated")
    assert packing.count == 64
    assert packing.stop_reason == "saturated"


def test_no_numbers_repeat_in_a_long_sorted_run():
    """The congruential sequence has 65536 numbers; the default has no such cycle."""
    packing = vg.pack(DISK, vg.Rectangle((40, 40)), method="rsa", scheme="4a", tries=50, seed=1)
    assert len(np.unique(packing.position[:, 0])) == packing.count


MILLION = """
import math, resource, sys
import voxgran as vg

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024

name, share, count, options = sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), eval(sys.argv[4])
shape = vg.make_shape(name)
def pack(many):
    edge = (many * shape.volume / share) ** (1 / shape.dimension)
    room = vg.Rectangle((edge,) * 2, "xy") if name == "disk" else vg.Box((edge,) * 3, "xyz")
    # with proof no count is given: candidates fill the container
    return vg.pack(shape, room, method="rsa", **({} if "until" in options else {"count": many}), **options)
pack(300)
before = peak()
packing = pack(count)
print(packing.count, (peak() - before) / packing.count, packing.stop_reason)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "share", "options"),
    [
        ("sphere", 0.28, {"tries": 200}),
        ("sphere", 0.3841, {"until": "saturated"}),
        ("disk", 0.5471, {"until": "saturated"}),
    ],
)
def test_a_million_take_300_bytes_each(name, share, options):
    """Whole packings, with what a proof takes; the first run compiles, which takes memory of its own."""
    for many in (1000, 1_000_000):
        command = [sys.executable, "-W", "ignore", "-c", MILLION, name, str(share), str(many), repr(options)]
        run = subprocess.run(command, capture_output=True, text=True, check=True)
    count, each, reason = run.stdout.split()
    assert int(count) > 980_000
    assert float(each) < 300
    assert reason == "saturated" or "until" not in options
