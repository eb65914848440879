import itertools
import math

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.shapes.sphere_union import _patch_sums, contained, union_moments


def disk_union(centers, radii):
    """Area and first moments of a union of disks: Green's theorem over its boundary arcs, in plain Python."""
    keep = [
        i
        for i in range(len(radii))
        if not any(
            j != i and math.dist(centers[i], centers[j]) <= radii[j] - radii[i] and (radii[j] > radii[i] or j < i)
            for j in range(len(radii))
        )
    ]
    total = np.zeros(3)
    for i in keep:
        hidden = []
        for j in keep:
            d = math.dist(centers[i], centers[j])
            if j != i and abs(radii[i] - radii[j]) < d < radii[i] + radii[j]:
                middle = math.atan2(centers[j][1] - centers[i][1], centers[j][0] - centers[i][0])
                half = math.acos((d * d + radii[i] ** 2 - radii[j] ** 2) / (2 * d * radii[i]))
                hidden.append(((middle - half) % (2 * math.pi), 2 * half))
        reach = max((a + w - 2 * math.pi for a, w in hidden), default=0.0)
        arcs = []
        for a, w in sorted(hidden):
            if a > reach:
                arcs.append((reach, a))
            reach = max(reach, a + w)
        (x, y), r = centers[i], radii[i]
        for a, b in arcs if hidden else [(0.0, 2 * math.pi)]:
            t = (a + b) / 2 + (b - a) / 2 * NODES
            c, s, w = np.cos(t), np.sin(t), WEIGHTS * (b - a) / 2
            px, py = x + r * c, y + r * s
            total += [
                (w * (px * r * c + py * r * s)).sum() / 2,
                (w * px**2 * r * c).sum() / 2,
                (w * py**2 * r * s).sum() / 2,
            ]
    return total


NODES, WEIGHTS = np.polynomial.legendre.leggauss(30)


def slice_union(centers, radii):
    """Volume and first moments of a union of spheres from its slices, cut where the slices change their form."""
    heights = [z + s * r for (_, _, z), r in zip(centers, radii, strict=True) for s in (-1, 1)]
    for i, j in itertools.combinations(range(len(radii)), 2):
        w = centers[j] - centers[i]
        d = np.linalg.norm(w)
        x = (d * d + radii[i] ** 2 - radii[j] ** 2) / (2 * d)
        if abs(x) < radii[i]:
            rise = math.sqrt(radii[i] ** 2 - x * x) * math.sqrt(max(1 - (w[2] / d) ** 2, 0))
            heights += [centers[i][2] + x * w[2] / d + s * rise for s in (-1, 1)]
    for i, j, k in itertools.combinations(range(len(radii)), 3):
        a = np.array([centers[j] - centers[i], centers[k] - centers[i]])
        b = (np.einsum("ij,ij->i", a, a) + radii[i] ** 2 - radii[[j, k]] ** 2) / 2
        foot = np.linalg.lstsq(a, b, rcond=None)[0]
        square = radii[i] ** 2 - foot @ foot
        if square > 0:
            normal = np.cross(*a) / np.linalg.norm(np.cross(*a))
            heights += [centers[i][2] + foot[2] + s * math.sqrt(square) * normal[2] for s in (-1, 1)]
    events = np.unique(heights)
    total = np.zeros(4)
    for low, high in itertools.pairwise(events):
        for t, w in zip(NODES, WEIGHTS, strict=True):
            # the sine takes away the square roots at both ends
            z = (low + high) / 2 + (high - low) / 2 * math.sin(math.pi / 2 * t)
            h = w * (high - low) / 2 * math.pi / 2 * math.cos(math.pi / 2 * t)
            here = [
                (c[:2], math.sqrt(r * r - (z - c[2]) ** 2))
                for c, r in zip(centers, radii, strict=True)
                if abs(z - c[2]) < r
            ]
            if here:
                area, mx, my = disk_union([c for c, _ in here], [r for _, r in here])
                total += np.array([area, mx, my, z * area]) * h
    return total


def revolved_union(places, radii):
    """Volume, area and moments of spheres along the z axis: piecewise polynomials, integrated exactly."""
    cuts = [z + s * r for z, r in zip(places, radii, strict=True) for s in (-1, 1)]
    for (a, r), (b, s) in itertools.combinations(zip(places, radii, strict=True), 2):
        if a != b:
            cuts.append((b * b - a * a + r * r - s * s) / (2 * (b - a)))
    volume = area = first = across = along = 0.0
    for low, high in itertools.pairwise(np.unique(cuts)):
        z = (low + high) / 2 + (high - low) / 2 * NODES
        w = WEIGHTS * (high - low) / 2
        squares = np.array([r * r - (z - a) ** 2 for a, r in zip(places, radii, strict=True)])
        best = squares.max(axis=0)
        if best[len(z) // 2] <= 0:
            continue
        volume += (w * math.pi * best).sum()
        first += (w * math.pi * best * z).sum()
        along += (w * math.pi * best * z * z).sum()
        across += (w * math.pi * best**2 / 4).sum()
        area += 2 * math.pi * radii[squares[:, len(z) // 2].argmax()] * (high - low)
    return volume, area, first, across, along


@pytest.mark.parametrize("seed", range(3))
def test_random_spheres_agree_with_their_slices(seed):
    generator = stream(seed, "spheres")
    centers = generator.random((5, 3)) * 1.2
    radii = 0.3 + 0.4 * generator.random(5)
    volume, first, _, _ = union_moments(centers, radii)
    assert np.array([volume, *first]) == pytest.approx(slice_union(centers, radii), rel=2e-10)


@pytest.mark.parametrize(
    ("places", "radii"),
    [
        ([0.0], [1.0]),
        ([-0.5, 0.5], [1.0, 1.0]),
        ([-0.5, 0.6], [1.0, 0.3]),
        ([-1.0, 1.0], [1.0, 1.0]),
        ([-1.0, 1.0 - 1e-9], [1.0, 1.0]),
        ([-2.0, 2.0], [1.0, 0.5]),
        ([-0.9, -0.4, 0.0, 0.3, 1.1], [0.5, 0.8, 0.9, 0.4, 0.7]),
        ([0.0, 1e-9], [1.0, 1.0]),
    ],
)
def test_spheres_on_a_line_are_bodies_of_revolution(places, radii):
    volume, area, first, across, along = revolved_union(np.array(places), np.array(radii))
    turn = rotation_matrices(random_rotations(stream(1, "turn"), 1))[0]
    centers = np.column_stack([np.zeros(len(places)), np.zeros(len(places)), places]) @ turn.T
    got = union_moments(np.ascontiguousarray(centers), np.array(radii))
    size = volume * (np.abs(places).max() + max(radii)) ** 2
    assert got[0] == pytest.approx(volume, rel=1e-13)
    assert got[3] == pytest.approx(area, rel=1e-13)
    assert got[1] == pytest.approx(turn @ [0, 0, first], abs=1e-13 * size)
    assert got[2] == pytest.approx(turn @ np.diag([across, across, along]) @ turn.T, abs=1e-13 * size)


CUBE = np.array(list(itertools.product([-0.5, 0.5], repeat=3)))
FCC = np.array([p for p in itertools.product(range(3), repeat=3) if sum(p) % 2 == 0], dtype=float) - 1
AXIS = np.array([-0.7, -0.2, 0.0, 0.3, 1.0])
NOISE = stream(0, "noise").standard_normal((18, 3))
DEGENERATE = {
    "eight spheres through one point": (CUBE, np.full(8, math.sqrt(3) / 2)),
    "circles that touch": (CUBE, np.full(8, math.sqrt(0.5))),
    "faces of a lattice": (FCC, np.full(14, 1.0)),
    "touching cluster": (FCC, np.full(14, math.sqrt(0.5))),
    "overlapping lattice": (FCC, np.full(14, 0.8)),
    "one common circle": (np.outer(AXIS, [0, 0, 1]), np.sqrt(1 + AXIS**2)),
    "common points": (NOISE[:9] * [1, 1, 0], np.sqrt(1 + (NOISE[:9, :2] ** 2).sum(axis=1))),
    "tangent in one point": (NOISE[:6] * [1, 1, 0], np.linalg.norm(NOISE[:6, :2], axis=1)),
    "third sphere touches a circle": (
        np.array([[0, 0, 0], [1, 0, 0], [0.5, math.sqrt(0.75) + 0.3, 0]]),
        np.array([1, 1, 0.3]),
    ),
    "nearly the same": (NOISE[:6] * 1e-10, 1 + 1e-10 * NOISE[6:12, 0]),
    "three times nearly the same": (
        NOISE * 1e-11 + np.repeat([[0, 0, 0], [1, 0, 0], [0.5, 0.8, 0]], 6, axis=0),
        1 + 1e-11 * NOISE[:, 0],
    ),
    "many": (NOISE, 1 + 0.3 * np.abs(NOISE[:, 0])),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_result_does_not_depend_on_the_frame_nor_on_the_order(name):
    centers, radii = DEGENERATE[name]
    volume, first, second, area = union_moments(centers, radii)
    assert 0 < volume < (4 / 3 * math.pi * radii**3).sum() * (1 + 1e-12)
    size = np.abs(centers).max() + radii.max()
    generator = stream(2, "frames")
    for turn in rotation_matrices(random_rotations(generator, 6)):
        order = generator.permutation(len(radii))
        got = union_moments(np.ascontiguousarray((centers @ turn.T)[order]), radii[order])
        assert got[0] == pytest.approx(volume, rel=2e-12)
        assert got[1] == pytest.approx(turn @ first, abs=2e-12 * volume * size)
        assert got[2] == pytest.approx(turn @ second @ turn.T, abs=2e-12 * volume * size**2)
        assert got[3] == pytest.approx(area, rel=2e-12)


def test_eight_spheres_through_one_point_have_the_volume_of_their_cells():
    # each sphere shows in its octant only, since the power cells of equal spheres are the octants
    radius = math.sqrt(3) / 2
    volume = union_moments(CUBE, np.full(8, radius))[0]
    assert volume == pytest.approx(8 * _octant_volume(0.5, radius), rel=1e-9)


def _octant_volume(distance, radius):
    """Volume of a sphere about (d, d, d) in x, y, z > 0, where its sphere passes through the origin."""
    cap = math.pi * (radius - distance) ** 2 * (2 * radius + distance) / 3
    # what lies beyond two of the planes, sliced across their common line; nothing lies beyond all three
    half = math.sqrt(radius**2 - 2 * distance**2)
    z = half * np.sin(math.pi / 2 * NODES)
    r = np.sqrt(radius**2 - z * z)
    reach = np.sqrt(r * r - distance**2)
    angle = np.arcsin(reach / r) - np.arcsin(distance / r)
    areas = r * r * angle / 2 - distance * (reach - distance)
    twice = (WEIGHTS * half * math.pi / 2 * np.cos(math.pi / 2 * NODES) * areas).sum()
    return 4 / 3 * math.pi * radius**3 - 3 * cap + 3 * twice


def test_contained_spheres_do_not_count():
    centers = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0, 0], [0.5, 0, 0], [2.5, 0, 0]])
    radii = np.array([1.0, 0.3, 1.0, 0.5, 0.5])
    assert contained(centers, radii).tolist() == [False, True, True, True, False]
    volume, _, _, area = union_moments(centers, radii)
    assert volume == pytest.approx(4 / 3 * math.pi * 1.125, rel=1e-14)
    assert area == pytest.approx(4 * math.pi * 1.25, rel=1e-14)


def test_a_cavity_has_a_surface():
    # spheres on all points of a 3 x 3 x 3 lattice but the middle one, just large enough to close the faces
    points = np.array(list(itertools.product([-1.0, 0.0, 1.0], repeat=3)))
    points = points[np.abs(points).sum(axis=1) > 0]
    radii = np.full(26, 0.75)
    hollow = union_moments(points, radii)
    filled = union_moments(np.vstack([points, np.zeros((1, 3))]), np.full(27, 0.75))
    larger = union_moments(np.vstack([points, np.zeros((1, 3))]), np.append(radii, 0.3))
    assert hollow[0] < filled[0]
    assert larger[0] == pytest.approx(hollow[0] + _left_over(0.3, 0.75), rel=1e-12)


def _left_over(small, large):
    """Volume of a sphere at the middle of six spheres at distance 1 that is outside of these."""
    if small + large <= 1:
        return 4 / 3 * math.pi * small**3
    lens = math.pi * (small + large - 1) ** 2
    lens *= 1 + 2 * (small + large) - 3 * (small**2 + large**2) + 6 * small * large
    return 4 / 3 * math.pi * small**3 - 6 * lens / 12


@pytest.mark.parametrize("power", [-20, 20])
def test_a_power_of_two_gives_the_same_bits(power):
    factor = 2.0**power
    one = union_moments(NOISE, 1 + np.abs(NOISE[:, 0]))
    two = union_moments(NOISE * factor, (1 + np.abs(NOISE[:, 0])) * factor)
    assert two[0] == one[0] * factor**3
    assert (two[1] == one[1] * factor**4).all()
    assert (two[2] == one[2] * factor**5).all()
    assert two[3] == one[3] * factor**2


def test_boundaries_close():
    centers, radii = NOISE, 1 + 0.3 * np.abs(NOISE[:, 0])
    assert _patch_sums(centers, radii)[1] < 1e-14
