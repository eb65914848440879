"""Spherocylinders: all points within a radius of a segment, so that gaps are distances of segments minus radii."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.contacts.broad import grain_pairs
from voxgran.contacts.find import contacts_of_pairs, find_contacts
from voxgran.geometry.rotation import random_rotations

ROD = vg.shapes.spherocylinder(radius=0.5, height=2.4)
HALF, RADIUS = 0.7, 0.5


def segment_distance(start, way, other_start, other_way):
    """Return the distance of two segments: the least of a quadratic form, in the unit square or on its edges."""
    gap = other_start - start
    found = []
    matrix = np.array([[way @ way, -way @ other_way], [-way @ other_way, other_way @ other_way]])
    if np.linalg.det(matrix) > 1e-12:
        share = np.linalg.solve(matrix, [way @ gap, -other_way @ gap])
        if ((share >= 0) & (share <= 1)).all():
            found.append(share)
    for end in (0.0, 1.0):
        found.append((end, np.clip((end * way - gap) @ other_way / (other_way @ other_way), 0, 1)))
        found.append((np.clip((gap + end * other_way) @ way / (way @ way), 0, 1), end))
    return min(np.linalg.norm(gap + t * other_way - s * way) for s, t in found)


def rods(count, edge, seed, periodic="xyz"):
    generator = stream(seed, "rods")
    return vg.Packing.of(
        [ROD],
        vg.Box((edge,) * 3, periodic),
        position=generator.uniform(0, edge, (count, 3)),
        orientation=random_rotations(generator, count),
        scale=generator.uniform(0.5, 1.5, count),
        gravity=None,
    )


@pytest.mark.parametrize("aligned", [False, True])
def test_gaps_are_the_distances_of_segments_less_the_radii(aligned):
    packing = rods(60, 9.0, 3)
    if aligned:
        packing = vg.Packing.of([ROD], packing.container, position=packing.position, scale=packing.scale, gravity=None)
    pairs = grain_pairs(packing, 0.5)
    found = contacts_of_pairs(packing, pairs, np.inf)
    axis, depths = packing.matrices[:, :, 2] * (HALF * packing.scale)[:, None], 0
    for i, j, offset, gap in zip(found.i, found.j, pairs.offset, found.gap, strict=True):
        away = segment_distance(-axis[i], 2 * axis[i], offset - axis[j], 2 * axis[j])
        one, other = RADIUS * packing.scale[i], RADIUS * packing.scale[j]
        # no point is deeper in a grain than its axis
        depth = -max(min(one + other - away, one), min(one + other - away, other))
        assert gap == pytest.approx(away - one - other if away > one + other else depth, abs=1e-12)
        depths += gap < 0
    assert 20 < depths < found.count - 20


def test_rods_side_by_side_and_end_to_end():
    upright = (1.0, 0.0, 0.0, 0.0)
    for place, gap in (((1.0 + 1e-7, 0, 0.3), 1e-7), ((0, 0, 2.4 + 1e-7), 1e-7), ((0, 0, 2.3), -0.1)):
        pair = vg.Packing.of(
            [ROD], vg.Box((9, 9, 9)), position=[(3, 3, 3), np.add(place, 3)], orientation=[upright] * 2, gravity=None
        )
        assert find_contacts(pair, 1.0).gap[0] == pytest.approx(gap, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "lid"), [(0.0, None), (0.1, {"weight": 10.0})])
def test_rods_rest_without_friction_and_below_a_heavy_lid(friction, lid):
    """Meshes of these solids go on rolling from facet to facet."""
    rod = vg.shapes.spherocylinder(aspect=2)
    way = {} if lid is None else {"lid": lid}
    bed = vg.pack(rod, vg.Box((3.5, 3.5, 12)), "gravity", count=24, seed=1, friction=friction, **way)
    assert bed.stop_reason == "settled"
    assert bed.provenance["settling"]["resting"] >= 0.95
    assert bed.verify().ok


@pytest.mark.slow
def test_long_rods_with_little_friction_rest():
    """Steps of one length would move some of them to and fro between two poses for ever."""
    bed = vg.pack(vg.shapes.spherocylinder(aspect=5), vg.Box((5, 5, 40)), "gravity", count=60, seed=2, friction=0.05)
    assert bed.provenance["settling"]["resting"] >= 0.95


def test_a_pair_that_is_refused_is_named_once():
    """Rods one in the other have several contacts."""
    turn = (0.5**0.5, 0.5**0.5, 0, 0)
    both = vg.Packing.of([ROD], vg.Box((9, 9, 9)), position=[(4, 4, 4)] * 2, orientation=[turn] * 2, gravity="-z")
    with pytest.raises(vg.VoxgranError, match="grains 0 and 1 overlap by"):
        vg.settle(both)


def test_rods_on_rods_and_on_a_floor_lie_on_two_points():
    """Three rods lie across four others, and stay where they are laid."""
    turns = np.array([(0.5**0.5, 0, 0.5**0.5, 0)] * 4 + [(0.5**0.5, 0.5**0.5, 0, 0)] * 3)
    places = [(2.0, 0.8 + 1.1 * k, 0.5) for k in range(4)] + [(0.9 + 1.1 * k, 2.4, 1.5) for k in range(3)]
    long = vg.shapes.spherocylinder(radius=0.5, height=4.0)
    laid = vg.Packing.of([long], vg.Box((5, 5, 6)), position=places, orientation=turns, gravity="-z")
    bed = vg.settle(laid, friction=0.3)
    assert bed.provenance["settling"]["resting"] == 1.0
    np.testing.assert_allclose(bed.position, places, atol=5e-3)
    assert np.abs(bed.matrices[:4, 2, 2]).max() < 1e-3


def test_rods_among_rocks_rest():
    shapes = [vg.shapes.spherocylinder(aspect=2.5), vg.make_shape("solid_union", seed=2, chord_error=0.02)]

    def meet(seed):
        bed = vg.pack(shapes, vg.Box((3, 3, 8)), "gravity", count=14, seed=seed, friction=0.5)
        assert bed.verify().ok
        # 12 moved starts: all grains
        assert bed.provenance["settling"]["resting"] >= 0.9
        touching = bed.contacts(1e-3)
        return (bed.shape_id[touching.i] != bed.shape_id[touching.j]).any()

    # in one of 12 beds rods touch rods only, and rocks rocks
    assert any(meet(seed) for seed in range(2, 7))
