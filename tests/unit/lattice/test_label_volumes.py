"""What labels gain in volume, how pressures change it, and which triangles cross: beside plain sums over surfaces."""

import itertools

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.geometry.crossing import count_crossings
from voxgran.geometry.triangles import enclosed_volume
from voxgran.lattice import label_volumes
from voxgran.lattice.label_net import net_of, split_of, triangles_of
from voxgran.lattice.label_pieces import tiles_of
from voxgran.lattice.label_volumes import BOX, PARTS, examine, push

SPACING = np.array([1.0, 0.7, 1.9])
LABELS = 3


@pytest.fixture(params=[label_volumes.CHUNK, 20])
def shaken(request, monkeypatch):
    """Return a net of noise with points moved at random by at most `reach` voxels, in chunks of all or few points."""
    monkeypatch.setattr(label_volumes, "CHUNK", request.param)

    def make(reach):
        draw = stream(request.param, "shaken")
        image = draw.integers(0, LABELS + 1, (6, 5, 4)).astype(np.int32)
        net = net_of(image, tiles_of(image, LABELS, np.zeros(3, dtype=bool)))
        moved = np.rint(draw.uniform(-reach, reach, net.at.shape) * PARTS).astype(np.float32) / np.float32(PARTS)
        crossed = draw.random(len(net.quad)) < 0.5
        return image, net, moved, crossed

    return make


def surfaces(net, moved, crossed):
    split = split_of(net, LABELS)
    for label in range(1, LABELS + 1):
        triangles, point, _ = triangles_of(net, split, label, crossed)
        yield (net.at[point] + moved[point].astype(float)) * SPACING, triangles


def volumes(net, moved, crossed):
    return np.array([enclosed_volume(*surface) for surface in surfaces(net, moved, crossed)])


def test_volumes_and_their_changes_by_pressures_are_those_of_the_surfaces(shaken):
    image, net, moved, crossed = shaken(0.3)
    held = np.zeros(moved.shape, dtype=bool)
    held[::5] = True
    found = examine(net, crossed, moved, held, spacing=SPACING, labels=LABELS)
    voxels = np.bincount(image.ravel())[1:] * SPACING.prod()
    assert found.change[1:] == pytest.approx(volumes(net, moved, crossed) - voxels, abs=1e-12)
    matrix = np.diag(found.diagonal)
    row, column = np.divmod(found.pairs, LABELS + 1)
    matrix[row, column] = matrix[column, row] = found.shared
    # central differences; a point moves in whole steps, of which there are many in each move
    change = []
    for label in range(1, LABELS + 1):
        ends = []
        for sign in (1, -1):
            there, pressure = moved.copy(), np.zeros(LABELS + 1)
            pressure[label] = 0.01 * sign
            push(net, crossed, there, held, spacing=SPACING, pressure=pressure, ease=found.ease)
            assert np.array_equal(there[held], moved[held])
            assert np.array_equal(there * PARTS, np.rint(there * PARTS))
            ends.append(volumes(net, there, crossed))
        change.append((ends[0] - ends[1]) / 0.02)
    np.testing.assert_allclose(np.transpose(change), matrix[1:, 1:], rtol=2e-3, atol=2e-3)


def test_points_at_the_ends_of_their_boxes_stay(shaken):
    _, net, moved, crossed = shaken(0.2)
    moved[:, 1] = BOX
    held = np.zeros(moved.shape, dtype=bool)
    found = examine(net, crossed, moved, held, spacing=SPACING, labels=LABELS)
    there = moved.copy()
    push(net, crossed, there, held, spacing=SPACING, pressure=np.arange(LABELS + 1.0), ease=found.ease)
    assert (there[:, 1] == BOX).all()
    assert abs(there).max() == BOX
    assert (there[:, 0] != moved[:, 0]).any()


@pytest.mark.parametrize("reach", [0.1, 0.5])
def test_crossings_are_found_where_the_surfaces_cross(shaken, reach):
    _, net, moved, crossed = shaken(reach)
    found = examine(net, crossed, moved, np.zeros(moved.shape, dtype=bool), spacing=SPACING, labels=LABELS)
    points = (net.at + moved.astype(float)) * SPACING
    corners = np.where(crossed[:, None], np.roll(net.quad, -1, axis=1), net.quad)
    count = count_crossings(points, np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]))
    assert found.wrong.any() == (count > 0) == (reach > 0.2)


@pytest.mark.slow
def test_pairs_of_many_labels_are_all_told():
    image = np.arange(1, 6**3 + 1, dtype=np.int32).reshape(6, 6, 6)
    net = net_of(image, tiles_of(image, image.max(), np.zeros(3, dtype=bool)))
    moved = np.zeros(net.at.shape, dtype=np.float32)
    crossed, held = np.zeros(len(net.quad), dtype=bool), np.zeros(moved.shape, dtype=bool)
    found = examine(net, crossed, moved, held, spacing=np.ones(3), labels=int(image.max()))
    seen = {tuple(pair) for pair in np.transpose(np.divmod(found.pairs, image.max() + 1)).tolist()}
    steps = [step for step in itertools.product((-1, 0, 1), repeat=3) if step > (0, 0, 0)]
    near = {
        (image[at], image[tuple(np.add(at, step))])
        for at in np.ndindex(6, 6, 6)
        for step in steps
        if (np.add(at, step) >= 0).all() and (np.add(at, step) < 6).all()
    }
    assert seen == {(min(pair), max(pair)) for pair in near}
