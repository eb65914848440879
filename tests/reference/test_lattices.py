"""Sphere and disk lattices: their solid fractions and coordination numbers are closed formulas."""

import itertools
import math

import numpy as np
import pytest
from kit import references, slow

from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.measures.registered.coordination import coordination_number
from voxgran.measures.registered.density import bulk_solid_fraction, window_solid_fraction
from voxgran.measures.registered.profile import axis_profile
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

LATTICES = references("lattice")
EDGES = {"fcc": math.sqrt(2), "bcc": 2 / math.sqrt(3), "simple_cubic": 1.0}
BASES = {
    "fcc": [(0, 0, 0), (0, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 0.5, 0)],
    "bcc": [(0, 0, 0), (0.5, 0.5, 0.5)],
    "simple_cubic": [(0, 0, 0)],
}
CELLS = {"fcc": 3, "bcc": 3, "simple_cubic": 4}


def lattice(name, *, gap=0.0):
    """Return spheres of diameter 1 on a lattice in a periodic box, with `gap` between neighbours."""
    cells = np.stack(np.meshgrid(*[np.arange(CELLS[name])] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    edge = EDGES[name] * (1 + gap)
    position = (cells + np.array(BASES[name])).reshape(-1, 3) * edge
    box = Box((CELLS[name] * edge,) * 3, periodic=(True, True, True))
    return Packing.of([Shape.of(Primitive("sphere", (0.5,)), name="sphere")], box, position=position)


def hexagonal(*, gap=0.0):
    """Return disks of diameter 1 on a hexagonal lattice in a periodic rectangle."""
    rows, columns = 6, 5
    step = 1 + gap
    x, y = np.meshgrid(np.arange(columns), np.arange(rows), indexing="xy")
    position = np.stack([(x + 0.5 * (y % 2)) * step, y * step * math.sqrt(3) / 2, 0 * x], axis=-1)
    sides = Rectangle((columns * step, rows * step * math.sqrt(3) / 2), periodic=(True, True))
    disk = Shape.of(Outline("disk", radius=0.5), name="disk")
    return Packing.of([disk], sides, position=position.reshape(-1, 3))


def half_disk(x, radius):
    """Return the area of a half-disk from its middle to x."""
    angle = math.asin(max(-1.0, min(1.0, x / radius)))
    return (x * math.sqrt(max(0.0, radius**2 - x**2)) + radius**2 * angle) / 2


def slice_area(radius, sides):
    """Return the area of a disk at the origin inside a rectangle, by the chords at each x: a test's own formula."""
    x0, x1, y0, y1 = sides
    x0, x1 = max(x0, -radius), min(x1, radius)
    if x0 >= x1:
        return 0.0
    # between these x the chord is bounded by the same two of circle and rectangle
    marks = {x0, x1}
    for y in (y0, y1):
        if abs(y) < radius:
            reach = math.sqrt(radius**2 - y**2)
            marks |= {x for x in (-reach, reach) if x0 < x < x1}
    marks = sorted(marks)
    total = 0.0
    for a, b in itertools.pairwise(marks):
        rise = math.sqrt(max(0.0, radius**2 - ((a + b) / 2) ** 2))
        if min(y1, rise) <= max(y0, -rise):
            continue
        arc = half_disk(b, radius) - half_disk(a, radius)
        total += (arc if rise < y1 else y1 * (b - a)) - (-arc if -rise > y0 else y0 * (b - a))
    return total


def sphere_volume(center, radius, low, high):
    """Return the volume of a sphere inside a box, by quadrature between all heights where a slice changes."""
    z0, z1 = max(low[2] - center[2], -radius), min(high[2] - center[2], radius)
    if z0 >= z1:
        return 0.0
    sides = (low[0] - center[0], high[0] - center[0], low[1] - center[1], high[1] - center[1])
    reaches = [abs(s) for s in sides] + [math.hypot(x, y) for x in sides[:2] for y in sides[2:]]
    heights = {math.sqrt(radius**2 - s**2) for s in reaches if s < radius}
    marks = sorted({z0, z1} | {z for h in heights for z in (-h, h) if z0 < z < z1})
    nodes, weights = np.polynomial.legendre.leggauss(48)
    total = 0.0
    for a, b in itertools.pairwise(marks):
        # all ends are half-integer powers at worst, which the sine makes smooth
        z = (a + b) / 2 + (b - a) / 2 * np.sin(np.pi / 2 * nodes)
        scale = (b - a) / 2 * np.pi / 2 * np.cos(np.pi / 2 * nodes) * weights
        areas = [slice_area(math.sqrt(max(0.0, radius**2 - h**2)), sides) for h in z]
        total += float(np.dot(scale, areas))
    return total


def window_volume(packing, low, high):
    """Return the volume of spheres and their images in a window, one by one."""
    period = packing.container.bounds[1] - packing.container.bounds[0]
    total = 0.0
    for center in packing.position:
        first = np.floor((low - 0.5 - center) / period).astype(int)
        last = np.ceil((high + 0.5 - center) / period).astype(int)
        for turn in np.ndindex(*(last - first + 1)):
            moved = center + (first + turn) * period
            if ((moved + 0.5 > low) & (moved - 0.5 < high)).all():
                inside = ((moved - 0.5 >= low) & (moved + 0.5 <= high)).all()
                total += math.pi / 6 if inside else sphere_volume(moved, 0.5, low, high)
    return total


@pytest.mark.parametrize("name", EDGES)
def test_solid_fraction_is_the_closed_formula(name):
    packing, wanted = lattice(name), LATTICES[name]["value"]
    assert len(BASES[name]) == LATTICES[name]["per_cell"]
    assert packing.solid_fraction == pytest.approx(wanted, rel=1e-12)
    assert bulk_solid_fraction(packing) == pytest.approx(wanted, rel=1e-12)
    assert axis_profile(packing, "x", bins=7).solid_fraction.mean() == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("name", EDGES)
def test_any_window_of_one_cell_holds_the_closed_formula(name):
    packing, generator = lattice(name), stream(1, "cell windows")
    for _ in range(100):
        low = generator.uniform(-10, 10, 3)
        found = window_solid_fraction(packing, low, low + EDGES[name] * generator.integers(1, 4, 3))
        assert found == pytest.approx(LATTICES[name]["value"], rel=1e-12)
        assert found.error == 0.0


@pytest.mark.parametrize("name", [name if name == "bcc" else slow(name) for name in EDGES])
def test_windows_that_cut_spheres_agree_with_quadrature(name):
    packing, generator = lattice(name), stream(2, "windows")
    for _ in range(34):
        low = generator.uniform(-3, 3, 3)
        high = low + generator.uniform(0.2, 2.0, 3)
        found = window_solid_fraction(packing, low, high) * np.prod(high - low)
        assert found == pytest.approx(window_volume(packing, low, high), rel=1e-12, abs=1e-13)


def test_the_quadrature_of_this_file_is_good():
    assert sphere_volume(np.zeros(3), 1.0, [-2, -2, 0], [2, 2, 2]) == pytest.approx(2 * math.pi / 3, rel=1e-13)
    assert sphere_volume(np.zeros(3), 1.0, [-2, -2, 0.5], [2, 2, 2]) == pytest.approx(5 * math.pi / 24, rel=1e-13)
    assert sphere_volume(np.zeros(3), 1.0, [0, 0, 0], [2, 2, 2]) == pytest.approx(math.pi / 6, rel=1e-13)
    assert sphere_volume(np.zeros(3), 1.0, [-0.5] * 3, [0.5] * 3) == pytest.approx(1.0, rel=1e-13)


@pytest.mark.parametrize("name", EDGES)
def test_coordination_number_across_periodic_faces(name):
    neighbours = LATTICES[name]["neighbours"]
    gap = 1e-6
    found = coordination_number(lattice(name, gap=gap), [0, gap * (1 - 0.01), gap * (1 + 0.01), 1e-3])
    assert found.mean.tolist() == [0, 0, neighbours, neighbours]
    assert (found.of_grain == neighbours).all()
    touching = coordination_number(lattice(name), [0.0])
    assert touching.mean.tolist() == [neighbours]


def test_disks():
    packing = hexagonal()
    wanted = LATTICES["hexagonal_disks"]
    assert packing.solid_fraction == pytest.approx(wanted["value"], rel=1e-12)
    found = coordination_number(hexagonal(gap=1e-6), [0.9e-6, 1.1e-6])
    assert found.mean.tolist() == [0, wanted["neighbours"]]
    generator = stream(3, "disks")
    for _ in range(100):
        low = generator.uniform(-9, 9, 2)
        found = window_solid_fraction(packing, low, low + np.array([1, math.sqrt(3)]) * generator.integers(1, 4, 2))
        assert found == pytest.approx(wanted["value"], rel=1e-12)


def test_disks_in_windows_agree_with_chords():
    packing, generator = hexagonal(), stream(4, "disks")
    period = packing.container.bounds[1] - packing.container.bounds[0]
    for _ in range(50):
        low = generator.uniform(0, 3, 2)
        high = low + generator.uniform(0.1, 3, 2)
        total = 0.0
        for turn in np.ndindex(3, 3):
            moved = packing.position[:, :2] + (np.array(turn) - 1) * period[:2]
            total += sum(slice_area(0.5, (low[0] - x, high[0] - x, low[1] - y, high[1] - y)) for x, y in moved)
        assert window_solid_fraction(packing, low, high) * np.prod(high - low) == pytest.approx(total, rel=1e-12)
