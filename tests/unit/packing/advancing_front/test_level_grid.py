"""Spheres in cells: free places are those that a comparison with all spheres finds."""

import numpy as np
import pytest

from voxgran.geometry.level_grid import is_free
from voxgran.geometry.periods import OPEN
from voxgran.packing.advancing_front.sphere_cells import lay_cells, link, link_all, unlink

CASES = {
    "a box": ((9.0, 7.0, 11.0), (0, 0, 0), 3, 400),
    "periodic": ((9.0, 7.0, 11.0), (1, 0, 1), 3, 400),
    "small and periodic": ((2.3, 2.1, 2.6), (1, 1, 1), 3, 3),
    "a large box with few spheres": ((900.0, 7000.0, 1100.0), (0, 0, 0), 3, 300),
    "a long periodic box with few spheres": ((9000.0, 7.0, 11.0), (1, 0, 0), 3, 300),
    "disks": ((25.0, 31.0, 0.0), (0, 1, 0), 2, 300),
}


def overlaps_any(spheres, span, place, r, slack):
    """Compare with all spheres in all images."""
    turns = np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)]) * span
    away = np.linalg.norm(spheres[:, None, :3] + turns - place, axis=2)
    return bool((away < r + spheres[:, 3:] - slack).any())


@pytest.mark.parametrize("spread", [1.0, 1.7, 40.0])
@pytest.mark.parametrize("case", CASES)
def test_free_places_are_free(case, spread):
    lengths, periodic, dimension, many = CASES[case]
    lengths, periodic = np.array(lengths), np.array(periodic)
    generator = np.random.Generator(np.random.Philox(5))
    spheres = np.zeros((many, 4))
    # dense in a corner, so that sparse boxes have something to find
    region = np.minimum(lengths, 12.0)
    spheres[:, :3] = generator.random((many, 3)) * region
    spheres[:, 3] = 0.9 * spread ** -generator.random(many)
    cells = lay_cells(lengths, np.diag(lengths * periodic), spheres[:, 3], dimension)
    assert len(cells.head) <= 3 * many + 8 * len(cells.first)
    link_all(cells, spheres, many)
    found = []
    for _ in range(400):
        place, r = generator.random(3) * region, 0.5 * spread ** -generator.random()
        free = is_free(cells, spheres, *place, r, 1e-12)
        assert free == (not overlaps_any(spheres, lengths * periodic, place, r, 1e-12))
        found.append(free)
    assert any(found) or spread == 1.0
    assert not all(found)


def test_the_sphere_that_came_last_is_taken_out_again():
    spheres = np.array([[1.0, 1.0, 1.0, 0.5], [1.2, 1.0, 1.0, 0.5]])
    cells = lay_cells(np.array([4.0, 4.0, 4.0]), OPEN, spheres[:, 3], 3)
    link_all(cells, spheres, 1)
    before = cells.head.copy()
    link(cells, spheres, 1)
    assert not is_free(cells, spheres, 2.1, 1.0, 1.0, 0.5, 0.0)
    unlink(cells, spheres, 1)
    assert (cells.head == before).all()
    assert is_free(cells, spheres, 2.1, 1.0, 1.0, 0.5, 0.0)
