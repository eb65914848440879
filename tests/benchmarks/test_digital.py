import numpy as np
import pytest

from benchmarks.packing.digital import measure_beds, measure_bodies, measure_spheres, walking_task
from benchmarks.peers import walks as peers
from voxgran.packing.digital.precompute import precomputed_of
from voxgran.shapes.family import make_shape


def test_peers_go_the_same_way():
    """Both programs, move by move, from the same places with the same picks."""
    steps = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], dtype=np.int64) - 1
    x = np.indices((7, 7, 7)) - 3
    mask = (x**2).sum(axis=0) <= 10
    generator = np.random.Generator(np.random.Philox(1))
    shape = np.array([34, 34, 34])
    sites = 1 + 9 * np.array(list(np.ndindex(3, 3, 3)))[generator.permutation(27)[:14]]
    picks, ways = generator.integers(0, len(sites), 3000), generator.integers(0, 26, 3000)
    found = []
    for walk in (peers.numpy_walk(mask, steps), peers.front_walk(mask, steps)):
        places, grid = sites.copy(), peers.occupied(shape, mask, sites)
        accepted = walk(grid, places, picks, ways)
        assert np.array_equal(grid, peers.occupied(shape, mask, places))
        found.append((accepted, places.tobytes()))
    assert found[0] == found[1]
    assert 0 < found[0][0] < 3000


@pytest.mark.slow
def test_rates_of_a_small_lattice():
    rows = measure_spheres((12,), 64)
    assert [row[3] for row in rows] == ["NumPy", "numba fronts", "voxgran", "voxgran, sorted"]
    assert np.ptp([row[5] for row in rows]) < 0.15
    assert rows[2][4] > 20 * rows[0][4]
    assert [row[3] for row in measure_bodies(64)] == ["voxgran"] * 3


def test_grains_stand_apart_and_keep_their_places():
    problem, state = walking_task(make_shape("sphere"), 12, 64)
    setting = precomputed_of(problem, state)
    placed = state.counters["placed"]
    assert placed > 20
    # all are of one kind, whose voxels they share
    assert len(setting.bank.voxels) == 1
    assert setting.canvas.occupied(state.derived["words"]).sum() == placed * setting.bank.voxels[0]


def test_settling_makes_beds_denser():
    rows = measure_beds((10,), (100,))
    assert [row[2] for row in rows] == ["walk", "walk and settling"]
    assert rows[1][4] > rows[0][4] + 0.05
