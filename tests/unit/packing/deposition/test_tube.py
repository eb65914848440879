"""Roots of trigonometric polynomials, and the way of a sphere along the wall of a cylinder."""

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.packing.deposition.tube import next_root


def roots_of(c, a1, b1, a2, b2):
    """Return the real angles at which the polynomial is zero, from 0 to 2 pi: as a polynomial of exp(i t)."""
    powers = [(a2 - 1j * b2) / 2, (a1 - 1j * b1) / 2, c, (a1 + 1j * b1) / 2, (a2 + 1j * b2) / 2]
    found = np.roots(powers)
    return np.sort(np.angle(found[abs(abs(found) - 1) < 1e-7]) % (2 * np.pi))


def test_all_roots_are_found_in_turn():
    draw = stream(3, "roots")
    several = 0
    for _ in range(300):
        c, a1, b1, a2, b2 = draw.normal(0, (0.5, 1, 1, 1, 1))
        expected, t, found = roots_of(c, a1, b1, a2, b2), 0.0, []
        while (t := next_root(c, a1, b1, a2, b2, t, 2 * np.pi)) < np.inf:
            found.append(t)
        assert found == pytest.approx(expected.tolist(), abs=1e-9)
        several += len(found) == 4
    assert several > 20


def test_the_root_at_the_beginning_is_left_behind():
    # 1 - cos touches zero at 0, and sin crosses it there
    assert next_root(1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 6.0) == np.inf
    assert next_root(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 6.0) == pytest.approx(np.pi, abs=1e-12)
    assert next_root(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 3.0) == np.inf
    assert next_root(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 6.0) == np.inf
