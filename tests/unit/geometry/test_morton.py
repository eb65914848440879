import numpy as np

from voxgran._base.seeds import stream
from voxgran.geometry import morton
from voxgran.geometry.morton import layered_order, morton_order


def test_the_order_is_that_of_interleaved_bits():
    sites = stream(1, "sites").integers(-5, 900, (200, 3))
    local = sites - sites.min(axis=0)
    codes = [
        sum(((int(v) >> b) & 1) << (3 * b + axis) for axis, v in enumerate(site) for b in range(12)) for site in local
    ]
    assert np.array_equal(morton_order(sites), np.argsort(codes, kind="stable"))
    assert len(morton_order(sites[:0])) == 0


def test_many_positions_are_ordered_by_layers_and_few_by_height(monkeypatch):
    position = stream(2, "positions").uniform(-3, 8, (500, 3))
    down = np.array([0.0, -1.0, 0.0])
    np.testing.assert_array_equal(layered_order(position, down), np.argsort(position[:, 1], kind="stable"))
    monkeypatch.setattr(morton, "MANY", 100)
    found = layered_order(position, down)
    cells = np.floor(position[found]).astype(int)
    assert sorted(found) == list(range(500))
    assert (np.diff(cells[:, 1]) >= 0).all()
    for layer in np.unique(cells[:, 1]):
        codes = [
            sum(((int(v) + 3 >> b) & 1) << (2 * b + axis) for axis, v in enumerate(site) for b in range(5))
            for site in cells[cells[:, 1] == layer][:, [0, 2]]
        ]
        assert codes == sorted(codes)
