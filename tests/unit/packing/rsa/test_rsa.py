"""Random sequential addition: against plain programs, its proof of saturation, every container, what it refuses."""

import warnings
from functools import partial

import kit
import numpy as np
import pytest
from kit import slow
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError, LongRunWarning, PackingWarning, TooLargeError
from voxgran._base.seeds import philox_block, philox_key
from voxgran._base.stopping import Stopped, stopping_when
from voxgran.packing.rsa.available_cells import Open, all_edges, cut_cells
from voxgran.packing.rsa.method import registration as rsa
from voxgran.packing.rsa.overlaps import Bed, Grains
from voxgran.packing.rsa.precompute import congruential

GRADED = vg.sizes.discrete([1.0, 0.6, 0.3], [1, 2, 3])


task_of = partial(kit.task_of, "rsa")


def run_of(problem):
    state = rsa.prepare(problem)
    while not state.stop_reason:
        state = rsa.advance(problem, state, 10_000)
    return state


def coordinates(problem, many):
    """The coordinates as the docstring tells them."""
    key = philox_key(problem.seed, "rsa")
    blocks = [philox_block(key[0], key[1], np.uint64(c), np.uint64(0))[:3] for c in range(many)]
    table = np.array([[(int(word) >> 11) / 2**53 for word in block] for block in blocks])
    if problem.parameters.numbers == "lcg":
        table = np.column_stack([congruential(first, many) / 65536 for first in (20001, 60001, 40001)])
    if problem.parameters.scheme.startswith("4"):
        table[:, 0] = np.sort(table[:, 0])
    return table


class Plain:
    """The method as it is told, with nothing but distances to all grains."""

    def __init__(self, problem):
        self.problem = problem
        d = self.d = problem.dimension
        lower, upper = problem.container.bounds
        self.lower, self.lengths = lower[:d], (upper - lower)[:d]
        self.periodic = np.array(problem.container.periodic[:d])
        self.radius = problem.diameter / 2
        self.center, self.placed = np.zeros((0, d)), []

    def steps(self, x):
        """Return the steps from all grains to a place, nearest images."""
        step = x - self.center
        return np.where(self.periodic, step - np.round(step / self.lengths) * self.lengths, step)

    def put(self, g, share, corrections):
        r, slack = self.radius[g], 1e-10 if corrections else 0.0
        low = np.where(self.periodic, self.lower, self.lower + r)
        x = low + share[: self.d] * np.where(self.periodic, self.lengths, self.lengths - 2 * r)
        for moves in range(corrections + 1):
            inside = (x - r >= self.lower - 1e-12) & (x + r <= self.lower + self.lengths + 1e-12)
            if not (inside | self.periodic).all():
                return False
            step = self.steps(x)
            distance = np.linalg.norm(step, axis=1)
            overlap = r + self.radius[self.placed] - distance
            if not (overlap > slack).any():
                low = np.floor((x - self.lower) / self.lengths) * np.where(self.periodic, self.lengths, 0)
                self.center = np.vstack([self.center, x - low])
                self.placed.append(g)
                return True
            if moves < corrections:
                worst = overlap.argmax()
                x = x + overlap[worst] * step[worst] / distance[worst]
        return False

    def run(self):
        settings = self.problem.parameters
        n, tries = self.problem.count, settings.tries
        table, corrections = coordinates(self.problem, tries * n), settings.corrections if settings.correcting else 0
        basic = {"4a": "classic", "4b": "1", "4c": "2", "4d": "3"}.get(settings.scheme, settings.scheme)
        if basic in ("classic", "1"):
            for g in range(n):
                any(self.put(g, table[g * tries + t], corrections) for t in range(tries))
        elif settings.retry == "next":
            g = 0
            for share in table:
                g += g < n and self.put(g, share, corrections)
        else:
            used, failed = set(), set()
            for g in range(n):
                for c in range(len(table)):
                    if c in used or (c, self.radius[g]) in failed:
                        continue
                    if self.put(g, table[c], corrections):
                        used.add(c)
                        break
                    failed.add((c, self.radius[g]))
        return self


@pytest.mark.parametrize(("dimension", "periodic"), [(2, "x"), (2, ""), (3, "xz"), (3, "")])
@pytest.mark.parametrize("scheme", ["classic", "1", "2", "3", "4a", "4b", "4c", "4d"])
def test_every_scheme_is_that_of_a_plain_program(scheme, dimension, periodic):
    shape = vg.make_shape("disk" if dimension == 2 else "sphere")
    room = vg.Rectangle((4.5, 5), periodic) if dimension == 2 else vg.Box((2.6, 3, 2.2), periodic)
    numbers = "lcg" if periodic == "x" else "philox"
    for retry in ("scan", "next") if scheme in ("2", "3", "4c", "4d") else ("scan",):
        task = task_of(
            *(shape, room), count=90, sizes=GRADED, seed=4,
            scheme=scheme, tries=3, retry=retry, numbers=numbers, until="tries",
        )  # fmt: skip
        state, plain = run_of(task.problem), Plain(task.problem).run()
        assert np.flatnonzero(state.arrays["entered"]).tolist() == sorted(plain.placed)
        assert len(plain.placed) > 15
        found = state.arrays["position"][plain.placed][:, :dimension]
        # rounding differs where images are met
        assert np.abs(found - plain.center).max() < 1e-12
        packing = rsa.finish(task.problem, state)
        assert vg.verify(packing).ok
        assert state.counters["moved"] == 0 or task.problem.parameters.correcting


def test_a_grain_that_was_moved_touches():
    packing = vg.pack(
        vg.make_shape("disk"), vg.Rectangle((12, 12)), method="rsa", scheme="3", tries=4, sizes=GRADED, seed=1
    )
    contacts = packing.contacts(1e-8)
    assert packing.provenance["counters"]["moved"] > 50
    assert len(contacts.i) >= packing.provenance["counters"]["moved"]
    assert vg.verify(packing).ok


def test_next_keeps_the_shares_and_scan_does_not():
    """The words of the paper force the gradation that was asked: all radii go in, in their order."""
    disks, plane = vg.make_shape("disk"), vg.Rectangle((30, 30))
    with pytest.warns(PackingWarning):
        words, numbers = (
            vg.pack(disks, plane, method="rsa", scheme="3", tries=1, retry=how, sizes=GRADED, count=3000)
            for how in ("next", "scan")
        )
    drawn = task_of(disks, plane, count=3000, sizes=GRADED).problem.diameter
    drawn *= task_of(disks, plane, count=3000, sizes=GRADED).problem.unit_length
    assert words.diameters == pytest.approx(drawn[: words.count], rel=1e-12)
    assert numbers.count > words.count
    assert numbers.provenance["missed"]["gradation"] > 0.03


def test_largest_first_is_denser():
    """The claim of the literature, over seeds, both as candidates and to saturation."""
    sphere, box, sizes = vg.make_shape("sphere"), vg.Box((7, 7, 7), "xyz"), vg.sizes.discrete([1.0, 0.5], [1, 3])
    found = {
        (until, order): [
            vg.pack(
                sphere, box, method="rsa", sizes=sizes, seed=seed, order=order, until=until, tries=50
            ).solid_fraction
            for seed in range(3)
        ]
        for until in ("tries", "saturated")
        for order in ("largest", "given", "random")
    }
    for until in ("tries", "saturated"):
        for other in ("given", "random"):
            assert min(found[until, "largest"]) > max(found[until, other]) + 0.02


def free_places(packing, radius, many=200_000, seed=5):
    """Count random places where one more sphere would fit: an independent probe."""
    container, generator = packing.container, np.random.Generator(np.random.PCG64(seed))
    lower, upper = container.bounds
    d = container.dimension
    probes = lower + generator.random((many, 3)) * (upper - lower)
    probes = probes[container.signed_distance(probes) <= -radius]
    periodic = np.array(container.periodic[:d])
    lengths = np.where(periodic, (upper - lower)[:d], 0.0)
    free = np.ones(len(probes), dtype=bool)
    for size in np.unique(packing.diameters):
        centers = (packing.position - lower)[packing.diameters == size, :d]
        tree = cKDTree(np.where(periodic, centers % np.where(periodic, lengths, 1.0), centers), boxsize=lengths)
        free &= tree.query((probes - lower)[:, :d])[0] >= radius + size / 2
    return len(probes), int(free.sum())


ROOMS = {
    "periodic": lambda: vg.Box((9, 9, 9), "xyz"),
    "walls": lambda: vg.Box((9, 8, 7), "y", origin=(3, -2, 1)),
    "plane": lambda: vg.Rectangle((30, 20), "x", origin=(-4, 2)),
    "cylinder": lambda: vg.Cylinder(4, 9),
    "mesh": lambda: vg.ClosedMesh(vg.make_shape("solid_union", seed=3).scaled(9)),
}


@pytest.mark.parametrize("name", ROOMS)
def test_saturation_is_proven_and_no_probe_finds_a_place(name):
    room = ROOMS[name]()
    shape = vg.make_shape("disk" if room.dimension == 2 else "sphere")
    packing = vg.pack(shape, room, method="rsa", until="saturated", seed=2)
    proof = packing.provenance["saturation"]
    assert packing.stop_reason == "saturated"
    assert proof["proven"]
    assert proof["open_cells"] == 0
    assert vg.verify(packing).ok
    # the container holds every sphere wholly, to rounding
    assert packing.container.signed_distance(packing.position).max() <= -0.5 + 1e-9
    probes, free = free_places(packing, 0.5)
    assert probes > 50_000 or name == "mesh"
    assert free == 0
    # the probe itself finds a place once a grain is away
    less = vg.Packing.of([shape], packing.container, position=packing.position[1:])
    assert free_places(less, 0.5)[1] > 0


def test_open_cells_hold_every_free_place():
    """Half way: a place where one more sphere fits lies in an open cell."""
    task = task_of(vg.make_shape("sphere"), vg.Box((6, 5, 5.5), "y"), until="saturated", seed=3)
    problem = task.problem
    state = rsa.prepare(problem)
    while state.arrays["depth"][0] < 2:
        state = rsa.advance(problem, state, 50)
    known, classes = Open(*(state.arrays[name] for name in Open._fields)), state.derived["precomputed"].classes
    edge = all_edges(classes, known)[0]
    cells = {tuple(cell) for cell in known.cell.tolist()}
    packing, generator = rsa.finish(problem, state), np.random.Generator(np.random.PCG64(1))
    probes = classes.low[0] + generator.random((100_000, 3)) * classes.span[0]
    step = probes[:, None] - packing.position[None]
    step[:, :, 1] -= np.round(step[:, :, 1] / 5) * 5
    free = probes[((step**2).sum(axis=2) >= 1).all(axis=1)]
    assert 10 < len(free) < 20_000
    assert {tuple(cell) for cell in np.floor((free - classes.low[0]) / edge).astype(int).tolist()} <= cells
    assert len(cells) < 0.5 * np.prod(classes.base[0] * 4)


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_open_boxes_are_the_free_room_exactly(dimension):
    """Cut anew, the boxes hold every free place and no other, and none twice."""
    room = vg.Rectangle((9, 8), "x") if dimension == 2 else vg.Box((6, 5, 5), "x")
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    shape = vg.make_shape("polygon", vertices=corners) if dimension == 2 else vg.make_shape("box", lengths=(1, 1, 1))
    problem = task_of(shape, room, until="saturated", aligned=True, seed=3).problem
    state = rsa.advance(problem, rsa.prepare(problem), 60)
    made = state.derived["precomputed"]
    known = Open(*(state.arrays[name] for name in Open._fields))
    grains = Grains(state.arrays["position"], made.half, made.level, state.arrays["entered"], True)
    boxes = cut_cells(Bed(grains, made.cells, made.walls), made.classes, known, 0).cell
    low, span = made.classes.low[0], made.classes.span[0]
    lengths, edge = made.walls.lengths, 2 * made.half[0, 0]
    centers = state.arrays["position"][state.arrays["entered"] == 1]
    assert len(centers) > 10
    probes = low + np.random.Generator(np.random.PCG64(1)).random((20_000, 3)) * span
    step = np.abs(probes[:, None] - centers)[:, :, :dimension]
    step[:, :, 0] = np.minimum(step[:, :, 0], lengths[0] - step[:, :, 0])
    free = (step >= edge).any(axis=2).all(axis=1)
    along = slice(0, dimension)
    held = (probes[:, None, along] >= boxes[:, along]) & (
        probes[:, None, along] < boxes[:, along] + boxes[:, 3 : 3 + dimension]
    )
    assert np.array_equal(held.all(axis=2).sum(axis=1), free)
    assert 500 < free.sum() < 15_000


def test_graded_sizes_are_proven_class_by_class():
    sphere, box = vg.make_shape("sphere"), vg.Box((6, 6, 6), "x")
    packing = vg.pack(sphere, box, method="rsa", until="saturated", sizes=GRADED, seed=1)
    assert packing.stop_reason == "saturated"
    assert packing.provenance["saturation"]["classes"] == 3
    assert packing.provenance["saturation"]["not_proven"] == 0
    assert vg.verify(packing).ok
    # a size of which some were left out has no place any more
    drawn = task_of(sphere, box, sizes=GRADED, seed=1).problem
    for size in (1.0, 0.6, 0.3):
        asked = np.isclose(drawn.diameter * drawn.unit_length, size).sum()
        if np.isclose(packing.diameters, size).sum() < asked:
            assert free_places(packing, size / 2)[1] == 0


@pytest.mark.parametrize("order", [slow("given"), "largest"])
def test_any_number_of_sizes_is_proven(order):
    """None of the grains that were left out fits, however many sizes there are."""
    sizes, options = vg.sizes.lognormal(0.8, 0.3), {"until": "saturated", "tries": 50, "order": order}
    problem = task_of(vg.make_shape("sphere"), vg.Box((4, 4, 5), "x"), sizes=sizes, seed=1, **options).problem
    state = run_of(problem)
    packing = rsa.finish(problem, state)
    assert packing.stop_reason == "saturated"
    assert packing.provenance["saturation"]["not_proven"] == 0
    assert state.counters["put_off"] > 10
    assert vg.verify(packing).ok
    # some that were put off got in, and more would if they were smaller
    late = state.arrays["late"]
    assert 0 < np.count_nonzero(state.arrays["entered"][late]) < len(late)
    smallest = (problem.diameter * problem.unit_length)[state.arrays["entered"] == 0].min()
    assert free_places(packing, smallest / 2, many=20_000)[1] == 0
    assert free_places(packing, 0.8 * smallest / 2, many=20_000)[1] > 0
    for chunk in (997, 61):
        again = rsa.prepare(problem)
        while not again.stop_reason:
            again = rsa.advance(problem, again, chunk)
            again.derived = {}
        assert all(array.tobytes() == state.arrays[name].tobytes() for name, array in again.arrays.items())


def test_boxes_of_any_number_of_sizes_are_proven_where_they_can_be_sorted():
    cube, brick = vg.make_shape("box", lengths=(1, 1, 1)), vg.make_shape("box", lengths=(2, 1, 0.5))
    sizes, options = vg.sizes.lognormal(0.8, 0.3), {"until": "saturated", "tries": 20, "aligned": True, "seed": 1}
    packing = vg.pack(cube, vg.Box((4, 4, 4), "x"), method="rsa", sizes=sizes, **options)
    assert packing.stop_reason == "saturated"
    assert packing.provenance["counters"]["put_off"] > 10
    assert vg.verify(packing).ok
    drawn = task_of(cube, vg.Box((4, 4, 4), "x"), sizes=sizes, **options).problem
    left = np.setdiff1d(np.round(drawn.diameter * drawn.unit_length, 9), np.round(packing.diameters, 9))
    edge = left.min() / cube.diameter
    probes = np.random.Generator(np.random.PCG64(2)).random((50_000, 3)) * [4, 4 - edge, 4 - edge] + [
        0,
        edge / 2,
        edge / 2,
    ]
    free = np.ones(len(probes), dtype=bool)
    for place, own in zip(packing.position, packing.scale, strict=True):
        step = np.abs(probes - place)
        step[:, 0] = np.minimum(step[:, 0], 4 - step[:, 0])
        free &= (step >= (edge + own) / 2).any(axis=1)
    assert not free.any()
    # one longer and narrower than another: that the one has no place says nothing of the other
    with pytest.warns(PackingWarning, match="saturation is not proven: [0-9]+ tries failed"):
        both = vg.pack([cube, brick], vg.Box((4, 4, 4)), method="rsa", sizes=sizes, **options)
    assert both.stop_reason == "steps"
    assert both.provenance["saturation"]["not_proven"] > 0
    assert vg.verify(both).ok


@pytest.mark.slow
@pytest.mark.filterwarnings("error:overflow", "ignore:saturation is not proven")
def test_open_boxes_are_cut_no_more_than_they_change():
    """Two shapes, many sizes: most are as wide as one and as long as the other, and throws are in vain for long."""
    die, brick = vg.make_shape("box"), vg.make_shape("box", lengths=(1, 0.5, 0.5))
    options = {"until": "saturated", "aligned": True, "count": 200, "sizes": vg.sizes.uniform(0.3, 0.9)}
    problem = task_of([die, brick], vg.Box((3, 3, 3), "xyz"), **options).problem
    state = run_of(problem)
    packing = rsa.finish(problem, state)
    assert vg.verify(packing).ok
    assert packing.stop_reason in ("saturated", "steps")
    assert state.counters["refused"] > 100 * packing.count
    # a class is cut to no purpose once at most for each grain that enters
    assert state.arrays["depth"].max() < packing.count
    # half way: boxes that a cut would leave as they are hold free places alone
    half, exact = rsa.prepare(problem), np.zeros(0)
    while not len(exact):
        half = rsa.advance(problem, half, 20)
        known = Open(*(half.arrays[name] for name in Open._fields))
        exact = np.flatnonzero((known.misses < 0) & (np.diff(known.bounds) > 0))
    made, entered = half.derived["precomputed"], np.flatnonzero(half.arrays["entered"])
    grains = Grains(half.arrays["position"], made.half, made.level, half.arrays["entered"], True)
    for kind in exact:
        after = cut_cells(Bed(grains, made.cells, made.walls), made.classes, known, kind).cell
        assert after == pytest.approx(known.cell, abs=1e-12)
        own = known.cell[known.bounds[kind] : known.bounds[kind + 1]]
        step = np.abs(own[:, None, :3] + own[:, None, 3:] / 2 - half.arrays["position"][entered])
        step = np.minimum(step, made.walls.lengths - step)
        assert (step >= made.classes.half[kind] + made.half[entered] - 1e-12).any(axis=2).all()
    for chunk in (997, 7):
        again = rsa.prepare(problem)
        while not again.stop_reason:
            again = rsa.advance(problem, again, chunk)
        assert all(array.tobytes() == state.arrays[name].tobytes() for name, array in again.arrays.items())


def test_aligned_boxes_meet_as_boxes():
    square = vg.make_shape("polygon", vertices=((0, 0), (1, 0), (1, 1), (0, 1)))
    packing = vg.pack(square, vg.Rectangle((14, 12), "x"), method="rsa", until="saturated", aligned=True)
    assert vg.verify(packing).ok
    assert (packing.orientation == [1, 0, 0, 0]).all()
    ticks = np.random.Generator(np.random.PCG64(2)).random((200_000, 2)) * [14, 11] + [0, 0.5]
    free = np.ones(len(ticks), dtype=bool)
    for x, y in packing.position[:, :2]:
        dx = np.abs(ticks[:, 0] - x)
        free &= (np.minimum(dx, 14 - dx) >= 1) | (np.abs(ticks[:, 1] - y) >= 1)
    assert not free.any()
    bricks = [vg.make_shape("box", lengths=(2, 1, 0.5)), vg.make_shape("box", lengths=(1, 1, 1))]
    wall = vg.pack(bricks, vg.Box((7, 6, 5)), method="rsa", until="saturated", aligned=True, seed=2)
    assert wall.stop_reason == "saturated"
    assert vg.verify(wall).ok
    tried = vg.pack(bricks, vg.Box((7, 6, 5)), method="rsa", aligned=True, seed=2, scheme="4c", tries=20)
    assert vg.verify(tried).ok
    # they lie denser than their bounding spheres could
    assert tried.solid_fraction > 0.25


@pytest.mark.parametrize(
    "parameters",
    [
        {"scheme": "3", "tries": 10},
        {"scheme": "4d", "tries": 10, "retry": "next", "numbers": "lcg"},
        {"until": "saturated"},
        {"until": "saturated", "order": "largest"},
        {"until": "saturated", "aligned": True},
    ],
)
def test_chunks_and_resumption_do_not_matter(parameters):
    """In chunks of any size, and with everything made anew after each that a checkpoint does not hold."""
    shape = vg.make_shape("box", lengths=(1, 1, 1)) if "aligned" in parameters else vg.make_shape("sphere")
    found = []
    for chunk, anew in ((10**6, False), (997, False), (997, True), (61, True)):
        options = {"order": "random", **parameters}
        problem = task_of(shape, vg.Box((3, 3.5, 3), "y"), sizes=GRADED, seed=6, **options).problem
        state = rsa.prepare(problem)
        while not state.stop_reason:
            state = rsa.advance(problem, state, chunk)
            if anew:
                state.derived = {}
        found.append((state.done, state.counters, {name: array.tobytes() for name, array in state.arrays.items()}))
    assert all(one == found[0] for one in found)


def test_a_start_stays_where_it_is():
    """True shapes may touch."""
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    tower = vg.Packing.of([cube], vg.Box((5, 5, 5)), position=[(0.5, 0.5, 0.5), (0.5, 0.5, 1.5), (1.5, 0.5, 0.5)])
    packing = vg.pack(vg.make_shape("sphere"), tower.container, method="rsa", start=tower, count=25, until="saturated")
    assert packing.provenance["saturation"]["classes"] == 1
    assert packing.position[:3] == pytest.approx(tower.position, abs=1e-15)
    assert packing.count == 28
    assert vg.verify(packing).ok
    deep = vg.Packing.of([cube], vg.Box((5, 5, 5)), position=[(0.5, 0.5, 0.5), (1.4, 0.5, 0.5)])
    with pytest.raises(InputError, match="grain 1 of start finds no place"):
        vg.pack([], deep.container, method="rsa", start=deep)


@pytest.mark.parametrize("method", ["digital", "control_point"])
def test_other_methods_go_on_from_it(method):
    """Also from spheres that touch: they part upward as far as the method needs."""
    tall, options = vg.Box((3, 3, 10), "xy"), {"digital": {"voxel_size": 0.1}, "control_point": {"spacing": 0.25}}
    loose = vg.pack(
        vg.make_shape("sphere"),
        vg.Box((3, 3, 7), "xy"),
        method="rsa",
        scheme="3",
        count=18,
        tries=20,
        sizes=GRADED,
        seed=2,
    )
    grains = vg.pack([], tall, method=method, start=loose, sweeps=100, **options[method])
    assert grains.count == loose.count == 18
    assert grains.diameters == pytest.approx(loose.diameters)
    assert grains.position[:, 2].mean() < loose.position[:, 2].mean() - 0.2
    assert vg.verify(grains).ok


def test_what_is_missed_is_told():
    sphere = vg.make_shape("sphere")
    with pytest.warns(PackingWarning, match=r"instead of 0\.6"):
        packing = vg.pack(sphere, vg.Box((6, 6, 6), "xyz"), method="rsa", until="saturated", solid_fraction=0.6)
    missed = packing.provenance["missed"]
    assert packing.stop_reason == "saturated"
    assert missed["solid_fraction"] == pytest.approx(0.6 - packing.solid_fraction)
    assert missed["count"] == int(np.ceil(0.6 * 216 / (np.pi / 6))) - packing.count
    assert missed["gradation"] == 0.0
    with pytest.warns(PackingWarning, match="of 4000 grains"):
        two = vg.pack(sphere, vg.Box((6, 6, 6)), method="rsa", until="tries", tries=1, sizes=GRADED, count=4000)
    asked = task_of(sphere, vg.Box((6, 6, 6)), count=4000, sizes=GRADED).problem
    shares = [
        [np.count_nonzero(values <= size + 1e-9) / len(values) for size in (0.3, 0.6, 1.0)]
        for values in (asked.diameter * asked.unit_length, two.diameters)
    ]
    assert two.provenance["missed"]["gradation"] == pytest.approx(np.abs(np.subtract(*shares)).max(), abs=1e-12)


def test_targets_denser_than_the_densest_lattice_are_refused():
    sphere, disk = vg.make_shape("sphere"), vg.make_shape("disk")
    for method in ("rsa", "digital", "control_point"):
        with pytest.raises(InputError, match=r"porosity of 0\.25: equal spheres have a porosity of at least 0\.2595"):
            vg.pack(sphere, vg.Box((5, 5, 5), "xyz"), method=method, solid_fraction=0.75)
    with pytest.raises(InputError, match=r"equal disks have a porosity of at least 0\.0931"):
        vg.pack(disk, vg.Rectangle((9, 9)), method="rsa", solid_fraction=0.91)
    # grains of several sizes, few grains, and a container that does not fill space may come beyond
    for shapes, room, more in (
        ([sphere, sphere.scaled(0.2)], vg.Box((4, 4, 4)), {}),
        (sphere, vg.Box((4, 4, 4)), {"count": 5}),
        (sphere, vg.Cylinder(0.51, 1.01), {}),
    ):
        with warnings.catch_warnings(action="ignore", category=PackingWarning):
            assert vg.pack(shapes, room, method="rsa", solid_fraction=0.75, tries=5, **more).count > 0


def test_what_cannot_be_asked_is_refused():
    sphere, box = vg.make_shape("sphere"), vg.Box((4, 4, 4))
    for parameters, words in (
        ({"tries": 0}, "tries"),
        ({"corrections": 0}, "corrections"),
        ({"scheme": "3", "until": "saturated"}, "until saturated"),
        ({"numbers": "lcg", "until": "saturated"}, "until saturated"),
        ({"aligned": True, "scheme": "4b"}, "line of centres"),
        ({"aligned": True}, "it must be a box"),
    ):
        with pytest.raises(InputError, match=words):
            vg.pack(sphere, box, method="rsa", count=2, **parameters)
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    with pytest.raises(InputError, match="container of kind 'cylinder'"):
        vg.pack(cube, vg.Cylinder(3, 3), method="rsa", aligned=True, count=2)
    for scheme in ("4a", "2"):
        with pytest.raises(TooLargeError, match="coordinates"):
            vg.pack(sphere, box, method="rsa", scheme=scheme, tries=2**31, count=2)


@pytest.fixture(scope="module")
def crowd():
    """Return the room of 2000 spheres at a solid fraction of 0.33, which random tries alone do not reach."""
    return vg.Box(((2000 * np.pi / 6 / 0.33) ** (1 / 3),) * 3)


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_a_count_that_has_room_is_met(crowd):
    sphere = vg.make_shape("sphere")
    tried = vg.pack(sphere, crowd, method="rsa", count=2000, seed=3, until="tries", tries=50)
    assert (tried.stop_reason, tried.provenance["counters"]["search_from"]) == ("steps", -1)
    assert tried.count < 1990
    found = vg.pack(sphere, crowd, method="rsa", count=2000, seed=3, tries=50)
    assert (found.stop_reason, found.count) == ("count", 2000)
    assert vg.verify(found).ok
    # grains before the first that was dropped stand where they stood
    begun = found.provenance["counters"]["search_from"]
    assert 0 < begun < 2000
    assert np.array_equal(found.position[:begun], tried.position[:begun])
    again = vg.pack(sphere, crowd, method="rsa", count=2000, seed=3, tries=50)
    assert np.array_equal(again.position, found.position)
    few = [vg.pack(sphere, crowd, method="rsa", count=900, seed=3, **more) for more in ({}, {"until": "tries"})]
    assert np.array_equal(few[0].position, few[1].position)


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_a_target_without_room_is_proven_to_have_none_and_no_target_is_not_searched():
    sphere, box = vg.make_shape("sphere"), vg.Box((5, 5, 5))
    for asked in ({"count": 150}, {"solid_fraction": 0.5}):
        packing = vg.pack(sphere, box, method="rsa", seed=2, tries=20, **asked)
        assert packing.stop_reason == "saturated"
        assert packing.provenance["saturation"]["proven"]
        kept = vg.pack([], box, method="rsa", until="saturated", start=packing)
        more = vg.pack(sphere, box, method="rsa", until="saturated", start=packing, count=5)
        assert kept.count == more.count == packing.count
    free = vg.pack(sphere, box, method="rsa", seed=2, tries=20)
    assert free.stop_reason == "steps"
    assert free.provenance["counters"]["search_from"] == -1
    # the schemes of the paper are what they are
    for scheme in ("1", "2", "4a"):
        one, two = (
            vg.pack(sphere, box, method="rsa", seed=2, tries=3, count=70, scheme=scheme, until=until)
            for until in (None, "tries")
        )
        assert np.array_equal(one.position, two.position)


@pytest.mark.parametrize("chunk", [slow(1), 7, 100_000])
@pytest.mark.parametrize("options", [{}, {"aligned": True}])
def test_the_search_depends_neither_on_chunks_nor_on_what_is_made_again(chunk, options):
    shape, sizes = vg.make_shape("box", lengths=(1, 1, 1)), vg.sizes.lognormal(0.9, 0.2)
    runs = []
    for many, again in ((chunk, True), (5000, False)):
        problem = task_of(shape, vg.Box((4, 4, 4), "x"), count=60, sizes=sizes, seed=5, tries=10, **options).problem
        state = rsa.prepare(problem)
        while not state.stop_reason:
            state = rsa.advance(problem, state, many)
            if again and state.done % 3 == 0:
                state.derived.clear()
        assert 0 < state.counters["search_from"] < 60
        runs.append((state.arrays["position"].tobytes(), state.counters, state.stop_reason))
    assert runs[0] == runs[1]


def test_boxes_are_cut_some_at_a_time(monkeypatch):
    """How many are cut between two looks whether to stop changes nothing."""
    room = vg.Rectangle((9, 8), "x")
    square = vg.make_shape("polygon", vertices=((0, 0), (1, 0), (1, 1), (0, 1)))
    told = {"method": "rsa", "until": "saturated", "aligned": True, "seed": 4}
    whole = vg.pack(square, room, **told)
    monkeypatch.setattr("voxgran.packing.rsa.available_boxes.AT_ONCE", 3)
    some = vg.pack(square, room, **told)
    assert some.stop_reason == whole.stop_reason == "saturated"
    assert some.position.tobytes() == whole.position.tobytes()
    assert some.provenance["counters"] == whole.provenance["counters"]


@pytest.mark.parametrize("aligned", [False, True])
def test_grains_that_were_put_off_go_on_after_a_stop_to_the_same_bits(aligned, monkeypatch):
    shape = vg.make_shape("box", lengths=(1, 1, 1)) if aligned else vg.make_shape("sphere")
    options = {"until": "saturated", "tries": 5, "count": 300, "sizes": vg.sizes.uniform(0.7, 1.3), "aligned": aligned}
    problem = task_of([shape], vg.Box((4, 4, 5), "x"), **options).problem
    whole, looks, stops = run_of(problem), [], []
    assert whole.counters["late"] > 1
    monkeypatch.setattr("voxgran.packing.rsa.available_boxes.AT_ONCE", 20)
    state = rsa.prepare(problem)

    def is_time():
        looks.append(True)
        return len(looks) % 7 == 0

    while not state.stop_reason:
        try:
            with stopping_when(is_time):
                state = rsa.advance(problem, state, 50)
        except Stopped:
            stops.append(state.counters["late"])
            state.derived = {}
        if len(looks) > 200:
            monkeypatch.setattr("voxgran.packing.rsa.available_boxes.AT_ONCE", 2**15)
    assert max(stops) > 0
    assert state.counters == whole.counters
    assert all(array.tobytes() == whole.arrays[name].tobytes() for name, array in state.arrays.items())


LOGNORMAL = vg.sizes.lognormal(1.0, 0.5)


@pytest.mark.parametrize("family", ["sphere", "ellipsoid"])
def test_the_largest_come_first_where_a_solid_fraction_is_asked_of_a_gradation(family):
    shape, box, options = vg.make_shape(family), vg.Box((8, 8, 8)), {"solid_fraction": 0.35, "sizes": LOGNORMAL}
    packing = vg.pack(shape, box, method="rsa", **options)
    assert packing.solid_fraction >= 0.35
    assert packing.provenance["parameters"]["order"] == "largest"
    words = "give order='largest', by which more grains of a gradation find room, or ask for less"
    with pytest.warns(PackingWarning, match=words):
        given = vg.pack(shape, box, method="rsa", order="given", tries=100, **options)
    assert given.solid_fraction < 0.35


def test_the_largest_first_leaves_equal_sizes_in_their_order():
    # diameters of several shapes differ by rounding
    shapes = [vg.make_shape("sphere"), vg.make_shape("ellipsoid")]
    box, options = vg.Box((6, 6, 6)), {"method": "rsa", "solid_fraction": 0.2}
    found = [vg.pack(shapes, box, order=order, **options).shape_id.tolist() for order in ("given", "largest")]
    assert found[0] == found[1]
    assert len(set(found[0][:10])) == 2


def test_candidates_of_a_count_come_as_drawn():
    packing = vg.pack(vg.make_shape("sphere"), vg.Box((8, 8, 8)), method="rsa", count=20, sizes=LOGNORMAL)
    assert packing.provenance["parameters"]["order"] == "given"


def test_shapes_that_are_not_convex_tell_their_time_before_they_are_placed():
    rock, box = vg.make_shape("solid_union", seed=1), vg.Box((16, 16, 16))
    with pytest.warns(LongRunWarning, match=r"'rsa' is expected to take about \d+ min: a lower solid fraction"):
        vg.pack(rock, box, "rsa", count=2300, time_limit=0.0)
