"""The advancing front: against plain programs of the same rules, and by what each place promises."""

import contextlib
import heapq
import itertools
import math

import kit
import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran._base.stopping import Stopped, stopping_when
from voxgran.packing.advancing_front.method import ASIDE
from voxgran.packing.draw import Request
from voxgran.packing.pack import prepare_task

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
WIDE = vg.Box((30, 30, 30))
GRADED = vg.sizes.uniform(0.5, 1.5)

pytestmark = pytest.mark.filterwarnings("ignore:.*grains were placed before")


def pack(shape, container, **keywords):
    return vg.pack(shape, container, method="advancing_front", **keywords)


def gaps(packing, reach=1e-9):
    """Pairs whose surfaces are nearer than the reach, in mean diameters, and their gaps."""
    r = packing.bounding_radii
    pairs = cKDTree(packing.position).query_pairs(2 * r.max() + 1e-6, output_type="ndarray")
    gap = np.linalg.norm(packing.position[pairs[:, 0]] - packing.position[pairs[:, 1]], axis=1) - r[pairs].sum(axis=1)
    return pairs[gap < reach * 2 * r.mean()], gap


def touched(packing, sphere, earlier=True):
    """The spheres that a sphere touches, those before it or all."""
    r = packing.bounding_radii
    away = np.linalg.norm(packing.position - packing.position[sphere], axis=1) - r - r[sphere]
    away[sphere] = np.inf
    if earlier:
        away[sphere:] = np.inf
    return np.flatnonzero(np.abs(away) < 1e-11)


def place_on(p, q, s, radii, r):
    """Where a sphere touches three, on the side from which p, q, s are counterclockwise: by an orthonormal frame."""
    d = np.array(radii) + r
    ex = (q - p) / np.linalg.norm(q - p)
    ey = (s - p) - ((s - p) @ ex) * ex
    ey /= np.linalg.norm(ey)
    a, b, c = np.linalg.norm(q - p), (s - p) @ ex, (s - p) @ ey
    x = (d[0] ** 2 - d[1] ** 2 + a**2) / (2 * a)
    y = (d[0] ** 2 - d[2] ** 2 + b**2 + c**2 - 2 * b * x) / (2 * c)
    height = d[0] ** 2 - x**2 - y**2
    return None if height < 0 else p + x * ex + y * ey + math.sqrt(height) * np.cross(ex, ey)


def plain_front(centers, radii, goal, rank):
    """Go on from the first three spheres by the rules: the first face by rank; one sphere a face; three new faces."""
    placed, faces = [*centers[:3]], []

    def add(*face):
        heapq.heappush(faces, (rank(sum(placed[k] for k in face) / 3 - goal), len(faces), face))

    add(0, 1, 2)
    add(1, 0, 2)
    while faces and len(placed) < len(radii):
        _, _, face = heapq.heappop(faces)
        new = len(placed)
        place = place_on(*(placed[k] for k in face), radii[list(face)], radii[new])
        if place is None or min(place.min(), (30 - place).min()) < radii[new]:
            continue
        if any(np.linalg.norm(place - q) < r + radii[new] - 1e-9 for q, r in zip(placed, radii, strict=False)):
            continue
        placed.append(place)
        a, b, c = face
        for f in ((a, b, new), (b, c, new), (c, a, new)):
            add(*f)
    return np.array(placed)


@pytest.mark.parametrize("order", ["nearest", "lowest"])
def test_the_front_is_that_of_a_plain_program(order):
    packing = pack(SPHERE, WIDE, count=250, sizes=GRADED, order=order, tries=1, seed=8)
    rank = {"nearest": lambda way: way @ way, "lowest": lambda way: way[2]}[order]
    radii = packing.bounding_radii
    twin = plain_front(packing.position, radii, 15.0 + np.median(radii) * np.array(ASIDE), rank)
    assert packing.count == 250
    np.testing.assert_allclose(packing.position, twin, rtol=0, atol=1e-8)


@pytest.mark.parametrize("order", ["random", "nearest", "lowest"])
def test_each_sphere_touches_three_that_touch_each_other(order):
    packing = pack(SPHERE, WIDE, count=400, sizes=GRADED, order=order)
    for sphere in range(3, packing.count):
        partners = touched(packing, sphere)
        faces = [
            face
            for face in itertools.combinations(partners, 3)
            if all(set(face) - {k} <= set(touched(packing, k, earlier=False)) for k in face)
        ]
        assert faces
    assert vg.verify(packing).ok
    _, gap = gaps(packing)
    assert gap.min() > -2e-12


def test_no_sphere_of_that_radius_lies_nearer_to_its_face():
    """Locally densest: over a face whose three spheres touch each other none comes nearer, wherever it is put."""
    packing = pack(SPHERE, WIDE, count=60, sizes=vg.sizes.uniform(0.8, 1.2))
    generator, tested = np.random.Generator(np.random.Philox(1)), 0
    for sphere in range(3, packing.count):
        partners = touched(packing, sphere)
        if len(partners) != 3:
            continue
        corners, radii = packing.position[partners], packing.bounding_radii[partners] + packing.bounding_radii[sphere]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= np.linalg.norm(normal)
        height = (packing.position[sphere] - corners[0]) @ normal
        feet = generator.dirichlet((1, 1, 1), 400) @ corners
        foot = packing.position[sphere] - height * normal
        # where the foot lies in the face; else the sphere leans over an edge and the claim is about that edge
        shares = np.linalg.lstsq(np.vstack([corners.T, np.ones(3)]), np.append(foot, 1.0), rcond=None)[0]
        if shares.min() < 0:
            continue
        tested += 1
        square = (radii**2 - ((feet[:, None] - corners) ** 2).sum(axis=2)).max(axis=1)
        lowest = np.sqrt(np.maximum(square, 0.0))
        assert lowest.min() >= abs(height) - 1e-12
        assert lowest.min() < abs(height) + 0.2
    assert tested > 30


def best_pocket(centers, r, goal):
    """Where a sphere touches any three, overlaps none and is nearest to the goal: all triples are tried."""
    best, place = np.inf, None
    for face in itertools.permutations(range(len(centers)), 3):
        if face[0] > min(face[1:]):
            continue
        found = place_on(*(centers[k] for k in face), np.full(3, r), r)
        if found is None or np.linalg.norm(centers - found, axis=1).min() < 2 * r - 1e-9:
            continue
        square = ((found - goal) ** 2).sum()
        if square < best - 1e-9:
            best, place = square, found
    return place, best


def test_dense_takes_the_best_of_all_pockets():
    packing = pack(SPHERE, WIDE, count=18, mode="dense", seed=2)
    goal = 15.0 + 0.5 * np.array(ASIDE)
    for sphere in range(3, 18):
        _, best = best_pocket(packing.position[:sphere], 0.5, goal)
        assert ((packing.position[sphere] - goal) ** 2).sum() == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize("container", [vg.Box((8, 7, 9)), vg.Cylinder(4, 8), vg.Sphere(4.6), vg.Box((8, 7, 9), "xy")])
@pytest.mark.parametrize("order", ["nearest", "lowest"])
def test_dense_leaves_no_pocket_between_spheres_or_walls(container, order):
    """Equal spheres, filled to the end: each touches three spheres or walls, and no random place is free."""
    packing = pack(SPHERE, container, mode="dense", order=order)
    assert packing.stop_reason == "full"
    assert vg.verify(packing).ok
    contacts = packing.contacts(1e-9)
    number = np.bincount(np.concatenate([contacts.i, contacts.j]), minlength=packing.count).astype(float)
    number += (np.abs(container.signed_distance(packing.position) + 0.5) < 1e-9).astype(float)
    # corners have more than one wall: signed_distance sees the nearest only
    lower, upper = container.bounds
    near = np.abs(np.stack([packing.position - lower, upper - packing.position]) - 0.5) < 1e-9
    number = np.maximum(number, np.bincount(np.concatenate([contacts.i, contacts.j]), minlength=packing.count)
                        + near[:, :, [k for k in range(3) if not container.periodic[k]]].sum(axis=(0, 2)))  # fmt: skip
    assert (number[3:] >= 3).mean() > 0.99
    # a sphere that is free somewhere can be moved until it touches three: then it would be in a pocket
    probes = lower + np.random.Generator(np.random.Philox(6)).random((300_000, 3)) * (upper - lower)
    probes = probes[container.signed_distance(probes) <= -0.5]
    wraps = [k for k in range(3) if container.periodic[k]]
    tree = cKDTree(
        (packing.position - lower) % (upper - lower),
        boxsize=[b if k in wraps else 0 for k, b in enumerate(upper - lower)],
    )
    assert tree.query(probes - lower)[0].max() < 1.0


@pytest.mark.slow
def test_densities_and_coordination_of_equal_and_of_graded_spheres():
    """Reached here: 0.622 and 0.639 inside, 0.592 in all of the container."""
    equal = pack(SPHERE, vg.Box((60, 60, 60)), count=50_000, mode="dense")
    pairs, _ = gaps(equal)
    assert 2 * len(pairs) / equal.count == pytest.approx(6, abs=0.01)
    assert inner_fraction(equal) >= 0.61
    side = (50_000 * math.pi / 6 * 1.25 / 0.6) ** (1 / 3)
    graded = pack(SPHERE, vg.Box((side,) * 3), sizes=GRADED, mode="dense")
    assert graded.stop_reason == "full"
    assert graded.count > 48_000
    assert inner_fraction(graded) >= 0.63
    assert graded.solid_fraction >= 0.59
    assert graded.provenance["missed"]["gradation"] <= 0.01
    assert vg.verify(graded).ok


def inner_fraction(packing, samples=100_000):
    """Share of random points in a sphere of half the size of the packing about its middle that lie in a grain."""
    low, high = packing.position.min(axis=0), packing.position.max(axis=0)
    generator = np.random.Generator(np.random.Philox(9))
    ways = generator.normal(size=(samples, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    points = (low + high) / 2 + ways * ((high - low).min() / 4 * generator.random((samples, 1)) ** (1 / 3))
    radii = np.append(packing.bounding_radii, 0.0)
    away, grain = cKDTree(packing.position).query(points, k=16, distance_upper_bound=radii.max())
    return float((away <= radii[grain]).any(axis=1).mean())


def test_disks():
    packing = pack(DISK, vg.Rectangle((40, 30)), sizes=GRADED, mode="dense")
    assert vg.verify(packing).ok
    assert (packing.position[:, 2] == 0).all()
    assert packing.solid_fraction > 0.78
    pairs, gap = gaps(packing)
    assert gap.min() > -2e-12
    number = np.bincount(pairs.ravel(), minlength=packing.count)
    away = vg.Rectangle((40, 30)).signed_distance(packing.position) + packing.bounding_radii
    assert (number + (np.abs(away) < 1e-9) >= 2).all()
    loose = pack(DISK, vg.Rectangle((40, 30), "x"), sizes=GRADED)
    assert vg.verify(loose).ok
    assert loose.solid_fraction > 0.70
    # every disk but the first two touches two that are there
    assert all(len(touched(loose, sphere)) >= 2 for sphere in range(2, 60))


def test_grains_inside_a_scan_do_not_protrude():
    rock = vg.ClosedMesh(vg.make_shape("solid_union", seed=7, solids=4).scaled(14.0))
    for mode in ("loose", "dense"):
        packing = pack(SPHERE, rock, sizes=GRADED, mode=mode)
        beyond = rock.signed_distance(packing.position) + packing.bounding_radii
        assert beyond.max() <= 1e-9
        # a map of clearances decides far from the walls only: near them the true distance does
        assert beyond.max() > -0.05
        assert vg.verify(packing).ok
        assert packing.solid_fraction > {"loose": 0.3, "dense": 0.4}[mode]


def test_other_shapes_lie_in_their_spheres():
    cone = vg.make_shape("cone")
    packing = pack([cone, SPHERE], vg.Box((9, 9, 9)), sizes=GRADED, mode="dense", seed=1)
    assert vg.verify(packing).ok
    assert np.abs(packing.orientation[packing.shape_id == 0] - [1, 0, 0, 0]).max() > 0.5
    pairs, gap = gaps(packing)
    assert gap.min() > -1e-11
    assert 2 * len(pairs) / packing.count > 4.5
    kites = pack(vg.make_shape("polygon", corners=5), vg.Rectangle((20, 20)))
    assert vg.verify(kites).ok
    assert np.abs(kites.orientation[:, 1:3]).max() == 0


def test_the_gradation_of_what_is_placed_is_that_which_was_asked():
    """No more than `tries` grains wait longer than it is their turn: the distance is that of a random sample."""
    two = vg.sizes.discrete([0.6, 1.4], [0.5, 0.5])
    for tries in (1, 5, 20):
        packing = pack(SPHERE, vg.Box((14, 14, 14)), sizes=two, mode="dense", tries=tries)
        drawn = 1.5 / math.sqrt(packing.count)
        assert packing.provenance["missed"]["gradation"] <= drawn + tries / packing.count
    assert pack(SPHERE, WIDE, count=500, sizes=two).provenance["missed"]["gradation"] == 0


def test_what_was_missed_is_said():
    with pytest.warns(PackingWarning, match="of 900 grains were placed"):
        packing = pack(SPHERE, vg.Box((10, 10, 10)), count=900)
    assert packing.stop_reason == "full"
    assert packing.provenance["missed"]["count"] == 900 - packing.count > 0


def test_parameters_are_checked():
    with pytest.raises(InputError, match="tries"):
        pack(SPHERE, WIDE, count=3, tries=0)
    with pytest.raises(InputError, match="dense packing takes the best position"):
        pack(SPHERE, WIDE, count=3, mode="dense", order="random")


def test_a_start_is_the_first_front():
    seeds = vg.Packing.of([SPHERE], WIDE, position=[(15, 15, 15), (16, 15, 15), (15.5, 15 + math.sqrt(0.75), 15)])
    for mode in ("loose", "dense"):
        packing = pack(SPHERE, WIDE, start=seeds, count=40, mode=mode)
        assert (packing.position[:3] == seeds.position).all()
        assert packing.provenance["counters"]["begun"] == 0
        assert vg.verify(packing).ok
        hull = ConvexHull(packing.position)
        assert hull.volume < 8 * 43
    for wrong in ([(15, 15, 15), (15, 15, 15)], [(15, 15, 15), (15.4, 15, 15)]):
        with pytest.raises(InputError, match="grain 1 of start finds no place"):
            pack(SPHERE, WIDE, start=vg.Packing.of([SPHERE], WIDE, position=wrong), count=4)


@pytest.mark.parametrize("mode", ["loose", "dense"])
@pytest.mark.parametrize(
    ("shape", "container"),
    [
        (SPHERE, vg.Box((3, 3, 3))),
        (SPHERE, vg.Box((3, 2.2, 3), "y")),
        (SPHERE, vg.Cylinder(1.5, 3, origin=(1.5, 1.5, 0))),
        (SPHERE, vg.Sphere(1.8, origin=(1.5, 1.5, 1.5))),
        (DISK, vg.Rectangle((3, 3))),
        (DISK, vg.Rectangle((2.1, 3), "x")),
    ],
    ids=lambda value: getattr(value, "kind", value.name if hasattr(value, "name") else ""),
)
def test_a_start_near_walls_goes_on(mode, shape, container):
    places = [(1.2, 1.1, 0.5), (1.9, 1.1, 1.0)] if shape is SPHERE else [(0.6, 0.6, 0), (1.5, 1.2, 0)]
    start = vg.Packing.of([shape], container, position=places, scale=[0.9, 0.8])
    packing = pack(shape, container, start=start, count=5, sizes=vg.sizes.uniform(0.3, 0.5), mode=mode)
    assert packing.count == 7
    assert vg.verify(packing).ok


def test_other_methods_go_on_from_a_front():
    front = pack(SPHERE, vg.Box((6, 6, 12)), count=60, order="lowest", mode="dense")
    bed = vg.pack([], vg.Box((6, 6, 12)), method="digital_rsa", start=front, voxel_size=0.1)
    assert bed.count == 60
    assert vg.verify(bed).ok


@pytest.mark.parametrize(
    ("container", "least"), [(vg.Box((5, 5, 1), periodic="xy"), 18), (vg.Cylinder(0.5, 9), 5), (vg.Box((5, 1, 5)), 15)]
)
def test_slabs_and_tubes_in_which_no_three_touch_are_filled(container, least):
    packing = vg.pack(vg.make_shape("sphere"), container, method="advancing_front", mode="dense")
    assert packing.count >= least
    assert packing.stop_reason == "full"
    assert vg.verify(packing).ok


@pytest.mark.parametrize(
    ("shape", "container", "least"),
    [
        (SPHERE, vg.Box((8, 8, 1)), 50),
        (SPHERE, vg.Box((8, 8, 1), "xy"), 55),
        (SPHERE, vg.Box((1, 1, 12), "z"), 12),
        (SPHERE, vg.Cylinder(0.5, 12), 12),
        (SPHERE, vg.Cylinder(0.8, 12), 14),
        (SPHERE, vg.Box((1.05, 1.7, 30), "xz"), 50),
        (SPHERE, vg.Box((1.2, 1.2, 1.2), "xyz"), 2),
        (DISK, vg.Rectangle((12, 1)), 11),
    ],
)
def test_a_loose_front_that_cannot_begin_fills_slabs_and_tubes(shape, container, least):
    """Where no three spheres find room that touch each other, walls stand in for spheres."""
    packing = pack(shape, container, order="lowest")
    assert packing.provenance["counters"]["narrow"] == 1
    assert packing.count >= least
    assert packing.stop_reason == "full"
    assert vg.verify(packing).ok


@pytest.mark.parametrize(
    ("container", "asked", "count", "narrow"),
    [
        (vg.Box((8, 8, 1)), {}, 57, 1),
        (vg.Box((8, 8, 1)), {"order": "lowest"}, 59, 1),
        (vg.Cylinder(0.5, 12), {}, 11, 1),
        (vg.Cylinder(0.5, 12), {"order": "lowest"}, 12, 1),
        (vg.Box((5, 5, 1.2)), {}, 9, 0),
        (vg.Box((5, 5, 1.2)), {"mode": "dense"}, 21, 0),
        (vg.Box((5, 5, 1.0000001)), {"mode": "dense"}, 18, 0),
        (vg.ClosedMesh(vg.Shape.from_mesh(*vg.Box((5, 5, 1.0000001)).mesh())), {"mode": "dense"}, 15, 0),
    ],
    ids=str,
)
def test_slabs_and_tubes_hold_what_the_manual_says(container, asked, count, narrow):
    """docs/guide/front.md."""
    packing = pack(SPHERE, container, **asked)
    assert packing.count == count
    assert packing.provenance["counters"]["narrow"] == narrow


def test_wide_containers_and_grains_that_all_fit_are_not_narrow():
    assert pack(SPHERE, vg.Box((4, 4, 4))).provenance["counters"]["narrow"] == 0
    assert pack(SPHERE, vg.Box((8, 8, 1)), count=1).provenance["counters"]["narrow"] == 0
    assert pack(SPHERE, vg.Box((8, 8, 1)), mode="dense").provenance["counters"]["narrow"] == 0


def test_spheres_in_a_tube_lie_across_from_each_other():
    """Each is as much higher than the one below as a rod from side to side of the tube leaves."""
    tube = vg.Cylinder(0.8, 12)
    for mode in ("loose", "dense"):
        packing = pack(SPHERE, tube, order="lowest", mode=mode)
        # the first one stands in the middle
        there = packing.position[np.argsort(packing.position[:, 2])][2:]
        assert np.diff(there[:, 2]) == pytest.approx(math.sqrt(1 - 0.6**2), abs=1e-12)
        assert np.hypot(*(there[:, :2] - tube.origin[:2]).T) == pytest.approx(0.3, abs=1e-12)
        assert len(there) == 12
    graded = pack(SPHERE, vg.Cylinder(0.7, 20), order="lowest", sizes=vg.sizes.uniform(0.8, 1.2))
    assert vg.verify(graded).ok
    assert graded.count > 20


def test_chunks_do_not_matter_where_walls_stand_in():
    found = []
    for chunk in (1, 7, 1000):
        task = prepare_task(Request(SPHERE, vg.Box((4, 3, 1)), "advancing_front"))
        state = task.method.prepare(task.problem)
        while not state.stop_reason:
            state = task.method.advance(task.problem, state, chunk)
            if chunk == 7:
                state.derived = {}
        found.append((state.done, state.counters, state.arrays["spheres"].tobytes()))
    assert found[0][0] > 1000
    assert all(one == found[0] for one in found)


def test_the_pockets_of_a_start_are_listed_with_looks_between():
    """Spheres of a start are many that come at once; a stop among them changes nothing."""
    start = pack(SPHERE, vg.Box((6, 6, 6)), count=100)
    asked = {"count": 40, "seed": 1, "start": start, "mode": "dense"}
    task = kit.task_of("advancing_front", SPHERE, vg.Box((6, 6, 9)), **asked)
    runs, looks = [], []

    def is_time():
        looks.append(True)
        return len(looks) % 2 == 1

    for asked in (lambda: False, is_time):
        state = task.method.prepare(task.problem)
        while not state.stop_reason:
            with contextlib.suppress(Stopped), stopping_when(asked):
                state = task.method.advance(task.problem, state, 10)
        runs.append((state.arrays["spheres"].tobytes(), state.counters, state.done))
    assert runs[0] == runs[1]
    # 100 spheres, 64 at a time
    assert looks
    assert state.counters["placed"] > 130
