"""Bit columns against plain boolean arrays."""

import numpy as np
import pytest
from kit import slow

from voxgran._base.seeds import stream
from voxgran.geometry.rotation import lattice_rotations
from voxgran.packing.digital.bit_columns import (
    Canvas,
    VoxelBank,
    column_words,
    grain_words,
    mask_of_words,
    row_length,
    turned_box,
    write_turned,
)
from voxgran.packing.digital.stamping import close_layer, count_layer, look, look_along, stamp, stamp_move, sum_blocked

ROW = 400  # zeros at the start of the bits, for words that are not there


def random_mask(index, half):
    random = stream(11, "mask", index)
    mask = np.zeros((2 * half,) * 3, dtype=bool)
    low, high = random.integers(0, half, 3), random.integers(half + 1, 2 * half + 1, 3)
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    mask[box] = random.random(mask[box].shape) < 0.6
    mask[half, half, half] = True
    return mask


def rotated(mask, matrix):
    """Turn a centered mask voxel by voxel: the plain twin of the packed turn."""
    half = mask.shape[0] // 2
    centers = np.argwhere(mask) + 0.5 - half
    turned = np.floor(centers @ matrix.T + half).astype(int)
    out = np.zeros_like(mask)
    out[tuple(turned.T)] = True
    return out


def signed(matrix):
    return np.array([int(np.flatnonzero(row)[0]) + (3 if row.sum() < 0 else 0) for row in matrix])


@pytest.mark.parametrize("height", [1, 63, 64, 65, 130])
def test_packing_is_reversible(height):
    mask = stream(0, "m", height).random((5, 7, height)) < 0.5
    assert np.array_equal(mask_of_words(column_words(mask), height), mask)


@pytest.mark.parametrize("half", [3, 20, 40, 70])
def test_turns_are_exact(half):
    mask = random_mask(half, half)
    bank = VoxelBank.from_masks(1, lambda member: mask)
    for matrix in lattice_rotations():
        turn = signed(matrix)
        low, size = turned_box(bank.low[0], bank.size[0], turn)
        count = -(-size[2] // 64)
        bits = np.full(grain_words(size), 7, dtype=np.uint64)
        write_turned(bank.words, bank.start[0], bank.size[0], turn, bits, 0)
        columns = bits.reshape(size[0] + 2, count, row_length(size[1])).transpose(0, 2, 1)
        assert not columns[0].any()
        assert not columns[:, size[1] :].any()
        found = mask_of_words(columns[1:-1, : size[1]].transpose(0, 2, 1), size[2])
        twin = rotated(mask, matrix)
        box = tuple(slice(half + a, half + a + n) for a, n in zip(low, size, strict=True))
        assert np.array_equal(found, twin[box])
        assert found.sum() == mask.sum()


@pytest.mark.parametrize("half", [4, 35, slow(70)])
def test_moves_are_those_of_plain_arrays(half):
    """Stamp two grains, then compare every answer with boolean arrays."""
    masks = [random_mask(2 * half, half), random_mask(2 * half + 1, half)]
    bank = VoxelBank.from_masks(2, lambda member: masks[member])
    shape = np.array([5 * half, 5 * half, 6 * half])
    canvas = Canvas(shape, np.array([1, 1, 1]), np.zeros(3, dtype=np.int64))
    field = canvas.field(canvas.words(None))
    turn = np.array([0, 1, 2])
    sizes, starts, bits = [], [], [np.zeros(ROW, dtype=np.uint64)]
    for member in range(2):
        _, size = turned_box(bank.low[member], bank.size[member], turn)
        block = np.zeros(grain_words(size), dtype=np.uint64)
        write_turned(bank.words, bank.start[member], bank.size[member], turn, block, 0)
        starts.append(sum(len(part) for part in bits))
        bits.append(block)
        sizes.append(tuple(int(n) for n in size))
    words = np.concatenate(bits)
    boxes = [
        masks[m][tuple(slice(half + a, half + a + n) for a, n in zip(bank.low[m], sizes[m], strict=True))]
        for m in (0, 1)
    ]

    def block(array, corner):
        return array[tuple(slice(c, c + n) for c, n in zip(corner, sizes[1], strict=True))]

    def plain(member, corner):
        full = np.zeros(shape + 2, dtype=bool)
        full[tuple(slice(c, c + n) for c, n in zip(corner, sizes[member], strict=True))] = boxes[member]
        return full

    walls = np.pad(np.zeros(shape, dtype=bool), 1, constant_values=True)
    resting = (1 + half, 1 + half, 1 + half)
    stamp(field, words, starts[0], sizes[0], resting)
    assert canvas.occupied(field.words).sum() == masks[0].sum()
    random = stream(5, "places", half)
    blocked = free = 0
    taken = plain(0, resting) | walls
    for _ in range(60 if half < 70 else 20):
        corner = tuple(int(random.integers(1, s + 2 - n)) for s, n in zip(shape, sizes[1], strict=True))
        answer = bool((boxes[1] & block(taken, corner)).any())
        rows = look(field, words, starts[1], sizes[1], corner)
        all_rows = sizes[1][0] * (((corner[2] & 63) + sizes[1][2] + 63) // 64)
        assert ~all_rows <= rows < 0 if answer else rows == all_rows
        if answer:
            continue
        stamp(field, words, starts[1], sizes[1], corner)
        step = tuple(int(value) for value in random.integers(-1, 2, 3))
        target = tuple(c + d for c, d in zip(corner, step, strict=True))
        meets = (boxes[1] & block(taken, target)).any()
        assert (look_along(field, words, starts[1], sizes[1], target, step) < 0) == meets
        before = block(np.pad(boxes[1], 1), tuple(1 + d for d in step))
        places = np.argwhere(boxes[1] & ~before & block(taken, target))
        expected = (len(places), *(int(v) for v in places.sum(axis=0)))
        assert sum_blocked(field, words, starts[1], sizes[1], target, step) == expected
        blocked, free = blocked + bool(meets), free + (not meets)
        if not meets:
            stamp_move(field, words, starts[1], sizes[1], target, step)
            expected = plain(1, target) | plain(0, resting)
            assert np.array_equal(canvas.occupied(field.words), expected[1:-1, 1:-1, 1:-1])
            corner = target
        stamp(field, words, starts[1], sizes[1], corner)
    assert free > 0
    stamp(field, words, starts[0], sizes[0], resting)
    assert canvas.occupied(field.words).sum() == 0


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_layers_are_counted_and_closed(axis):
    shape, periodic = np.array([5, 6, 70]), np.array([1, 0, 0])
    canvas = Canvas(shape, np.array([3, 1, 1]), periodic)
    taken = stream(6, "taken").random(tuple(shape)) < 0.3
    field = canvas.field(canvas.words(~taken))
    for level in (0, int(shape[axis]) - 1):
        layer = tuple(level if k == axis else slice(None) for k in range(3))
        assert count_layer(field, axis, level) == taken[layer].sum()
        close_layer(field, axis, level)
        taken[layer] = True
        assert np.array_equal(canvas.occupied(field.words), taken)
    # the images beyond a periodic axis are closed too
    if axis == 2:
        full = mask_of_words(field.words[:-8].reshape(canvas.word_shape), 64 * canvas.word_shape[1])
        assert full[:, 1:-1, 1].all()
