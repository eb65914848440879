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


def test_many_positions_are_ordered_by_slabs_and_layers_and_few_by_height(monkeypatch):
    position = stream(2, "positions").uniform([-3, -3, -3], [8, 8, 12], (1000, 3))
    down = np.array([0.0, -1.0, 0.0])
    np.testing.assert_array_equal(layered_order(position, down), np.argsort(position[:, 1], kind="stable"))
    monkeypatch.setattr(morton, "MANY", 100)
    monkeypatch.setattr(morton, "LEAST", 60)
    # 16 blocks would be narrower than 3 in 15, as 8 of them; 4 slabs are not
    found = layered_order(position, down)
    assert sorted(found) == list(range(1000))
    slabs = position[found].reshape(4, 250, 3)
    assert (slabs[:-1, :, 2].max(axis=1) <= slabs[1:, :, 2].min(axis=1)).all()
    for slab in np.floor(slabs).astype(int):
        assert (np.diff(slab[:, 1]) >= 0).all()
        for layer in np.unique(slab[:, 1]):
            codes = [
                sum(((int(v) + 3 >> b) & 1) << (2 * b + axis) for axis, v in enumerate(site) for b in range(5))
                for site in slab[slab[:, 1] == layer][:, [0, 2]]
            ]
            assert codes == sorted(codes)


def test_blocks_are_a_power_of_two():
    counts = [19_999, 20_000, 39_999, 40_000, 10**5, 10**6, 10**8]
    assert [morton.block_count(count) for count in counts] == [1, 8, 8, 16, 32, 64, 64]
