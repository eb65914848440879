import numpy as np
from scipy.spatial import cKDTree

from benchmarks.packing.rsa import SATURATED, measure_proofs, measure_tries
from benchmarks.peers import addition as peers
from voxgran._base.seeds import stream


def test_the_plain_program_adds_at_random():
    lengths = np.array([8.0, 7.0, 6.0])
    centers, refused = peers.scipy_addition(lengths, 3000, seed=1)
    assert len(centers) + refused == 3000
    assert len(cKDTree(centers, boxsize=lengths).query_pairs(1.0 - 1e-12)) == 0
    # the same places, one after the other
    alone = np.zeros((0, 3))
    for place in stream(1, "scipy addition").random((3000, 3)) * lengths:
        step = alone - place
        step -= np.round(step / lengths) * lengths
        if (np.linalg.norm(step, axis=1) >= 1.0).all():
            alone = np.vstack([alone, place])
    assert np.array_equal(centers, alone)


def test_both_programs_come_as_far_with_as_many_tries():
    rows = measure_tries(("disk",), (1, 10), 3000)
    assert [row[:3] for row in rows] == [("disk", name, many) for many in (1, 10) for name in ("SciPy", "voxgran")]
    for one, two in (rows[:2], rows[2:]):
        assert abs(one[5] - two[5]) < 0.02
        assert one[5] < SATURATED["disk"]


def test_proofs_come_to_the_published_values():
    rows = measure_proofs({"disk": (1000,), "square": (1000,)})
    for name, _, tries, grains, _, found, error in rows:
        assert tries == 0
        assert abs(grains - 1000) < 60
        assert abs(found - SATURATED[name]) < 5 * error + 0.002
