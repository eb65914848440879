"""What a walk does not look at: sleeping grains, the inside of grains, and all that is far away."""

import kit
import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion

import voxgran as vg
from voxgran._base.seeds import philox_key
from voxgran.packing.digital import precompute as digital_setting
from voxgran.packing.digital.bit_columns import column_words
from voxgran.packing.digital.precompute import precomputed_of
from voxgran.packing.digital.walk_method import registration as digital


def counted(many, cells, *, each=60, **options):
    """Return the counters of a bed after `each` attempts per grain; `many` grains on each side of its floor."""
    box = vg.Box((1.6 * many, 1.6 * many, 4), periodic=(True, True, False))
    parameters = {"voxel_size": 1 / cells, "orientations": 1, "feed": "at_once", "rotation_share": 0.0, **options}
    task = kit.task_of("digital", vg.make_shape("sphere"), box, count=2 * many * many, seed=1, **parameters)
    state = digital.prepare(task.problem)
    return digital.advance(task.problem, state, each * task.problem.count).counters


def attempts(counters):
    """Return how many attempts looked at the canvas or the tables."""
    return counters["moves_tried"] + counters["turns_tried"] + counters["feeds_tried"]


def test_sleeping_grains_look_at_nothing():
    awake, asleep = (
        counted(3, 12, each=3000, vibration_up=0.0, feed="rain", schedule=schedule)
        for schedule in ("random", "sleeping")
    )
    assert awake["slept_through"] == 0
    assert attempts(asleep) + asleep["slept_through"] == attempts(awake)
    assert attempts(asleep) < 0.7 * attempts(awake)
    assert asleep["rows_read"] < 0.8 * awake["rows_read"]


def test_a_move_looks_at_its_own_rows_and_no_more_in_a_larger_scene():
    small, large = (counted(many, 12) for many in (3, 9))
    a, b = (counters["rows_read"] / attempts(counters) for counters in (small, large))
    # the box of a sphere of 12 voxels, at the most in two words
    assert 0 < b < 1.03 * a
    assert a < 2 * 12
    assert small["pairs_read"] == large["pairs_read"] == 0


def test_tables_are_read_of_near_pairs_and_no_more_in_a_larger_scene(monkeypatch):
    monkeypatch.setattr(digital_setting, "TABLE_VOXELS", 0)
    small, large = (counted(many, 12) for many in (3, 9))
    a, b = (counters["pairs_read"] / attempts(counters) for counters in (small, large))
    # 12 equal spheres have room around one, and few of them come first
    assert 0 < b < 1.03 * a
    assert a < 12
    assert small["rows_read"] == large["rows_read"] == 0


def walking(*, tables=False, wide=4, **options):
    """Return a bed in its walk, with all grains in."""
    parameters = {"voxel_size": 1 / 8, "sweeps": 400, "rotation_share": 0.0, "rate": 0.5, "orientations": 1, **options}
    shape, box = vg.make_shape("box", lengths=(1.0, 0.8, 0.6)), vg.Box((wide, wide, wide + 1))
    task = kit.task_of("digital", shape, box, count=30, seed=2, **parameters)
    state = digital.prepare(task.problem)
    while state.feeding_ended_at is None:
        state = digital.advance(task.problem, state, 1)
    assert state.counters["placed"] == 30
    assert tables == (len(state.derived["pairs"].at) > 0)
    return task.problem, state


def next_grain(problem, state):
    """Return whose turn the next attempt is."""
    word = np.random.Philox(key=philox_key(problem.seed, "digital"), counter=[state.done - 1, 0, 0, 0]).random_raw(4)[0]
    placed = state.counters["placed"]
    return int(state.waiting[len(state.waiting) - 1 - ((int(word) >> 32) * placed >> 32)])


def far_from(problem, state, grain, canvas, parts):
    """Return the canvas words of all voxels but those next to a grain that lie in no other grain's inside."""
    read = np.zeros((*canvas.word_shape[::2], canvas.word_shape[1] * 64), dtype=np.bool_)
    sites = state.arrays["site"] + canvas.margin
    read[tuple((parts[grain][0] + sites[grain]).T)] = True
    for other in range(problem.count):
        read[tuple((parts[other][1] + sites[other]).T)] = False
    read[tuple((parts[grain][2] + sites[grain]).T)] = False
    return ~column_words(read).reshape(-1)


@pytest.mark.slow
def test_a_move_hangs_on_nothing_but_the_shell_of_its_grain():
    """All other bits of the canvas (far away, inside of grains, the grain's own) are random at each attempt."""
    (problem, state), (_, twin) = walking(), walking()
    setting, random, parts = precomputed_of(problem, state), np.random.default_rng(0), []
    for member in state.arrays["member"].tolist():
        mask = np.pad(setting.mask_of(member), 1)
        near, core = binary_dilation(mask, np.ones((3, 3, 3))), binary_erosion(mask, np.ones((3, 3, 3)))
        assert core.sum() > 50
        parts.append([np.argwhere(part) - mask.shape[0] // 2 for part in (near & ~mask, core, mask)])
    before, words = state.counters["moves_accepted"], state.derived["words"]
    for _ in range(300):
        others = far_from(problem, state, next_grain(problem, state), setting.canvas, parts)
        noise = others & random.integers(0, 2**64, len(others), dtype=np.uint64)
        words[: len(noise)] ^= noise
        state = digital.advance(problem, state, 1)
        words[: len(noise)] ^= noise
    twin = digital.advance(problem, twin, 300)
    assert 15 < state.counters["moves_accepted"] - before < 285
    assert state.counters == twin.counters
    assert np.array_equal(state.arrays["site"], twin.arrays["site"])
    assert np.array_equal(words, twin.derived["words"])


@pytest.mark.slow
def test_tables_are_asked_of_no_pair_that_is_far_apart(monkeypatch):
    """Grains beyond the reach have random turns at each attempt, and those beyond the next cell stand on the grain."""
    monkeypatch.setattr(digital_setting, "TABLE_VOXELS", 0)
    monkeypatch.setattr(digital_setting, "TABLE_BYTES", 2**31)
    options = {"tables": True, "orientations": 24, "gravity": "none", "feed": "at_once", "wide": 9}
    (problem, state), (_, twin) = walking(**options), walking(**options)
    cells, random = state.derived["pairs"].cells, np.random.default_rng(0)
    turn, site = state.arrays["turn"], state.arrays["site"]
    far_turns = far_sites = 0
    for _ in range(300):
        grain = next_grain(problem, state)
        apart = np.abs(site - site[grain]).max(axis=1)
        # after the step
        first, cell, last = (np.clip((site + k) // cells[3], 0, cells[:3] - 1) for k in (-1, 0, 1))
        turned = np.flatnonzero(apart > cells[3])
        shifted = np.flatnonzero(((cell < first[grain] - 1) | (cell > last[grain] + 1)).any(axis=1))
        kept = turn[turned].copy(), site[shifted].copy()
        turn[turned], site[shifted] = random.integers(0, 24, len(turned)), site[grain]
        state = digital.advance(problem, state, 1)
        turn[turned], site[shifted] = kept
        far_turns, far_sites = far_turns + len(turned), far_sites + len(shifted)
    twin = digital.advance(problem, twin, 300)
    assert far_turns > 3_000
    assert far_sites > 750
    assert state.counters == twin.counters
    assert np.array_equal(site, twin.arrays["site"])
    assert np.array_equal(turn, twin.arrays["turn"])
