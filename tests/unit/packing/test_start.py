"""A start: grains that touch go on by other methods, in the same container, without overlap."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.packing.digital.initial_sites import ways_from
from voxgran.packing.draw import Request
from voxgran.packing.pack import prepare_task
from voxgran.settling.parting import spread

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
ROCKS = [vg.make_shape("convex_polyhedron", seed=seed, points=points) for seed, points in enumerate((8, 14, 30))]
GRADED = vg.sizes.uniform(0.7, 1.1)
UP = np.array([0.0, 0.0, 1.0])

pytestmark = pytest.mark.filterwarnings("ignore:.*grains were placed before")


def front_of(shapes, container, **keywords):
    """Grains of an advancing front, each touching three."""
    return vg.pack(shapes, container, method="advancing_front", sizes=GRADED, order="lowest", **keywords)


def begun(start, method, **parameters):
    """The problem and the state in which a method begins."""
    task = prepare_task(Request([], start.container, method, parameters=parameters, start=start))
    return task.problem, task.method.prepare(task.problem)


def gaps_of(packing):
    """Gaps of spheres that are near each other."""
    radius = packing.bounding_radii
    pairs = cKDTree(packing.position).query_pairs(2.1 * radius.max(), output_type="ndarray")
    apart = np.linalg.norm(packing.position[pairs[:, 0]] - packing.position[pairs[:, 1]], axis=1)
    return apart - radius[pairs].sum(axis=1)


@pytest.mark.parametrize(
    ("shapes", "container", "mode"),
    [
        (SPHERE, vg.Box((4, 4, 4)), "dense"),
        (SPHERE, vg.Box((4, 3, 4), "xy"), "loose"),
        (SPHERE, vg.Cylinder(2, 4), "dense"),
        (SPHERE, vg.Sphere(2.2), "dense"),
        (ROCKS, vg.Box((5, 5, 5)), "dense"),
        (DISK, vg.Rectangle((6, 6)), "dense"),
    ],
    ids=["box", "periodic", "cylinder", "sphere", "rocks", "disks"],
)
def test_touching_grains_go_on_by_control_points_where_they_are(shapes, container, mode):
    front = front_of(shapes, container, mode=mode)
    problem, state = begun(front, "control_point")
    there = state.arrays["position"] * problem.unit_length
    assert there == pytest.approx(front.position, abs=1e-12)
    bed = vg.pack([], container, method="control_point", start=front, sweeps=20, spacing=0.2)
    assert bed.count == front.count
    assert vg.verify(bed).ok
    assert np.linalg.norm(bed.position - front.position, axis=1).max() > 1e-3


def test_spheres_of_a_start_are_compared_exactly():
    """They come nearer than points let them: free to the last digits, and refused beyond."""
    front = front_of(SPHERE, vg.Box((4, 4, 8)), mode="loose")
    bed = vg.pack([], front.container, method="control_point", start=front, sweeps=100, spacing=0.3)
    gap = gaps_of(bed)
    assert gap.min() > -1e-11
    # what bulges between points that are 0.3 apart is 0.09, and by so much spheres without a start stay open
    assert (gap < 0.02).sum() > front.count
    assert (bed.position != front.position).any(axis=1).mean() > 0.5
    more = vg.pack(SPHERE, front.container, method="control_point", start=front, count=3, sweeps=20, spacing=0.3)
    assert more.count == front.count + 3
    assert vg.verify(more).ok


def test_a_start_that_has_to_keep_a_distance_or_overlaps_is_raised():
    box = vg.Box((3, 3, 6))
    tower = vg.Packing.of([SPHERE], box, position=[(1.5, 1.5, 0.5), (1.5, 1.5, 1.5)])
    _, state = begun(tower, "control_point", distance=0.2)
    assert state.arrays["position"][1, 2] > 1.7
    deep = vg.Packing.of([SPHERE], box, position=[(1.5, 1.5, 0.5), (1.5, 1.5, 1.4)])
    _, state = begun(deep, "control_point")
    assert state.arrays["position"][1, 2] > 1.5


@pytest.mark.parametrize("method", ["digital", "digital_rsa"])
@pytest.mark.parametrize(
    ("shapes", "container", "mode"),
    [
        (SPHERE, vg.Box((4, 4, 4)), "loose"),
        (ROCKS, vg.Cylinder(2, 4), "dense"),
        (DISK, vg.Rectangle((7, 6), "x"), "loose"),
    ],
    ids=["box", "rocks", "disks"],
)
def test_touching_grains_go_on_as_voxels_in_the_same_container(method, shapes, container, mode):
    front = front_of(shapes, container, mode=mode)
    options = {"sweeps": 20} if method == "digital" else {"orientations": 1, "turned": False}
    bed = vg.pack([], container, method=method, start=front, voxel_size=0.02, **options)
    assert bed.count == front.count
    assert vg.verify(bed).ok
    if method != "digital":
        # nothing moves there but to make room for voxels
        wide = bed.container.bounds[1] - bed.container.bounds[0]
        way = bed.position - front.position
        way -= np.where(bed.container.periodic, np.rint(way / np.maximum(wide, 1e-9)) * wide, 0.0)
        assert np.linalg.norm(way, axis=1).max() < 0.3


def test_dense_spheres_go_on_as_fine_voxels_and_coarse_ones_are_refused():
    front = front_of(SPHERE, vg.Box((3, 3, 3)), mode="dense")
    with pytest.raises(InputError, match=r"of start finds no place .* finer voxels"):
        begun(front, "digital", voxel_size=0.05)
    _, state = begun(front, "digital", voxel_size=0.01, orientations=1)
    assert (state.arrays["member"] >= 0).all()


def test_spreading_opens_all_gaps_by_the_least_motion():
    """A row of spheres between two walls: the gaps can only be equal."""
    box = vg.Box((3.4, 1.2, 1.2))
    row = vg.Packing.of([SPHERE], box, position=[(k + 0.5, 0.6, 0.6) for k in range(3)])
    after = spread(row, 0.1, UP)
    assert after.position[:, 0] == pytest.approx([0.6, 1.7, 2.8], abs=0.01)
    assert after.position[:, 1:] == pytest.approx(0.6, abs=1e-12)
    # the heavier one moves less
    two = vg.Packing.of([SPHERE], vg.Box((9, 9, 9)), position=[(4, 4, 4), (5.5, 4, 4)], scale=[2, 1])
    way = np.linalg.norm(spread(two, 0.1, UP).position - two.position, axis=1)
    assert way.sum() == pytest.approx(0.1, abs=0.01)
    assert way[1] / way[0] == pytest.approx(8, rel=0.01)
    wide = front_of(ROCKS, vg.Box((5, 5, 5), "x"), mode="dense")
    there = spread(wide, 0.05, UP)
    opened = vg.Packing.of(
        wide.shapes,
        wide.container,
        position=there.position,
        scale=wide.scale,
        shape_id=wide.shape_id,
        orientation=wide.orientation,
    )
    assert opened.contacts(0.1).gap.min() > 0.049


def test_ways_are_the_nearest_first():
    ways = ways_from(np.array([0, 0, -1]), np.array([9, 9, 9]), raised=False)
    assert ways[0].tolist() == [0, 0, 0]
    assert ways[1].tolist() == [0, 0, 1]
    length = np.linalg.norm(ways, axis=1)
    assert (np.diff(length) >= 0).all()
    assert len(np.unique(ways, axis=0)) == len(ways) == 33
    flat = ways_from(np.zeros(3, dtype=np.int64), np.array([9, 9, 1]), raised=False)
    assert not flat[:, 2].any()
    assert flat[1].tolist() == [0, 1, 0]
    assert ways_from(np.array([1, 0, 0]), np.array([4, 9, 9]), raised=True).tolist() == [[-k, 0, 0] for k in range(5)]


@pytest.mark.parametrize("method", ["rsa", "random_apollonian", "gravity"])
def test_a_start_beyond_a_smaller_container_is_refused_by_its_grains(method):
    sphere = vg.shapes.sphere()
    start = vg.Packing.of(sphere, vg.Box((6, 6, 6)), position=[(1, 1, 1), (5, 1, 1), (1, 5, 1), (2.5, 1, 1)])
    with pytest.raises(InputError, match=r"start reaches beyond the container, a Box: .* grains 1, 2 "):
        vg.pack(sphere, vg.Box((4, 4, 4)), method, count=3, start=start)
