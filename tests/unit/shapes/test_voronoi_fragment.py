"""Voronoi fragments: the cells fill the box, and those of random seeds have the moments of Poisson-Voronoi cells."""

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.shapes.families.random.voronoi_fragment import VoronoiFragment, _seeds
from voxgran.shapes.repairing.diagnose import diagnose, refuse_dirty

LENGTHS = (1.0, 2.0, 3.0)
CASES = [
    {},
    {"boundary": "reflected"},
    {"process": "jittered", "seeds": 27},
    {"process": "jittered", "seeds": 27, "jitter": 0.0},
    {"process": "jittered", "seeds": 8, "jitter": 0.3, "boundary": "reflected"},
    {"seeds": 2},
    {"seeds": 2, "boundary": "reflected"},
]


def cells(seed, **parameters):
    """Return all cells of a tessellation, at their size."""
    count = parameters.get("seeds", 64)
    given = {"lengths": LENGTHS} | parameters
    return [vg.make_shape("voronoi_fragment", seed=seed, cell=k, **given) for k in range(count)]


@pytest.mark.parametrize("case", CASES)
def test_cells_fill_the_box(case):
    found = cells(5, **case)
    assert sum(cell.volume for cell in found) == pytest.approx(math.prod(LENGTHS), rel=1e-12)
    for cell in found:
        refuse_dirty(cell.vertices, cell.faces, str(case))
        assert ConvexHull(cell.vertices).volume == pytest.approx(cell.volume, rel=1e-12)
        if case.get("boundary") == "reflected":
            corners = cell.vertices + cell.offset
            assert corners.min() > -1e-12
            assert (corners <= np.array(LENGTHS) + 1e-12).all()
    if case.get("jitter") == 0.0:
        assert all(len(cell.vertices) == 8 for cell in found)
        assert [cell.volume for cell in found] == pytest.approx([6 / 27] * 27, rel=1e-12)


@pytest.mark.parametrize("boundary", ["periodic", "reflected"])
def test_cells_hold_what_is_nearest_to_their_seeds(boundary):
    seeds = _seeds(VoronoiFragment(), stream(9, "shape voronoi_fragment")) * LENGTHS
    points = stream(1, "points").random((1000, 3)) * LENGTHS
    away = points[:, None] - seeds
    if boundary == "periodic":
        away -= np.round(away / LENGTHS) * LENGTHS
    nearest = (away**2).sum(axis=2).argmin(axis=1)
    for k, cell in enumerate(cells(9, boundary=boundary)):
        mine = points[nearest == k]
        shift = np.round((mine - seeds[k]) / LENGTHS) * LENGTHS if boundary == "periodic" else 0.0
        assert (cell.signed_distance(mine - shift - cell.offset) < 1e-12).all()


@pytest.mark.slow
def test_cells_of_random_seeds_have_the_moments_of_poisson_voronoi_cells():
    # 48 pi^2 / 35 + 2 faces on average (Meijering 1953), and the variance 0.179 of the volume (Gilbert 1962,
    # doi:10.1214/aoms/1177704464), as Okabe et al. 2000 give them
    faces, volumes = [], []
    for seed in range(8):
        found = cells(seed, lengths=(4, 4, 4))
        faces += [len(cell.vertices) / 2 + 2 for cell in found]
        volumes += [cell.volume for cell in found]
    error = np.std(faces) / math.sqrt(len(faces))
    assert error < 0.2
    assert abs(np.mean(faces) - (48 * math.pi**2 / 35 + 2)) < 3.5 * error
    squares = (np.array(volumes) - 1) ** 2
    assert abs(squares.mean() - 0.179) < 3.5 * squares.std() / math.sqrt(len(squares))


def test_jittered_seeds_stay_in_their_cubes():
    for jitter in (0.0, 0.5, 1.0):
        parameters = VoronoiFragment(process="jittered", jitter=jitter)
        seeds = _seeds(parameters, stream(0, "x")) * 4
        lattice = np.indices((4, 4, 4)).reshape(3, -1).T + 0.5
        reach = np.abs(seeds - lattice).max()
        assert reach <= jitter / 2
        assert reach > 0.45 * jitter or jitter == 0


def test_fragments_of_a_size_are_stretched():
    one, two = (vg.make_shape("voronoi_fragment", seed=3, aspect=aspect) for aspect in ((1, 1, 1), (1, 1, 4)))
    ratio = np.ptp(two.vertices, axis=0) / np.ptp(one.vertices, axis=0)
    assert ratio == pytest.approx(np.array([1, 1, 4]) / 4 ** (1 / 3), rel=1e-12)


def test_without_a_number_the_cell_is_drawn():
    drawn = vg.make_shapes("voronoi_fragment", count=20, seeds=8)
    assert {shape.record["cell"] for shape in drawn} > {0, 7}
    one = vg.make_shape("voronoi_fragment", seed=4)
    assert vg.make_shape("voronoi_fragment", seed=4, cell=one.record["cell"]) == one


def test_some_seeds_are_one_clean_solid():
    for seed in range(20):
        found = diagnose(vg.make_shape("voronoi_fragment", seed=seed))
        assert found.ok, (seed, found.sentences())


@pytest.mark.slow
def test_a_thousand_seeds_are_one_clean_solid():
    for seed in range(1000):
        boundary = ("periodic", "reflected")[seed % 2]
        shape = vg.make_shape("voronoi_fragment", seed=seed, seeds=(2, 100), boundary=boundary, aspect=(1, 1, (0.2, 5)))
        refuse_dirty(shape.vertices, shape.faces, f"seed {seed}")
        assert ConvexHull(shape.vertices).volume == pytest.approx(shape.volume, rel=1e-9)
