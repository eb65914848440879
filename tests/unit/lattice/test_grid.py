import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from voxgran.lattice.grid import Grid


@given(
    st.floats(1e-3, 1e3),
    st.lists(st.floats(-20, 20), min_size=3, max_size=3),
    st.lists(st.floats(0, 20), min_size=3, max_size=3),
)
def test_a_grid_around_a_box_holds_it_with_its_margin(size, low, extent):
    lower = np.array(low) * size
    upper = lower + np.array(extent) * size
    grid = Grid.around(lower, upper, size, margin=1)
    corner = np.array(grid.origin)
    assert (corner <= lower - size * (1 - 1e-9)).all()
    assert (corner + grid.lengths >= upper + size * (1 - 1e-9)).all()
    # one voxel corner lies at the origin of the coordinates
    assert np.allclose(corner / size, np.rint(corner / size), rtol=0, atol=1e-12)


def test_indices_undo_coordinates():
    grid = Grid((-1.5, 2.0, 0.25), 0.25, (4, 5, 6))
    indices = np.argwhere(np.ones(grid.shape))
    points = grid.coordinates(indices)
    assert np.array_equal(grid.indices(points), indices)
    assert grid.voxel_count == len(indices) == 120
    assert np.array_equal(np.unique(points[:, 1]), grid.centers(1))
    assert np.array_equal(grid.indices(np.array([[-1.51, 2.0, 0.25]])), [[-1, 0, 0]])
