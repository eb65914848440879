"""Gravity and contact gap as fields of a packing: what methods set, and how they are given."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.containers.gravity import proposed_axis
from voxgran.measures.registered.coordination import usual_gap

BALL, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
BOX = vg.Box((4, 4, 6))


def of(gravity, container=BOX, shape=BALL):
    return vg.Packing.of([shape], container, position=np.zeros((0, 3)), gravity=gravity).gravity


def test_directions():
    assert of("-z") == of((0, 0, -1)) == of(np.array([0, 0, -2.5])) == of("down") == (0.0, 0.0, -1.0)
    assert of("+x") == (1.0, 0.0, 0.0)
    assert of((3, 0, -4)) == (0.6, 0.0, -0.8)
    assert of(None) is of("none") is None
    assert of("down", vg.Rectangle((4, 4)), DISK) == (0.0, -1.0, 0.0)
    assert of("down", vg.Box((4, 4, 6), "z")) is None
    assert vg.Packing.of([BALL], BOX, position=[(1, 1, 1)]).gravity == (0.0, 0.0, -1.0)
    unit = np.array([1.0, 2.0, -3.0]) / np.linalg.norm([1.0, 2.0, -3.0])
    assert of(of(unit)) == of(unit) == tuple(unit.tolist())
    assert "-" not in str(of((-0.0, 0, 1)))


@pytest.mark.parametrize(
    ("gravity", "words"),
    [
        ("z", "gravity is 'z': it must be a vector or one of -x, "),
        ("sideways", "gravity is 'sideways'"),
        ((0, 0, 0), r"gravity is \[0.0, 0.0, 0.0\]: it must be finite, not 0"),
        ((0, 0), "gravity has shape"),
        ((0, np.nan, 1), "gravity is nan"),
        ((1, 0, -1), "no part along a periodic axis"),
        ("-x", "must point along a walled axis"),
    ],
)
def test_what_is_no_direction_is_refused(gravity, words):
    with pytest.raises(InputError, match=words):
        of(gravity, vg.Box((4, 4, 6), "x"))


@pytest.mark.parametrize(
    ("container", "axis"),
    [
        (BOX, "-z"),
        (vg.Box((4, 4, 6), "xy"), "-z"),
        (vg.Box((4, 4, 6), "z"), "-x"),
        (vg.Box((4, 4, 6), "xz"), "-y"),
        (vg.Box((4, 4, 6), True), "-z"),
        (vg.Rectangle((4, 4)), "-y"),
        (vg.Rectangle((4, 4), "y"), "-x"),
        (vg.Disk(2), "-y"),
        (vg.Polygon([(0, 0), (4, 0), (0, 4)]), "-y"),
    ],
)
def test_messages_propose_a_direction_along_an_axis_with_walls(container, axis):
    shape = BALL if container.dimension == 3 else DISK
    assert proposed_axis(container) == axis
    packing = vg.Packing.of([shape], container, position=np.zeros((0, 3)), gravity=None)
    with pytest.raises(InputError, match=f"packing.gravity is None: .*; give gravity='{axis}' along an axis that has"):
        vg.settle(packing)
    usual = (0, 0, -1) if container.dimension == 3 else (0, -1, 0)
    with pytest.raises(InputError, match=f"gravity={usual}".replace("(", r"\(").replace(")", r"\)")):
        vg.equilibrium(packing)
    with pytest.raises(InputError, match=rf"packs without gravity here; .* settle\(packing, gravity='{axis}'\)"):
        vg.pack(shape, container, "rsa", count=1, settle=True)


def test_the_contact_gap_is_a_length():
    with pytest.raises(InputError, match="contact_gap is -1: it must be finite and at least 0"):
        vg.Packing.of([BALL], BOX, position=[(1, 1, 1)], contact_gap=-1)


#: method, parameters, gravity and contact gap of what it hands over, for spheres of 2
METHODS = [
    ("rsa", {}, None, 0.0),
    ("advancing_front", {}, None, 0.0),
    ("advancing_front", {"order": "lowest"}, (0.0, 0.0, -1.0), 0.0),
    ("digital_rsa", {"voxel_size": 0.25}, None, 0.25),
    ("digital_fill", {"voxel_size": 0.25, "gravity": "+y"}, (0.0, 1.0, 0.0), 0.25),
    ("digital_fill", {"voxel_size": 0.25, "place": "wall"}, None, 0.25),
    ("digital", {"voxel_size": 0.25, "sweeps": 2, "gravity": (0, 3, -4), "settle": False}, (0.0, 0.6, -0.8), 0.25),
    ("digital", {"voxel_size": 0.25, "sweeps": 2, "gravity": "none"}, None, 0.25),
    ("control_point", {"spacing": 0.25, "sweeps": 2, "settle": False}, (0.0, 0.0, -1.0), 0.5),
]


@pytest.mark.parametrize(("method", "parameters", "gravity", "gap"), METHODS)
def test_every_method_says_where_gravity_acts_and_what_it_leaves_open(method, parameters, gravity, gap):
    sizes = vg.sizes.fixed(2.0)
    packing = vg.pack(BALL, vg.Box((8, 8, 10)), method=method, count=5, sizes=sizes, **parameters)
    assert packing.gravity == gravity
    assert packing.contact_gap == pytest.approx(gap, rel=1e-12)
    assert packing.asked_sizes == sizes
    assert usual_gap(packing) == pytest.approx(max(0.01, gap / 2))
    again = vg.inscribe(packing, vg.make_shape("box"))
    assert (again.gravity, again.contact_gap, again.asked_sizes) == (gravity, packing.contact_gap, sizes)
    assert vg.grow(packing).gravity == gravity


def test_a_front_that_begins_anywhere_in_a_narrow_box_takes_the_lowest_place():
    narrow = vg.pack(BALL, vg.Box((6, 6, 1)), method="advancing_front", order="random", count=5)
    assert narrow.provenance["counters"]["narrow"] == 1
    assert narrow.gravity == (0.0, 0.0, -1.0)


@pytest.mark.slow
def test_a_bed_measures_the_same_however_gravity_was_told():
    """200 spheres by control_point: the free surface stands at half the height."""
    found = [
        vg.pack(BALL, vg.Box((5, 5, 16), "xy"), method="control_point", count=200, sweeps=60, cycles=1, gravity=gravity)
        for gravity in ("-z", (0, 0, -1), (0, 0, -2.5))
    ]
    bulk = [float(vg.measure(packing, which=["density"]).bulk_solid_fraction) for packing in found]
    assert bulk[0] == bulk[1] == bulk[2]
    # of the whole box it would be that of all grains
    assert bulk[0] > 0.4 > 0.3 > found[0].solid_fraction
    assert {packing.gravity for packing in found} == {(0.0, 0.0, -1.0)}


def test_the_bed_of_a_scan_has_no_gravity_and_touches_within_a_voxel():
    image = np.zeros((20, 12, 12), dtype=np.int64)
    image[2:9, 2:10, 2:10], image[10:18, 2:10, 2:10] = 1, 2
    packing = vg.packing_of_labels(image, voxel_size=(0.1, 0.1, 0.2), unit="mm")
    assert packing.gravity is None
    # the edge of the cube of the volume of a voxel
    assert packing.contact_gap == pytest.approx(0.002 ** (1 / 3))
    assert packing.unit == "mm"
