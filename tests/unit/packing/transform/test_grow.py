"""Grains that grow until they touch, against closed forms and independent checks."""

import kit
import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.contacts.walls import escape_depths
from voxgran.packing.advancing_front.method import registration as front

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
HULLS = [vg.make_shape("convex_polyhedron", seed=seed, points=8 + seed) for seed in range(6)]
NEAR = pytest.mark.filterwarnings("ignore:.*grains were placed before")


def pair(shape, way, scale=(1.0, 1.0), container=None):
    """Two grains so far apart."""
    container = container or vg.Box((20, 20, 20))
    there = np.tile(0.5 * container.bounds[1], (2, 1))
    there[:, 0] += (-way / 2, way / 2)
    return vg.Packing.of([shape], container, position=there, scale=scale)


def least_gaps(packing):
    """How far the nearest neighbour or wall of each grain is, from contacts and walls alone."""
    gap = -escape_depths(packing)
    contacts = packing.contacts(0.3 * packing.diameters.mean())
    for grain in (contacts.i, contacts.j):
        np.minimum.at(gap, grain, contacts.gap)
    return gap / packing.diameters.mean()


def test_two_spheres_grow_by_the_same_factor():
    assert vg.grow(pair(SPHERE, 1.5)).scale == pytest.approx([1.5, 1.5], rel=1e-9)
    assert vg.grow(pair(SPHERE, 1.5, (1.0, 0.5))).scale == pytest.approx([2.0, 1.0], rel=1e-9)
    assert vg.grow(pair(SPHERE, 5.0)).scale == pytest.approx([2.0, 2.0])
    assert vg.grow(pair(SPHERE, 5.0), max_factor=3.5).scale == pytest.approx([3.5, 3.5])
    assert (vg.grow(pair(SPHERE, 1.0)).scale == 1.0).all()
    assert (vg.grow(pair(SPHERE, 0.9)).scale == 1.0).all()
    assert (vg.grow(pair(SPHERE, 1.5), max_factor=1.0).scale == 1.0).all()


@pytest.mark.parametrize(
    ("container", "position", "factor"),
    [
        (vg.Box((3, 4, 9)), (1.1, 2, 4), 2.2),
        (vg.Box((1.5, 4, 9), "x"), (0.2, 2, 4), 1.5),
        (vg.Cylinder(2, 9), (0.9, 0, 4), 2.2),
        (vg.Sphere(2), (0.9, 0, 0), 2.2),
        (vg.ClosedMesh(vg.Shape.from_mesh(*vg.Box((3, 4, 9)).mesh())), (1.1, 2, 4), 2.2),
    ],
    ids=lambda value: getattr(value, "kind", None),
)
def test_one_sphere_grows_to_the_nearest_wall(container, position, factor):
    alone = vg.Packing.of([SPHERE], container, position=[position])
    grown = vg.grow(alone, max_factor=9)
    assert grown.scale[0] == pytest.approx(factor, rel=1e-7)
    assert vg.verify(grown).ok


def test_turned_and_curved_grains_meet_exactly():
    """An ellipsoid and a die on its corner between two walls: support functions in closed form."""
    slab = vg.Box((9, 9, 3))
    ellipsoid = vg.make_shape("ellipsoid", semi_axes=(1.0, 1.0, 0.5))
    tilt = 0.4
    turn = [np.cos(tilt / 2), np.sin(tilt / 2), 0, 0]
    high = np.sqrt((1.0 * np.sin(tilt)) ** 2 + (0.5 * np.cos(tilt)) ** 2)
    one = vg.Packing.of([ellipsoid], slab, position=[(4.5, 4.5, 1.5)], orientation=[turn])
    assert vg.grow(one, max_factor=9).scale[0] == pytest.approx(1.5 / high, rel=1e-9)
    die = vg.make_shape("box", lengths=(1, 1, 1))
    edge = vg.Packing.of(
        [die], slab, position=[(4.5, 4.5, 1.5)], orientation=[[np.cos(np.pi / 8), np.sin(np.pi / 8), 0, 0]]
    )
    assert vg.grow(edge, max_factor=9).scale[0] == pytest.approx(1.5 / np.sqrt(0.5), rel=1e-9)


@NEAR
@pytest.mark.parametrize(
    ("shapes", "container"),
    [
        (HULLS, vg.Box((5, 5, 5), "x")),
        (HULLS, vg.Cylinder(2, 4)),
        ([*HULLS[:2], vg.make_shape("cone"), vg.make_shape("ellipsoid"), SPHERE], vg.Sphere(2.5)),
        ([vg.make_shape("polygon", corners=5)], vg.Rectangle((7, 7))),
        ([vg.make_shape("solid_union", seed=3, solids=4)], vg.Box((3, 3, 3))),
    ],
    ids=["hulls", "cylinder", "mixed", "polygons", "unions"],
)
def test_all_touch_and_none_overlaps(shapes, container):
    sizes = vg.sizes.uniform(0.6, 1.0)
    front = vg.pack(shapes, container, method="advancing_front", mode="dense", sizes=sizes)
    grown = vg.grow(front, max_factor=4)
    assert vg.verify(grown).ok
    assert least_gaps(grown).max() < 2e-8
    assert least_gaps(grown).min() > -1e-11
    report = grown.provenance["growth"]
    assert report["touching"] == 1.0
    assert report["solid_fraction"] == grown.solid_fraction > front.solid_fraction == report["solid_fraction_before"]
    assert report["mean_factor"] == pytest.approx((grown.scale / front.scale).mean())
    assert (grown.scale >= front.scale).all()
    steps = np.sort(front.diameters), np.sort(grown.diameters)
    apart = max(abs(np.mean(steps[0] <= size + 1e-9) - np.mean(steps[1] <= size + 1e-9)) for size in steps[0])
    assert report["gradation_distance"] == pytest.approx(apart)
    again = vg.pack(shapes, container, method="advancing_front", mode="dense", sizes=sizes, grow=4.0)
    assert (again.scale == grown.scale).all()


def test_a_flat_sheet_along_a_wall_grows_to_the_walls_across():
    sheet = vg.make_shape("sheet", lengths=(1.0, 1.0))
    grown = vg.grow(vg.Packing.of([sheet], vg.Box((3, 4, 5)), position=[(1.5, 2.0, 0.5)]), max_factor=9)
    assert grown.scale[0] == pytest.approx(3.0, rel=1e-7)
    assert vg.verify(grown).ok


@NEAR
@pytest.mark.filterwarnings("ignore:the solid fraction ")
@pytest.mark.parametrize(
    "asked",
    [{}, {"count": 100}, {"solid_fraction": 0.3}, {"solid_fraction": 0.9}, {"sizes": vg.sizes.uniform(0.6, 1.0)}],
    ids=str,
)
def test_what_is_missed_is_told_of_the_grains_before_they_grow(asked):
    how = {"method": "advancing_front", "mode": "dense", "seed": 1, **asked}
    box, die = vg.Box((4, 4, 4)), vg.make_shape("box")
    plain, grown = vg.pack(die, box, **how), vg.pack(die, box, grow=1.5, **how)
    assert grown.solid_fraction > plain.solid_fraction
    assert grown.provenance["missed"] == plain.provenance["missed"]
    # a start has its own sizes, of which nobody asked
    plain, grown = (vg.pack(die, box, start=pair(die, 2.0, container=box), grow=g, **how) for g in (1.0, 1.5))
    assert grown.provenance["missed"] == plain.provenance["missed"]


def test_a_run_that_was_cut_short_does_not_grow():
    problem = kit.task_of("advancing_front", HULLS, vg.Box((5, 5, 5)), count=40, grow=1.5).problem
    state = front.advance(problem, front.prepare(problem), 5)
    state.stop_reason = "interrupted"
    short = front.finish(problem, state)
    assert 0 < short.count < 40
    assert "growth" not in short.provenance
    whole = front.finish(problem, front.advance(problem, front.prepare(problem), 10_000))
    assert whole.provenance["growth"]["mean_factor"] > 1.0


def test_nothing_to_grow_and_wrong_factors():
    empty = vg.Packing.of([SPHERE], vg.Box((3, 3, 3)), position=np.zeros((0, 3)))
    assert vg.grow(empty).provenance["growth"]["mean_factor"] == 1.0
    with pytest.raises(InputError, match="max_factor"):
        vg.grow(empty, max_factor=0.5)
    for other in (None, "packing", SPHERE):
        with pytest.raises(InputError, match=r"packing is .*: it must be a Packing"):
            vg.grow(other)
    with pytest.raises(InputError, match="grow"):
        vg.pack(SPHERE, vg.Box((3, 3, 3)), method="advancing_front", grow=0.9)
