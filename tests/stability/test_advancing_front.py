"""The advancing front where sizes, numbers and places are extreme."""

import itertools
import math
import tracemalloc

import numpy as np
import pytest
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
MODES = ("loose", "dense")

pytestmark = pytest.mark.filterwarnings("ignore:.*grains were placed before")


def pack(shape, container, **keywords):
    return vg.pack(shape, container, method="advancing_front", **keywords)


def residuals(packing, partners=3):
    """How far each sphere is from touching the nearest three, in what is promised: 1e-12 r and 8 units of the place."""
    r, p = packing.bounding_radii, packing.position
    allowed = 1e-12 * r + 8 * np.spacing(np.abs(p).max())
    worst = np.zeros(packing.count)
    for sphere in range(packing.count):
        gap = np.linalg.norm(p - p[sphere], axis=1) - r - r[sphere]
        gap[sphere] = np.inf
        worst[sphere] = np.sort(np.abs(gap))[partners - 1] / allowed[sphere]
    return worst


@pytest.mark.parametrize("mode", MODES)
def test_sizes_of_a_thousand_to_one(mode):
    sizes = vg.sizes.discrete([1.0, 0.03, 0.001], [0.02, 0.28, 0.7])
    packing = pack(SPHERE, vg.Box((9, 9, 9)), sizes=sizes, count=700, mode=mode, seed=2)
    assert packing.count == 700
    assert packing.diameters.max() == pytest.approx(1000 * packing.diameters.min())
    assert vg.verify(packing).ok
    if mode == "loose":
        # the first three touch two and all others three
        assert np.sort(residuals(packing))[:-3].max() <= 1
    gap = np.linalg.norm(packing.position[:, None] - packing.position, axis=2)
    gap -= packing.bounding_radii[:, None] + packing.bounding_radii
    np.fill_diagonal(gap, np.inf)
    smallest = packing.bounding_radii.min()
    assert gap.min() >= -(4e-12 * smallest + 32 * np.spacing(9.0))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_tiny_and_huge_units(mode, scale):
    sizes = vg.sizes.uniform(0.5, 1.5)
    packing = pack(SPHERE, vg.Box((12, 12, 12)), sizes=sizes, count=300, mode=mode)
    sphere, box = SPHERE.scaled(scale), vg.Box(np.array([12.0, 12, 12]) * scale)
    other = pack(sphere, box, sizes=vg.sizes.uniform(0.5 * scale, 1.5 * scale), count=300, mode=mode)
    assert vg.verify(other).ok
    assert residuals(other)[3:].max() <= 1
    np.testing.assert_allclose(other.position / scale, packing.position, atol=1e-8)


@pytest.mark.parametrize("scale", [0.25, 1024.0])
def test_a_scale_by_a_power_of_two_gives_the_same_bits(scale):
    one = pack(SPHERE, vg.Box((9, 9, 9)), count=200, mode="dense")
    other = pack(SPHERE.scaled(scale), vg.Box((9 * scale,) * 3), count=200, mode="dense")
    assert (other.position == one.position * scale).all()


@pytest.mark.parametrize("mode", MODES)
def test_one_grain_and_containers_of_its_size(mode):
    assert pack(SPHERE, vg.Box((4, 4, 4)), count=1, mode=mode).count == 1
    for container in (vg.Box((1, 1, 1)), vg.Cylinder(0.5, 1), vg.Box((1, 1, 1), "xyz")):
        packing = pack(SPHERE, container, count=1, mode=mode)
        assert packing.count == 1
        assert vg.verify(packing).ok
    alone = pack(DISK, vg.Rectangle((1, 1)), count=1, mode=mode)
    assert alone.count == 1
    assert vg.verify(alone).ok
    # room for three along a line, of which the first one is in the middle
    line = pack(SPHERE, vg.Box((1, 1, 3)), count=3, mode=mode)
    assert line.count == 3
    assert vg.verify(line).ok


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("tilt", [0.0, 1e-15, 1e-9, 1e-3])
def test_fronts_on_lattices_where_many_places_coincide(mode, tilt):
    """Spheres on a square lattice that touch: four at a time lie in a plane, and each place touches four or five."""
    ticks = np.arange(4) + 3.0
    lattice = np.array(list(itertools.product(ticks, ticks, [4.0])))
    lattice[:, 2] += tilt * lattice[:, 0] * lattice[:, 1]
    box = vg.Box((10, 10, 10))
    start = vg.Packing.of([SPHERE.scaled(0.9999)], box, position=lattice)
    packing = pack([], box, start=start, mode=mode)
    more = pack(SPHERE, box, start=start, count=120, mode=mode)
    assert packing.count == 16
    assert more.count == 136
    assert vg.verify(more).ok


def test_touching_lattices_go_on_without_overlap():
    """A face-centred cubic start: its pockets touch four to twelve spheres at once, to the last bit or not."""
    base = np.array([(0, 0, 0), (0, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 0.5, 0)]) * math.sqrt(2)
    cells = np.array(list(itertools.product(range(2), repeat=3))) * math.sqrt(2)
    places = (cells[:, None] + base).reshape(-1, 3) + 3
    box = vg.Box((9, 9, 9))
    packing = pack(SPHERE, box, start=vg.Packing.of([SPHERE], box, position=places), count=150, mode="dense")
    assert packing.count == 150 + len(places)
    assert vg.verify(packing).ok
    pairs = cKDTree(packing.position).query_pairs(1 + 1e-9)
    assert 2 * len(pairs) / packing.count > 5


def test_coincident_grains_of_a_start_are_refused():
    box = vg.Box((9, 9, 9))
    for position in ([(4, 4, 4), (4, 4, 4)], [(4, 4, 4), (4, 4, 4 + 1e-12)], [(4, 4, 4), (4, 4.9, 4)]):
        with pytest.raises(InputError, match="grain 1 of start finds no place"):
            pack(SPHERE, box, start=vg.Packing.of([SPHERE], box, position=position), count=3)


def test_far_from_the_origin():
    box = vg.Box((8, 8, 8), origin=(1e6, -1e6, 1e6))
    packing = pack(SPHERE, box, mode="dense")
    assert vg.verify(packing, tolerance=1e-9).ok
    near = pack(SPHERE, vg.Box((8, 8, 8)), mode="dense")
    np.testing.assert_allclose(packing.position - [1e6, -1e6, 1e6], near.position, atol=1e-9)


def test_a_long_thin_periodic_box():
    for mode in MODES:
        packing = pack(SPHERE, vg.Box((1.05, 1.7, 60), "xz"), mode=mode)
        assert vg.verify(packing).ok
        assert packing.count > 60


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_a_million_spheres_take_300_bytes_each(mode):
    tracemalloc.start()
    packing = pack(SPHERE, vg.Box((130, 130, 130)), count=1_000_000, mode=mode)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert packing.count == 1_000_000
    assert peak / packing.count <= 300
