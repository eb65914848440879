"""Grains poured through an inlet, batch by batch."""

import math

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran.measures.registered.repose import repose

BALL, DISK = vg.shapes.sphere(), vg.make_shape("disk")
TABLE = vg.Rectangle((30, 14))
MIXED = vg.sizes.uniform(0.8, 1.2)


def pour_disks(friction, **more):
    return vg.pour(DISK, TABLE, 100, batch=25, sizes=MIXED, friction=friction, **more)


@pytest.fixture(scope="module")
def heap():
    return pour_disks(0.5, seed=1)


def test_a_heap_stands_below_the_inlet(heap):
    assert heap.count == sum(heap.provenance["batches"]) == 100
    assert heap.provenance["missed"]["count"] == 0
    assert vg.verify(heap).ok
    assert vg.equilibrium(heap).attrs["share_at_rest"] > 0.95
    # single disks have rolled to the walls
    assert np.median(np.abs(heap.position[:, 0] - 15.0)) < 5.0
    # over seeds the median scatters by a standard deviation of 0.5
    assert np.median(heap.position[:, 0]) == pytest.approx(15.0, abs=1.5)


@pytest.mark.slow
def test_friction_makes_heaps_steeper(heap):
    # frictionless disks run to the walls; with seed 1 one lies on top, and the flank of 2.07 diameters has two points
    flat, steep = repose(pour_disks(0.0, seed=3)), repose(heap)
    assert abs(flat.angle) < 12.0
    assert steep.angle > flat.angle + 10.0
    assert steep.height > 1.5 * flat.height
    assert heap.measure("repose").angle_of_repose == steep.angle


@pytest.mark.parametrize(
    ("inlet", "within"),
    [
        (vg.Inlet(radius=1.2, center=(2.0, 6.0, 0.0), height=5.0), lambda x, y: np.hypot(x - 2.0, y - 6.0) < 1.2),
        (
            vg.Inlet(lengths=(2.0, 4.0), center=(2.0, 3.0, 0.0), height=5.0),
            lambda x, y: (abs(x - 2) < 1) & (abs(y - 3) < 2),
        ),
    ],
)
def test_seeds_lie_in_the_column_above_the_height(inlet, within):
    container = vg.Box((8, 8, 12), periodic="x")
    begun = vg.pack(BALL, container, "gravity", count=12, inlet=inlet, time_limit=0.0)
    x, y, z = begun.position.T
    assert begun.count == 12
    assert within(x, y).all()
    assert z.min() > 5.0


def test_later_batches_begin_above_the_bed_and_upon_a_start():
    below = vg.pack(BALL, vg.Box((4, 4, 9)), "gravity", count=8, density=2.0)
    small = vg.shapes.sphere(diameter=0.6)
    bed = vg.pour(small, below.container, 6, batch=3, start=below, obstacles=bar(), density=3.0)
    assert bed.provenance["batches"] == [3, 3]
    assert bed.count == 15
    assert bed.diameters[-6:] == pytest.approx(0.6)
    assert bed.densities[-6:] == pytest.approx(3.0)
    assert bed.fixed.sum() == 1
    assert vg.verify(bed).ok


def bar():
    return vg.Packing.of(BALL, vg.Box((4, 4, 9)), position=[(0.8, 0.8, 7.0)])


def test_weights_are_those_of_all_batches():
    shapes = [BALL, vg.shapes.sphere(diameter=0.8)]
    bed = vg.pour(shapes, vg.Box((5, 5, 9)), 20, batch=10, weights=[0, 1])
    assert bed.shape_id.tolist() == [1] * 20
    assert len(bed.shapes) == 2


@pytest.mark.slow
def test_a_container_that_is_full_below_the_inlet():
    with pytest.warns(
        PackingWarning, match=r"of 100 grains were poured: the container is full below the inlet"
    ) as told:
        bed = vg.pour(DISK, vg.Rectangle((5, 4)), 100, inlet=vg.Inlet(radius=1.0), friction=0.3)
    assert len(told) == 1
    assert bed.stop_reason == "full"
    assert bed.provenance["batches"][-1] == 0
    assert bed.provenance["missed"]["count"] == 100 - bed.count
    assert vg.verify(bed).ok
    # nothing has room below the inlet any more
    assert bed.position[:, 1].max() > 2.5


@pytest.mark.parametrize(
    ("inlet", "container", "sentence"),
    [
        ({"radius": 0.4}, None, "inlet is 0.8 wide, and the largest grain is 1: grains do not pass it; make it wider"),
        ({"radius": 3}, None, "inlet runs from -0.5 to 5.5 along x: it must lie within the bounds of the container"),
        ({"radius": 1, "center": (2.5, 4.6, 0)}, None, "inlet runs from 3.6 to 5.6 along y: it must lie within"),
        ({"radius": 1, "height": 6}, None, "height of inlet is 6, and the container is 6 high along gravity"),
        ({"radius": 1, "lengths": (2, 2)}, None, "an inlet is a disk or a rectangle; give one"),
        ({"radius": -1}, None, "radius is -1"),
        ({"lengths": (2, 2)}, vg.Rectangle((5, 6)), "an inlet is a rectangle in three dimensions"),
        (
            {"radius": 0.6, "center": (4.3, 4.3, 0)},
            vg.Cylinder(5, 6),
            "inlet lies within walls: no grain has room below",
        ),
    ],
)
def test_inlets_that_cannot_be(inlet, container, sentence):
    container = container or vg.Box((5, 5, 6))
    shape = DISK if container.dimension == 2 else BALL
    with pytest.raises(InputError, match=sentence):
        vg.pour(shape, container, 5, inlet=vg.Inlet(**inlet))


def test_what_has_no_meaning_for_batches():
    with pytest.raises(InputError, match="height is given: grains are poured by a count alone"):
        vg.pour(BALL, vg.Box((5, 5, 6)), 5, height=3)
    with pytest.raises(InputError, match="inlet is 2"):
        vg.pour(BALL, vg.Box((5, 5, 6)), 5, inlet=2)


def test_an_interrupted_pour_ends(heap):
    bed = vg.pour(DISK, TABLE, 100, batch=25, time_limit=0.0)
    assert bed.stop_reason == "interrupted"
    assert len(bed.provenance["batches"]) == 1
    assert math.isfinite(bed.position.sum())


@pytest.mark.filterwarnings("ignore:the bulk holds")
def test_a_scene_has_an_inlet_in_a_table(tmp_path):
    scene = vg.Scene.from_mapping(
        {
            "scene": {"seed": 3},
            "shape": [{"family": "sphere"}],
            "container": {"kind": "box", "lengths": [8, 8, 8]},
            "packing": {"method": "gravity", "count": 10, "inlet": {"radius": 1.5, "center": [2, 2, 0]}},
            "measure": {"which": ["density"]},
            "output": {"vtk": False, "report": False, "statistics": False},
        }
    )
    assert vg.Scene.from_mapping(scene.to_mapping()) == scene
    position = scene.run(tmp_path / "out").packing.position
    inlet = vg.Inlet(radius=1.5, center=(2, 2, 0))
    called = vg.pack(BALL, vg.Box((8, 8, 8)), "gravity", count=10, inlet=inlet, seed=3)
    assert called.position.tobytes() == position.tobytes()


def test_a_bed_that_reaches_across_a_periodic_side_is_below_the_inlet():
    inlet, container = vg.Inlet(radius=1.0, center=(1.0, 4.0, 0.0)), vg.Box((8, 8, 12), periodic="x")
    column = vg.Packing.of(BALL, container, position=[(7.8, 4.0, 0.5 + k) for k in range(4)])
    begun = vg.pack(BALL, container, "gravity", count=3, inlet=inlet, start=column, time_limit=0.0)
    assert begun.position[4:, 2].min() > 4.0


def test_gravity_along_a_vector_and_an_inlet_on_a_slope():
    down = (0.6, 0.0, -0.8)
    inlet = vg.Inlet(radius=1.2, center=(3.0, 4.0, 4.0))
    begun = vg.pack(BALL, vg.Box((8, 8, 8)), "gravity", count=8, inlet=inlet, gravity=down, time_limit=0.0)
    offset = begun.position - inlet.center
    away = np.linalg.norm(np.cross(offset, down), axis=1)
    assert begun.count == 8
    assert away.max() < 1.2


def test_a_doubt_is_told_once():
    hopper = vg.Hopper(radius=4, outlet=1.5, angle=60, bin_height=3)
    with pytest.warns(PackingWarning, match="it will arch once it is opened") as told:
        bed = vg.pour(BALL, hopper, 20, batch=10, friction=0.3)
    assert len(told) == 1
    assert bed.provenance["batches"] == [10, 10]
    assert vg.verify(bed).ok
