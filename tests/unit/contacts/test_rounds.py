"""Rounds of contacts: every contact once, and no body in two sets of a round."""

import numpy as np
import pytest

from voxgran.contacts.manifolds.rounds import rounds_of
from voxgran.geometry import morton


@pytest.mark.parametrize("far", [3, 500])
def test_sets_of_a_round_have_no_body_in_common(monkeypatch, far):
    """Of contacts with neighbours in the order, and of those with bodies anywhere; some at walls, some with a lid."""
    monkeypatch.setattr(morton, "MANY", 100)
    monkeypatch.setattr(morton, "LEAST", 60)
    generator = np.random.default_rng(far)
    i = np.sort(generator.integers(0, 500, 2000))
    j = np.where(generator.random(2000) < 0.1, -1, np.minimum(i + generator.integers(0, far, 2000), 500))
    rounds = rounds_of(i, j, 501)
    assert sorted(rounds.rows) == list(range(2000))
    assert len(rounds.bodies) == 9
    assert rounds.bodies[[0, -1]].tolist() == [0, 501]
    assert (len(rounds.sets) > 4) == (far > 3)
    assert rounds.ends[-1] == 2000
    for first, end in zip(rounds.sets[:-1], rounds.sets[1:], strict=True):
        held = set()
        for s in range(first, end):
            rows = rounds.rows[rounds.ends[s] : rounds.ends[s + 1]]
            assert (np.diff(rows) > 0).all()
            bodies = {*i[rows].tolist(), *j[rows][j[rows] >= 0].tolist()}
            assert not held & bodies
            held |= bodies
            if s < 8:
                assert all(rounds.bodies[s] <= body < rounds.bodies[s + 1] for body in bodies)


def test_few_contacts_are_one_set_as_those_of_a_container_that_deforms(monkeypatch):
    i, j = np.arange(30_000), np.append(np.arange(1, 30_000), -1)
    assert rounds_of(i[:50], j[:50], 51).rows.tolist() == list(range(50))
    assert len(rounds_of(i, j, 30_001).bodies) == 9
    shared = rounds_of(i, j, 30_001, shared=True)
    assert (len(shared.bodies), shared.ends.tolist(), shared.sets.tolist()) == (2, [0, 30_000], [0, 1])
    assert rounds_of(i[:0], j[:0], 30_001).ends.tolist() == [0] * 9
