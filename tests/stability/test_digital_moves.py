"""Digital packing over many moves: the occupancy stays that of the grains, and memory stays small."""

import subprocess
import sys

import kit
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran.packing.digital.precompute import precomputed_of
from voxgran.packing.digital.walk_method import registration as digital

#: prints how many bytes a bed takes beyond a small one, which compiles; neither is settled, which is another engine
LARGE = """
import resource
import voxgran as vg

def pack(count, lengths):
    return vg.pack(
        vg.make_shape("solid_union", seed=1).scaled(1.0), vg.Box(lengths, periodic="xy"), method="digital", count=count,
        voxel_size=1 / 16, feed="at_once", gravity="none", sweeps=4, cycles=1, settle=False,
    ).count

pack(20, (4, 4, 4))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(pack(10_000, (20, 20, 60)), (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "container", "voxel_size"),
    [
        (vg.make_shape("box", lengths=(1.2, 0.9, 0.7)), vg.Box((5, 5, 6), periodic=(True, False, False)), 1 / 12),
        # taller than 63 voxels
        slow(vg.make_shape("cylinder"), vg.Box((4, 4, 6)), 1 / 70),
    ],
    ids=["small", "tall"],
)
def test_occupancy_after_a_million_moves_is_that_of_the_poses(shape, container, voxel_size):
    task = kit.task_of(
        *("digital", shape, container), count=20, seed=1,
        voxel_size=voxel_size, gravity="none", feed="at_once", sweeps=10**9, orientations=24,
    )  # fmt: skip
    state = digital.prepare(task.problem)
    wanted = 1_000_000 if voxel_size > 0.05 else 20_000
    while state.counters["moves_accepted"] < wanted:
        state = digital.advance(task.problem, state, 100_000)
    setting, words = precomputed_of(task.problem, state), state.derived["words"].copy()
    assert not len(state.derived["pairs"].at)
    state.derived.clear()
    precomputed_of(task.problem, state)
    assert np.array_equal(state.derived["words"], words)
    taken = setting.canvas.occupied(words).sum()
    assert taken == setting.bank.voxels[state.arrays["member"][state.arrays["member"] >= 0]].sum()


@pytest.mark.slow
def test_ten_thousand_grains_take_a_bit_for_each_voxel():
    found = subprocess.run([sys.executable, "-c", LARGE], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    count, memory = (int(word) for word in found.stdout.split())
    assert count == 10_000
    # of 98 million voxels; measured are 52 MB
    assert memory < 70e6
