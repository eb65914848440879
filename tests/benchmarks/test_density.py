import numpy as np
import pytest

from benchmarks.packing.density import extrapolated, measure_disks, measure_spheres


def test_a_line_is_followed_to_zero():
    sizes = np.array([0.05, 0.025, 0.0125, 0.0125])
    value, error = extrapolated(sizes, 0.6 - 2.0 * sizes)
    assert value == pytest.approx(0.6, abs=1e-14)
    assert error < 1e-14
    generator = np.random.Generator(np.random.Philox(3))
    off = [
        (found[0] - 0.6) / found[1]
        for found in (extrapolated(np.tile(sizes, 4), 0.6 + 0.01 * generator.normal(size=16)) for _ in range(400))
    ]
    # Student's t of 14 degrees of freedom
    assert np.std(off) == pytest.approx((14 / 12) ** 0.5, rel=0.12)


@pytest.mark.slow
def test_beds_are_as_dense_as_their_kind():
    disks = measure_disks(120)
    assert 0.74 < disks[0][4] < 0.86
    rows = measure_spheres((8, 10, 12), (1,), count=150)
    assert [row[1] for row in rows] == [8, 10, 12, 0] * 2
    assert all(0.55 < row[4] < 0.65 for row in rows if row[1])
