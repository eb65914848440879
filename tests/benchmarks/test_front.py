import numpy as np
import pytest

from benchmarks.packing.front import measure
from benchmarks.peers import front as peers


@pytest.mark.slow
def test_loose_fronts_are_as_dense_as_a_plain_one_and_dense_ones_denser():
    few = dict.fromkeys(("large", "loose", "dense", "disks"), (2000,))
    rows = {row[0]: row for row in measure(few, plain=500)}
    assert len(rows) == 11
    inside = {name: row[4] for name, row in rows.items()}
    assert inside["loose, nearest"] == pytest.approx(inside["NumPy and SciPy, loose"], abs=0.05)
    assert inside["dense"] > inside["loose, nearest"] + 0.1
    assert rows["dense, graded, filled"][6] > 0.5
    assert max(row[5] for row in rows.values()) < 1e-12


def test_the_plain_front_touches():
    _, places = peers.plain_front(120)
    away = np.linalg.norm(places[:, None] - places, axis=2) + 9 * np.eye(120)
    assert away.min() == pytest.approx(1, abs=1e-9)
    assert ((np.abs(away - 1) < 1e-9).sum(axis=1) >= 3).all()
