"""Chords of the pore space: closed formulas, all shapes, walls, surfaces of beds, rates of convergence, porespy."""

import itertools
import math

import numpy as np
import pytest

import voxgran as vg
from voxgran.geometry.rotation import rotation_matrices
from voxgran.measures.crossings import Lines, grain_intervals, outside_intervals
from voxgran.measures.pores import pores_of
from voxgran.measures.registered.voids import _gaps, chords_along

SPHERE = vg.make_shape("sphere")
BRICK = vg.make_shape("box", lengths=(3, 2, 4))
TURN = np.array([0.5, 0.1, -0.7, 0.5]) / np.linalg.norm([0.5, 0.1, -0.7, 0.5])


def spheres(seed=1, fraction=0.3, edge=4.0):
    """Return spheres at random in a periodic box."""
    return vg.pack([SPHERE], vg.Box((edge,) * 3, periodic="xyz"), "rsa", solid_fraction=fraction, seed=seed)


def by_surface(packing):
    """Return 4 void volume / surface, which in spheres is the mean chord along each axis."""
    return 4 * (packing.container.volume - packing.volumes.sum()) / packing.surface_areas.sum()


def alone(shape, edge=3.0, periodic="xyz", turn=TURN):
    """Return one grain in the middle of a box, or of a rectangle."""
    if shape.dimension == 2:
        turn = (math.cos(0.2), 0, 0, math.sin(0.2))
        return vg.Packing.of(
            [shape], vg.Rectangle((edge,) * 2, periodic="xy"), position=[[1.4, 1.5, 0]], orientation=[turn]
        )
    box = vg.Box((edge,) * 3, periodic=periodic)
    return vg.Packing.of([shape], box, position=[[1.4, 1.5, 1.6]], orientation=[turn])


def test_spheres_have_the_chord_of_their_surface_within_the_error():
    deviations = []
    for seed in range(12):
        packing = spheres(seed)
        found = [chords_along(packing, axis, 0.05) for axis in range(3)]
        deviations += [(one.mean / by_surface(packing) - 1, one.error / one.mean) for one in found]
    missed, errors = np.array(deviations).T
    # the voxels that were used before gave 0.056
    assert abs(missed.mean()) < 5e-4
    assert np.abs(missed).max() < 5e-3
    assert 0.3 < math.sqrt((missed**2).mean() / (errors**2).mean()) < 1.0


@pytest.mark.slow
def test_the_error_decays_with_the_spacing():
    sizes, missed = (0.2, 0.1, 0.05, 0.025), []
    for size in sizes:
        found = [
            chords_along(spheres(seed), k, size).mean / by_surface(spheres(seed)) for seed in range(4) for k in range(3)
        ]
        missed.append(math.sqrt(np.mean((np.array(found) - 1) ** 2)))
    # points of a lattice in a disk: the number misses by the power 3/2 of the spacing
    assert np.polyfit(np.log(sizes), np.log(missed), 1)[0] > 1.3, missed


def test_dense_spheres_of_many_sizes():
    packing = vg.pack([SPHERE], vg.Box((5, 5, 5), periodic="xyz"), "jam", count=150, sizes=vg.sizes.uniform(0.6, 1.2))
    found = np.mean([chords_along(packing, axis, 0.05).mean for axis in range(3)])
    assert found == pytest.approx(by_surface(packing), rel=2e-3)


def test_disks():
    packing = vg.pack([vg.make_shape("disk")], vg.Rectangle((20, 20), periodic="xy"), "rsa", solid_fraction=0.4, seed=1)
    expected = math.pi * (packing.container.volume - packing.volumes.sum()) / packing.surface_areas.sum()
    for axis in range(2):
        found = chords_along(packing, axis, 0.02)
        assert found.mean == pytest.approx(expected, rel=3e-3)
        assert abs(found.mean - expected) < 3 * found.error


@pytest.mark.parametrize(
    "shape",
    [
        vg.make_shape("solid_union", seed=3),
        vg.make_shape("ellipsoid", semi_axes=(0.4, 0.6, 0.8)),
        vg.make_shape("cylinder", aspect=1.5),
        vg.make_shape("cone", aspect=1.2),
        vg.make_shape("spherocylinder"),
        vg.make_shape("box", lengths=(1, 0.7, 0.8)),
        vg.make_shape("mollon_zhao_2d", seed=1),
    ],
    ids=lambda shape: shape.name,
)
def test_the_surface_seen_along_an_axis(shape):
    packing, d = alone(shape), shape.dimension
    space = packing.container.volume - packing.volumes[0]
    if d == 2:
        corners = shape.geometry.rotated(packing.matrices[0]).vertices
        seen = np.abs(np.roll(corners, -1, axis=0) - corners)[:, ::-1].sum(axis=0)
    else:
        vertices, faces = _triangles(shape, packing)
        seen = np.abs(np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2)))).sum(axis=0) / 2
    for axis in range(d):
        found = chords_along(packing, axis, 0.01 if d == 3 else 1e-4)
        assert found.mean == pytest.approx(2 * space / seen[axis], rel=4e-3), axis


def _triangles(shape, packing):
    """Return the turned triangles of a shape."""
    return shape.vertices @ packing.matrices[0].T, shape.faces


def test_round_solids_are_met_as_their_triangles():
    for shape in (
        vg.make_shape("ellipsoid", semi_axes=(0.4, 0.6, 0.8)),
        vg.make_shape("cylinder"),
        vg.make_shape("cone"),
        vg.make_shape("spherocylinder"),
    ):
        mesh = vg.Shape.from_mesh(shape.vertices, shape.faces)
        for axis in range(3):
            totals = []
            for one in (shape, mesh):
                packing = alone(one)
                lines = Lines.through(axis, *packing.container.bounds, 0.02, dimension=3)
                line, low, high = grain_intervals(packing, lines)
                assert (high > low).all()
                totals.append((len(line), (high - low).sum(), ((high + low) * (high - low)).sum()))
            assert totals[0] == pytest.approx(totals[1], rel=5e-3)


def test_clumps_are_the_union_of_their_spheres():
    clump = vg.fit_clump(vg.make_shape("ellipsoid", semi_axes=(0.4, 0.4, 0.8)), max_spheres=8).to_shape()
    packing = alone(clump)
    for axis in range(3):
        lines = lines_of(packing, axis)
        found = chords_along(packing, axis, 0.02)
        solid = 27 - found.mean * _ends(packing, axis) / 2 * float(np.prod(lines.step))
        assert solid == pytest.approx(packing.volumes[0], rel=3e-3)


def lines_of(packing, axis):
    """Return the lines of chords at a spacing of 0.02."""
    box = packing.container
    return Lines.through(axis, *box.bounds, 0.02, dimension=3)


def _ends(packing, axis):
    """Return the number of ends of the lines, those of lone runs of a plain search over the intervals of each line."""
    lines = lines_of(packing, axis)
    line, low, high = grain_intervals(packing, lines)
    # images of spheres may lie beyond the ends of the lines
    here = (high > 0) & (low < lines.high - lines.low)
    line, low, high = line[here], low[here], high[here]
    ends = 0
    for k in np.unique(line):
        order = np.argsort(low[line == k])
        starts, tops = low[line == k][order], np.maximum.accumulate(high[line == k][order])
        ends += 2 * (1 + int((starts[1:] > tops[:-1]).sum()))
    return ends


def test_gaps_against_a_plain_search():
    generator = np.random.default_rng(0)
    for around in (False, True):
        for walls in ((True, True), (True, False), (False, True)):
            if around and not all(walls):
                continue
            low = generator.uniform(-0.3, 1.2, 400)
            high, line = low + generator.uniform(0, 0.3, 400), np.sort(generator.integers(0, 150, 400))
            bounds = np.concatenate([[0], np.cumsum(np.bincount(line, minlength=150))])
            lengths, ends, found = np.zeros(150), np.zeros(150, dtype=np.int64), np.empty(550)
            arrays = low.copy(), high.copy(), bounds, 1.0, np.array(walls), around, 1e-12, lengths, ends, found
            count = _gaps(*arrays)
            expected, expected_ends = [], np.zeros(150, dtype=int)
            for k in range(150):
                gaps, _edges = _plain(low[line == k], high[line == k])
                assert lengths[k] == pytest.approx(sum(b - a for a, b in gaps))
                if around and len(gaps) > 1 and gaps[0][0] == 0 and gaps[-1][1] == 1:
                    gaps = [*gaps[1:-1], (gaps[-1][0] - 1, gaps[0][1])]
                for a, b in gaps:
                    meets = int(a != 0 or walls[0]) + int(b < 1 or walls[1])
                    if around and a == 0 and b == 1:
                        meets = 0
                    expected_ends[k] += meets
                    expected += [b - a] if meets == 2 else []
            assert np.sort(found[:count]) == pytest.approx(np.sort(expected))
            assert ends.tolist() == expected_ends.tolist()


def _plain(low, high):
    """Return the gaps of intervals in [0, 1]."""
    edges = np.unique(np.clip(np.concatenate([[0, 1], low, high]), 0, 1))
    gaps = []
    for a, b in itertools.pairwise(edges):
        if not ((low < (a + b) / 2) & (high > (a + b) / 2)).any():
            if gaps and gaps[-1][1] == a:
                gaps[-1] = (gaps[-1][0], b)
            else:
                gaps.append((a, b))
    return gaps, edges


@pytest.mark.parametrize(
    ("container", "expected"),
    [
        (vg.Box((3, 2, 2)), (3.0, 2.0, 2.0)),
        # 4 volume / surface seen: a line in a disk of radius 1 is pi / 2 long
        (vg.Cylinder(1.0, 3.0), (math.pi / 2, math.pi / 2, 3.0)),
        (vg.Sphere(1.5), (2.0, 2.0, 2.0)),
        (vg.ClosedMesh(vg.Shape.from_mesh(BRICK.vertices, BRICK.faces)), (3.0, 2.0, 4.0)),
        (vg.Disk(2.0), (math.pi, math.pi)),
        (vg.Polygon([[0, 0], [2, 0], [0, 2]]), (1.0, 1.0)),
    ],
    ids=lambda value: getattr(value, "kind", ""),
)
def test_walls_alone(container, expected):
    shape = SPHERE if container.dimension == 3 else vg.make_shape("disk")
    none = vg.Packing.of([shape], container, position=np.zeros((0, 3)))
    for axis, length in enumerate(expected):
        found = chords_along(none, axis, 0.01)
        assert found.mean == pytest.approx(length, rel=2e-3)
        assert abs(found.mean - length) <= 2 * found.error + 1e-12


class Hidden:
    """A container without walls in closed form."""

    def __init__(self, container):
        self._container = container
        self.kind, self.dimension, self.periodic = "hidden", container.dimension, container.periodic
        self.volume, self.bounds = container.volume, container.bounds
        self.signed_distance, self.mesh = container.signed_distance, container.mesh


@pytest.mark.parametrize("container", [vg.Cylinder(1.0, 3.0), vg.Sphere(1.5)], ids=lambda one: one.kind)
def test_walls_by_their_signed_distance(container):
    for axis in range(3):
        lines = Lines.through(axis, *container.bounds, 0.1, dimension=3)
        totals = []
        for one in (container, Hidden(container)):
            line, low, high = outside_intervals(one, lines)
            extent = lines.high - lines.low
            totals.append(np.bincount(line, np.clip(high, 0, extent) - np.clip(low, 0, extent), minlength=lines.count))
        assert totals[0] == pytest.approx(totals[1], abs=1e-9)


def test_the_surface_of_a_bed_ends_no_chord():
    # three layers; the height of 85 % of their volume lies in the third
    place = np.array([[i + 0.5, j + 0.5, k + 0.5] for i in range(3) for j in range(3) for k in range(3)])
    bed = vg.Packing.of([SPHERE], vg.Box((3, 3, 9)), position=place, gravity=(0, 0, -1))
    found = chords_along(bed, 2, 0.02)
    # between the layers, and to the floor: no chord is longer than from floor to the surface
    assert found.lengths.max() <= 1.0 + 1e-9
    upside = vg.Packing.of([SPHERE], vg.Box((3, 3, 9)), position=[3, 3, 9] - place, gravity=(0, 0, 1))
    for axis in range(3):
        assert chords_along(upside, axis, 0.02).mean == pytest.approx(chords_along(bed, axis, 0.02).mean, rel=3e-3)


def test_lengths_and_places():
    usual = spheres()
    for factor in (1e-9, 1e30):
        box = usual.container.scaled(factor)
        other = vg.Packing.of([SPHERE.scaled(factor)], box, position=usual.position * factor, scale=usual.scale)
        a, b = chords_along(usual, 1, 0.1), chords_along(other, 1, 0.1 * factor)
        assert b.mean / factor == pytest.approx(a.mean, rel=1e-9)
        assert len(a.lengths) == len(b.lengths)
    # a period is a period wherever it is cut
    moved = vg.Packing.of([SPHERE], usual.container, position=usual.position + 1.3, scale=usual.scale)
    assert chords_along(moved, 0, 0.02).mean == pytest.approx(chords_along(usual, 0, 0.02).mean, rel=2e-3)


def test_grains_that_touch_leave_no_gap():
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    place = np.array([[0.5, 0.5, k + 0.5] for k in range(3)]) * 0.1
    box = vg.Box((0.2, 0.1, 0.4), periodic="xyz")
    packing = vg.Packing.of([cube.scaled(0.1)], box, position=place)
    found = chords_along(packing, 2, 0.013)
    assert found.lengths == pytest.approx(0.1)
    lines = Lines.through(2, *box.bounds, 0.013, dimension=3)
    assert len(found.lengths) == (lines.across[0] < 0.1).sum()  # the lines through the column


def test_few_lines_have_no_error():
    between_walls = vg.Packing.of([SPHERE], vg.Box((3, 3, 3)), position=[(1.5, 1.5, 1.5)])
    assert math.isnan(chords_along(between_walls, 0, 2.9).error)
    none = vg.Packing.of([SPHERE], vg.Box((2, 2, 2), periodic="xyz"), position=np.zeros((0, 3)))
    assert (chords_along(none, 0, 0.5).mean, chords_along(none, 0, 0.5).error) == (math.inf, 0.0)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_chords_of_porespy_tend_to_the_exact_ones():
    porespy = pytest.importorskip("porespy")
    packing, found = spheres(), []
    exact = chords_along(packing, 0, 0.025)
    for size in (0.1, 0.05, 0.025):
        lines = porespy.filters.apply_chords(pores_of(packing, size).mask, axis=0, spacing=0, trim_edges=False) > 0
        found.append(2 * lines.sum() * size / (lines != np.roll(lines, 1, axis=0)).sum() / exact.mean - 1)
    # runs of voxels miss the shortest chords
    assert 4e-3 > found[0] > found[1] > found[2] > -2 * exact.error / exact.mean
    assert found[2] < 0.2 * found[0]


def test_all_orders_of_the_axes():
    turned = rotation_matrices(TURN[None])[0]
    assert np.linalg.det(turned) == pytest.approx(1)
    shape = vg.make_shape("ellipsoid", semi_axes=(0.4, 0.6, 0.8))
    packing = alone(shape)
    for axis in range(3):
        lines = Lines.through(axis, *packing.container.bounds, 0.02, dimension=3)
        line, low, high = grain_intervals(packing, lines)
        u, v = (one[line] for one in lines.across)
        for end in (low, high):
            points = np.zeros((len(line), 3))
            points[:, lines.axes[0]], points[:, lines.axes[1]], points[:, axis] = u, v, end + lines.low
            inner = (points - packing.position[0]) @ packing.matrices[0]
            assert ((inner / np.array(shape.geometry.dimensions)) ** 2).sum(axis=1) == pytest.approx(1, abs=1e-9)


def test_lines_meet_spheres_and_boxes_as_in_a_plain_search():
    generator = np.random.default_rng(3)
    for shape, count in ((SPHERE, 5), (vg.make_shape("box", lengths=(0.9, 0.7, 0.8)), 3)):
        place = generator.uniform(0.6, 2.4, (count, 3))
        packing = vg.Packing.of([shape], vg.Box((3, 3, 3)), position=place)
        for axis in range(3):
            lines = Lines.through(axis, *packing.container.bounds, 0.1, dimension=3)
            line, low, high = grain_intervals(packing, lines)
            aside = np.stack(lines.across, axis=1)[:, None] - place[:, lines.axes[:2]]
            if shape is SPHERE:
                half = np.sqrt(np.maximum(0.25 - (aside**2).sum(axis=2), 0))
            else:
                sides = np.array([0.9, 0.7, 0.8])[list(lines.axes)] / 2
                half = sides[2] * (np.abs(aside) < sides[:2]).all(axis=2)
            at, grain = np.nonzero(half)
            expected = np.stack([at, place[grain, axis] - half[at, grain], place[grain, axis] + half[at, grain]])
            found = np.stack([line, low, high])
            order, mine = np.lexsort((expected[1], at)), np.lexsort((low, line))
            assert found[:, mine] == pytest.approx(expected[:, order], abs=1e-8)


def test_lines_are_spread_over_the_box_and_over_its_projections():
    lower, upper = np.array([0.0, 1.0, 2.0]), np.array([3.0, 3.0, 6.0])
    for axis in range(3):
        lines = Lines.through(axis, lower, upper, 0.1, dimension=3)
        across = (np.stack(lines.across, axis=1) - lower[list(lines.axes[:2])]) / (upper - lower)[list(lines.axes[:2])]
        area = float(np.prod((upper - lower)[list(lines.axes[:2])]))
        assert lines.count == pytest.approx(area / 0.01, rel=0.15)
        # seen along the rows and across them, the lines have no two alike, and no wide gaps: a square lattice of the
        # same number has gaps of 1 / 20 to 1 / 40
        for places in across.T:
            assert 0 < places.min() < places.max() < 1
            assert np.diff(np.unique(places)).max() < 0.01


def lattice_of(shape, count, spacing):
    """Return grains on a cubic lattice, periodic."""
    place = np.indices((count,) * 3).reshape(3, -1).T * spacing
    return vg.Packing.of([shape], vg.Box((count * spacing,) * 3, periodic="xyz"), position=place)


@pytest.mark.parametrize("size", [0.1, 0.05, 0.0403])
@pytest.mark.parametrize("kind", ["cubes", "one cube", "spheres"])
def test_the_error_of_aligned_grains_is_told_wherever_they_lie(kind, size):
    cube = vg.make_shape("box", lengths=(0.806,) * 3)
    shape, count, spacing = {"cubes": (cube, 3, 1.0075), "one cube": (cube, 1, 1.3), "spheres": (SPHERE, 3, 1.0)}[kind]
    packing = lattice_of(shape, count, spacing)
    seen = math.pi / 4 if shape is SPHERE else 0.806**2
    exact = 2 * (packing.container.volume - packing.volumes.sum()) / (2 * packing.count * seen)
    generator, found = np.random.default_rng(1), []
    for _ in range(20):
        moved = vg.Packing.of([shape], packing.container, position=packing.position + generator.uniform(0, 1, 3))
        chords = chords_along(moved, 0, size)
        found.append((chords.mean - exact, chords.error))
    missed, errors = np.array(found).T
    assert (np.abs(missed) < 2 * errors).mean() >= 0.9
    assert 0.1 < math.sqrt((missed**2).mean() / (errors**2).mean()) < 1.1
    # a square lattice of lines missed by 0.012 in the root mean square, at a spacing of 0.025
    assert count == 1 or np.abs(missed).max() < 0.2 * size * exact


def test_cubes_between_walls_whose_faces_a_square_lattice_of_lines_follows():
    cube, spacing = vg.make_shape("box", lengths=(0.806,) * 3), 1.0075
    place = (np.indices((3,) * 3).reshape(3, -1).T + 0.5) * spacing
    packing = vg.Packing.of([cube], vg.Box((3 * spacing,) * 3, periodic="xz"), position=place)
    space, faces = (3 * spacing) ** 3 - 27 * 0.806**3, 27 * 0.806**2
    for axis, walls in enumerate((0.0, (3 * spacing) ** 2, 0.0)):
        found = chords_along(packing, axis, 0.05)
        exact = space / (faces + walls)
        assert abs(found.mean - exact) < min(2 * found.error, 0.006 * exact)


@pytest.mark.parametrize("spacing", [0.1, 0.05, 0.025])
def test_the_error_of_an_ordered_packing_is_told(spacing):
    # on a lattice of lines that is symmetric about the spheres, interleaved parts are equal and tell nothing
    places = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5
    packing = vg.Packing.of([SPHERE], vg.Box((3, 3, 3), periodic="xyz"), position=places)
    for axis in range(3):
        found = chords_along(packing, axis, spacing)
        assert 0.0 < abs(found.mean - (1 - math.pi / 6) / (math.pi / 4)) < 2 * found.error < 0.1 * found.mean
