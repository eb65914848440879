import numpy as np

from voxgran._base.seeds import stream
from voxgran.geometry.morton import morton_order


def test_the_order_is_that_of_interleaved_bits():
    sites = stream(1, "sites").integers(-5, 900, (200, 3))
    local = sites - sites.min(axis=0)
    codes = [
        sum(((int(v) >> b) & 1) << (3 * b + axis) for axis, v in enumerate(site) for b in range(12)) for site in local
    ]
    assert np.array_equal(morton_order(sites), np.argsort(codes, kind="stable"))
    assert len(morton_order(sites[:0])) == 0
