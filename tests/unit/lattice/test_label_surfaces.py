"""Surfaces of all labels of an image: closed, shared, without crossings, with the volume of the voxels."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, Voronoi, cKDTree

from voxgran._base.seeds import stream
from voxgran.geometry.crossing import count_crossings
from voxgran.geometry.triangles import areas_of, enclosed_volume
from voxgran.lattice.census import census
from voxgran.lattice.label_net import BEYOND, net_of, split_of, triangles_of
from voxgran.lattice.label_pieces import tiles_of
from voxgran.lattice.label_surfaces import STEPS, _smoothed, label_surfaces
from voxgran.shapes.shells import edge_faults

EVEN = np.ones(3)


def surfaces_of(image, *, periodic="", smoothing=1.0, spacing=EVEN):
    """Return the surfaces, and vertices in lengths and triangles of each label."""
    labels = np.array(image, dtype=np.int32, order="C")
    wraps = np.array([axis in periodic for axis in "xyz"])
    count = int(labels.max())
    made = label_surfaces(labels, count, wraps=wraps, smoothing=smoothing, spacing=spacing)
    return made, {k: (made.of(k)[0] * spacing, made.of(k)[1]) for k in range(1, count + 1)}


def noise(seed, shape=(6, 7, 5), labels=3):
    """Return an image in which every label meets every other in faces, edges and corners."""
    image = stream(seed, "labels").integers(0, labels + 1, shape)
    image.ravel()[: labels + 1] = range(labels + 1)
    return image


def cells(n, count, *, reach=np.inf, seed=0, torus=True):
    """Return an image of the cells of random points, cut at a distance from them, and the points."""
    points = stream(seed, "cells").random((count, 3)) * n
    places = np.stack(np.indices((n, n, n)), axis=-1).reshape(-1, 3) + 0.5
    distance, nearest = cKDTree(points, boxsize=n if torus else None).query(places)
    return np.where(distance <= reach, nearest + 1, 0).reshape(n, n, n), points


def test_labels_are_numbered_in_one_order_of_axes():
    image = np.asfortranarray(noise(0))
    numbers = census(image).numbered(image)
    assert numbers.flags.c_contiguous
    assert np.array_equal(numbers, image)


@given(seed=st.integers(0, 10**6), labels=st.integers(1, 4), smoothing=st.sampled_from([0.0, 0.4, 1.0]))
def test_surfaces_of_any_image_are_closed_and_do_not_cross(seed, labels, smoothing):
    image = noise(seed, labels=labels)
    _, found = surfaces_of(image, smoothing=smoothing)
    vertices, faces = [], []
    for points, triangles in found.values():
        assert edge_faults(triangles, len(points)).tolist() == [0, 0, 0]
        faces.append(triangles + sum(map(len, vertices)))
        vertices.append(points)
        assert len(np.unique(triangles)) == len(points)
    # coincident vertices are one, so that triangles that share them count as neighbours
    together, index = np.unique(np.concatenate(vertices), axis=0, return_inverse=True)
    assert count_crossings(together, index.ravel()[np.concatenate(faces)]) == 0


@pytest.mark.parametrize("smoothing", [0.0, 1.0])
def test_neighbours_share_their_triangles_and_leave_nothing_between_them(smoothing):
    image, _ = cells(14, 5, torus=False)
    _, found = surfaces_of(image, smoothing=smoothing)
    count = {}
    for points, triangles in found.values():
        for face in points[triangles].tolist():
            key = tuple(sorted(map(tuple, face)))
            count[key] = count.get(key, 0) + 1
    # what bounds one label only lies in the border of the image, which all of them cover
    outside = np.array([key for key, times in count.items() if times == 1])
    assert set(count.values()) == {1, 2}
    flat = (outside == outside[:, :1]).all(axis=1) & ((outside[:, 0] == 0) | (outside[:, 0] == 14))
    assert flat.any(axis=1).all()
    assert areas_of(outside).sum() == pytest.approx(6 * 14**2)
    assert sum(enclosed_volume(*part) for part in found.values()) == pytest.approx(14**3)


@pytest.mark.parametrize("spacing", [EVEN, np.array([1.0, 1.0, 2.0])])
def test_each_label_has_the_volume_of_its_voxels(spacing):
    image, _ = cells(30, 14, reach=8.0)
    _, found = surfaces_of(image, periodic="xyz", spacing=spacing)
    for label, part in found.items():
        assert enclosed_volume(*part) == pytest.approx((image == label).sum() * spacing.prod(), rel=2e-6)


def test_faces_between_labels_are_those_that_plain_numpy_counts():
    image = noise(5, (7, 6, 8))
    net = net_of(image.astype(np.int32), tiles_of(image, 3, np.array([False, True, False])))
    pairs = []
    for axis in range(3):
        mode = {"mode": "wrap"} if axis == 1 else {"constant_values": BEYOND}
        planes = np.moveaxis(np.pad(image, [(int(axis == k),) * 2 for k in range(3)], **mode), axis, 0)
        # along a periodic axis the first face is also the last one
        low, high = planes[int(axis == 1) : -1], planes[1 + int(axis == 1) :]
        seen = (low != high) & ((low > 0) | (high > 0))
        pairs += [(axis, int(a), int(b)) for a, b in zip(low[seen], high[seen], strict=True)]
    assert sorted(zip(net.axis.tolist(), *net.side.T.tolist(), strict=True)) == sorted(pairs)


def test_smoothing_is_that_of_plain_numpy():
    image, _ = cells(14, 5, reach=6.0)
    net = net_of(image.astype(np.int32), tiles_of(image, 5, np.zeros(3, dtype=bool)))
    held = (net.at == 0) | (net.at == 14)
    factors = np.array(STEPS * 4, dtype=np.float32)
    moved = np.zeros((len(net.at), 3))
    lines = [bin(bits).count("1") >= 2 for bits in net.triple]
    for factor in factors:
        new = moved.copy()
        for v, line in enumerate(lines):
            halves = [h for h in range(6) if net.near[v, h] >= 0 and (not line or net.triple[v] >> h & 1)]
            ends = [moved[net.near[v, h]] + (2 * (h % 2) - 1) * np.eye(3)[h // 2] for h in halves]
            new[v] = np.clip(moved[v] + factor * (np.mean(ends, axis=0) - moved[v]), -0.5, 0.5) * ~held[v]
        moved = new
    np.testing.assert_allclose(_smoothed(net.near, net.triple, held, factors, np.float32(0.5)), moved, atol=2e-6)


@pytest.mark.parametrize("periodic", ["x", "yz", "xyz"])
def test_a_shift_along_periodic_axes_changes_nothing(periodic):
    image, _ = cells(18, 6, reach=7.0)
    shift = [5 if axis in periodic else 0 for axis in "xyz"]
    _, one = surfaces_of(image, periodic=periodic)
    _, two = surfaces_of(np.roll(image, shift, axis=(0, 1, 2)), periodic=periodic)
    for label in one:
        (a, f), (b, g) = one[label], two[label]
        step = (b.mean(axis=0) - a.mean(axis=0) - shift) / 18
        np.testing.assert_allclose(step, np.round(step), atol=1e-6)
        assert areas_of(a[f]).sum() == pytest.approx(areas_of(b[g]).sum(), rel=1e-4)
        assert len(f) == len(g)


@pytest.mark.parametrize("smoothing", [0.0, 1.0])
def test_a_bar_that_winds_around_the_torus_is_cut_in_the_periodic_face(smoothing):
    image = np.zeros((8, 6, 6), int)
    image[:, 2:4, 2:4] = 1
    points, triangles = surfaces_of(np.roll(image, 3, axis=0), periodic="x", smoothing=smoothing)[1][1]
    assert enclosed_volume(points, triangles) == pytest.approx(32, rel=2e-6)
    # lattice lines are straight up to the ends, of which the upper one repeats the lower one
    rings = [points[np.abs(points[:, 0] - x) < 1e-4, 1:] for x in range(9)]
    rings = [ring[np.lexsort(ring.T.round(3))] for ring in rings]
    assert [len(ring) for ring in rings] == [9, *[8] * 7, 9]
    assert np.array_equal(rings[0], rings[8])
    middle = np.delete(rings[0], 4, axis=0)
    assert rings[0][4].tolist() == [3, 3]
    assert np.abs(np.array(rings[1:8]) - middle).max() < 1e-4


@pytest.mark.parametrize("smoothing", [0.0, 1.0])
@pytest.mark.parametrize("shift", range(0, 8, 3))
def test_a_bar_that_is_longer_than_the_image_but_does_not_meet_itself_is_whole(smoothing, shift):
    tall = np.zeros((16, 9, 5), int)
    tall[1:8, 1:3, 1:3], tall[6:8, 1:8, 1:3], tall[6:13, 6:8, 1:3] = 1, 1, 1
    # voxels that meet in edges, whose first one begins in a corner with a single fan
    tall[8:10, 6, 2] = tall[8:10, 7, 1] = 0
    wound = np.roll(tall[:8] + tall[8:], shift, axis=0)
    (_, expected), (_, found) = (
        surfaces_of(image, periodic=axes, smoothing=smoothing) for image, axes in ((tall, ""), (wound, "x"))
    )
    (points, triangles), (others, faces) = expected[1], found[1]
    assert len(others) == len(points)
    assert edge_faults(faces, len(others)).tolist() == [0, 0, 0]
    step = others.mean(axis=0) - points.mean(axis=0)
    assert step == pytest.approx(np.round(step), abs=1e-5)
    assert cKDTree(others).query(points + np.round(step))[0].max() < 1e-4
    assert areas_of(others[faces]).sum() == pytest.approx(areas_of(points[triangles]).sum(), rel=1e-5)


@pytest.mark.parametrize(("across", "bound"), [(10, 0.02), (20, 0.01)])
def test_areas_of_spheres_and_voronoi_cells_are_near_the_true_ones(across, bound):
    n, gap = across + 6, itertools.count(1)
    image = np.zeros((2 * n, n, n), int)
    for first in (0, n):
        away = np.stack(np.indices((n, n, n)), axis=-1) + 0.5 - n / 2 - stream(across, "middle", first).random(3)
        image[first : first + n][np.linalg.norm(away, axis=-1) < across / 2] = next(gap)
    _, found = surfaces_of(image)
    areas = [areas_of(points[faces]).sum() / (np.pi * across**2) for points, faces in found.values()]
    assert np.mean(areas) == pytest.approx(1.0, abs=bound)
    image, points = cells(round(2 * across), 12)
    tiled = np.concatenate([points + 2 * across * np.array(step) for step in itertools.product((-1, 0, 1), repeat=3)])
    diagram = Voronoi(tiled)
    true = [ConvexHull(diagram.vertices[diagram.regions[diagram.point_region[13 * 12 + k]]]).area for k in range(12)]
    _, found = surfaces_of(image, periodic="xyz")
    areas = [areas_of(points[faces]).sum() for points, faces in found.values()]
    assert np.sum(areas) / np.sum(true) == pytest.approx(1.0, abs=bound)


def test_a_pinched_label_gets_a_vertex_for_each_fan():
    # two voxels that share an edge, of which each keeps its own faces
    image = np.zeros((4, 4, 3), np.int32)
    image[1, 1, 1] = image[2, 2, 1] = 1
    net = net_of(image, tiles_of(image, 1, np.zeros(3, dtype=bool)))
    _, point, _ = triangles_of(net, split_of(net, 1), 1, np.zeros(len(net.quad), dtype=bool))
    assert len(net.blocks) == 2
    assert len(point) == 16
    assert len(np.unique(point)) == 14
