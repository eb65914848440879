import numpy as np
import pytest

import voxgran as vg
from benchmarks.packing.tessellation import THIN, errors_of, measure_cells, measure_thin
from benchmarks.peers import cells as peers
from voxgran.containers.kernel_container import kernel_container
from voxgran.packing.tessellation.voronoi_cells import Cells, seeds_of


def random_of(key):
    return np.random.Generator(np.random.Philox(key))


@pytest.mark.slow  # the peer takes half a minute to compile
@pytest.mark.parametrize(
    "container", [vg.Rectangle((2, 3), "xy"), vg.Box((1, 2, 1), "xyz"), vg.Box((1, 1, 1))], ids=str
)
def test_the_peer_keeps_the_volumes_of_its_cells(container):
    """After many moves the volumes are those of a new diagram of the same seeds, and nearer to what is wanted."""
    random, n = random_of(1), 40
    place = random.random((n, 3)) * (container.bounds[1] - container.bounds[0])
    wanted = np.exp(random.normal(size=n))
    wanted *= container.volume / wanted.sum()
    cells = Cells(kernel_container(container, from_corner=True))

    def volumes_at(place):
        return cells.measured(seeds_of(place, np.zeros(n), cells.walls), n, lambda: None).volume

    moved, volume, _, kept = peers.inverse_monte_carlo(cells, place, wanted, 600, seed=2)
    assert 30 < kept < 600
    assert volumes_at(moved) == pytest.approx(volume, abs=1e-12)
    assert volume.sum() == pytest.approx(container.volume)

    def distance(volume):
        return ((np.sort(volume) - np.sort(wanted)) ** 2).sum()

    assert distance(volume) < 0.1 * distance(volumes_at(place))


def test_errors_of_distributions():
    assert errors_of(np.array([3.0, 1, 2]), np.array([1.0, 2, 3])) == (0, 0)
    shares, volumes = errors_of(np.array([1.5, 2, 3, 4]), np.array([1.0, 2, 3, 4]))
    assert (shares, volumes) == (0.25, 0.5)


@pytest.mark.parametrize("dimension", [2, 3])
def test_cells_by_weights_have_their_volumes(dimension):
    rows = measure_cells(dimension, 0.3, count=60, moves=())
    assert [row[2:4] for row in rows] == [("weights", smoothing) for smoothing in (0, 30)]
    assert max(row[6] for row in rows) <= 1e-4
    # one cell is a sixtieth of all
    assert max(row[5] for row in rows) <= 1.01 / 60


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_the_peer_comes_nearer_with_more_moves_but_less_near(dimension):
    rows = measure_cells(dimension, 0.3, count=60, moves=(200, 1000))
    assert [row[2:4] for row in rows[2:]] == [("inverse Monte Carlo", many) for many in (200, 1000)]
    assert rows[2][6] > rows[3][6] > 100 * max(row[6] for row in rows[:2])


def test_a_thin_container_is_filled():
    assert measure_thin("strip 20 x 0.1")[2] > 0.8
    assert len(THIN) == 7
