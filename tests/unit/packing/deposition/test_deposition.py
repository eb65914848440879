"""Grains that fall one after the other, and stick or roll."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.measures.registered.density import bulk_solid_fraction

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
GRADED = vg.sizes.uniform(0.6, 1.4)


def deposited(shape, container, **options):
    """Return a packing that is proven to be free of overlap."""
    packing = vg.pack(shape, container, method="deposition", **options)
    assert vg.verify(packing).ok
    return packing


def contacts_below(packing):
    """Return for each grain the unit vectors from it to what touches it, walls included, within 1e-9."""
    lengths, up = np.array([*packing.container.lengths, 1.0])[:3], packing.dimension - 1
    periodic = np.array([*packing.container.periodic, False, False])[:3]
    centers, radii = packing.position, packing.diameters / 2
    vectors = [[] for _ in centers]
    for i in range(len(centers)):
        step = centers - centers[i]
        step -= np.where(periodic, np.round(step / lengths) * lengths, 0)
        away = np.linalg.norm(step, axis=1)
        near = np.flatnonzero((away < radii + radii[i] + 1e-9) & (away > 0))
        vectors[i] += [step[j] / away[j] for j in near if j < i]
        for axis in range(packing.dimension):
            if not periodic[axis]:
                for side, gap in ((-1, centers[i, axis]), (1, lengths[axis] - centers[i, axis])):
                    if gap < radii[i] + 1e-9 and (axis != up or side < 0):
                        vectors[i].append(np.eye(3)[axis] * side)
    return vectors


def has_way_down(vectors, up):
    """Return whether some direction leads down and away from all contacts, by linear programming."""
    from scipy.optimize import linprog

    down = np.eye(3)[up]
    found = linprog(down, A_ub=np.array(vectors), b_ub=np.zeros(len(vectors)), bounds=[(-1, 1)] * 3)
    return found.fun < -1e-6


@pytest.mark.parametrize(
    ("container", "sizes"),
    [
        (vg.Box((6, 6, 9), periodic="xy"), None),
        (vg.Box((6, 5, 9)), GRADED),
        (vg.Box((5, 6, 9), periodic="y"), GRADED),
    ],
)
def test_no_sphere_has_a_way_down(container, sizes):
    packing = deposited(SPHERE, container, count=150, sizes=sizes)
    for vectors in contacts_below(packing):
        assert vectors
        assert not has_way_down(vectors, 2)


def test_disks_rest_on_two_others_or_walls():
    packing = deposited(DISK, vg.Rectangle((12, 30)), count=200, sizes=GRADED)
    assert np.ptp(packing.position[:, 2]) == 0
    for vectors in contacts_below(packing):
        flat = [*vectors, (0, 0, 1.0), (0, 0, -1.0)]
        assert not has_way_down(flat, 1)


def test_densities_are_the_published_ones():
    # Visscher & Bolsterli 1972; Jodrey & Tory 1979
    bed = deposited(SPHERE, vg.Box((14, 14, 20), periodic="xy"), count=4000)
    assert bulk_solid_fraction(bed) == pytest.approx(0.582, abs=0.01)
    flat = deposited(DISK, vg.Rectangle((60, 60), periodic="x"), count=3000)
    assert bulk_solid_fraction(flat) == pytest.approx(0.82, abs=0.015)
    # each sphere rests on three, each disk on two
    for packing, number in ((bed, 6), (flat, 4)):
        mean = 2 * len(contact_pairs(packing)) / packing.count
        assert mean == pytest.approx(number, abs=0.25)


def contact_pairs(packing):
    lengths = np.array([*packing.container.lengths, 1.0])[:3]
    box = np.where([*packing.container.periodic, False][:3], lengths, 1e6)
    return cKDTree(packing.position, boxsize=box).query_pairs(1.0 + 1e-9)


def test_spheres_that_stick_are_as_loose_as_published():
    # Meakin & Jullien: 0.1465 for thick deposits; the layer at the floor is denser
    bed = deposited(SPHERE, vg.Box((20, 20, 60), periodic="xy"), count=5000, sticking=1)
    assert bulk_solid_fraction(bed) == pytest.approx(0.1465, abs=0.008)
    # every sphere hangs at one other, straight below its line of fall
    assert len(contact_pairs(bed)) <= bed.count


def test_the_more_drops_the_denser():
    found = [
        float(bulk_solid_fraction(deposited(SPHERE, vg.Box((10, 10, 30), "xy"), count=1500, drops=drops)))
        for drops in (1, 3, 10)
    ]
    assert (np.diff(found) > 0.003).all()


def test_sticking_is_a_probability():
    found = [
        float(bulk_solid_fraction(deposited(SPHERE, vg.Box((9, 9, 60), "xy"), count=1200, sticking=sticking)))
        for sticking in (0, 0.2, 0.6, 1)
    ]
    assert (np.diff(found) < -0.02).all()


@pytest.mark.parametrize(("shape", "dimension"), [(SPHERE, 3), (DISK, 2)])
def test_clusters_grow_about_the_center(shape, dimension):
    container = vg.Box((40, 40, 40)) if dimension == 3 else vg.Rectangle((60, 60))
    packing = deposited(shape, container, count=800, toward="center")
    middle = np.mean(container.bounds, axis=0)
    assert np.allclose(packing.position[0], middle)
    away = np.linalg.norm(packing.position - middle, axis=1)
    # a compact cluster: its solid fraction within half of its radius is that of a bed
    half = away.max() / 2
    inside = (away < half).sum() / (2 * half) ** dimension
    assert 0.5 < inside < 0.68 if dimension == 3 else 0.75 < inside < 0.907
    # with sticking it grows by mass as radius to the dimension of a ballistic cluster, and is much looser
    loose = deposited(shape, container, count=400, toward="center", sticking=1)
    far = np.linalg.norm(loose.position - middle, axis=1)
    assert (far < half).sum() < 0.6 * (away < half).sum()
    assert packing.gravity is None


def test_a_round_container_is_filled_toward_its_center():
    packing = deposited(SPHERE, vg.Sphere(3), toward="center")
    assert packing.stop_reason == "full"
    assert packing.solid_fraction > 0.3


def test_a_start_stays_and_settling_goes_on():
    box = vg.Box((5, 5, 8), periodic="xy")
    low = deposited(SPHERE, box, count=40)
    both = vg.pack(SPHERE, box, method="deposition", count=40, start=low, seed=5)
    assert np.allclose(both.position[:40], low.position)
    assert both.count == 80
    assert vg.verify(both).ok
    assert np.allclose(low.gravity, (0, 0, -1))
    bed = vg.settle(both)
    assert bed.position[:, 2].mean() < both.position[:, 2].mean() + 0.01
    assert vg.verify(bed).ok


def test_full_containers_end_and_say_so():
    packing = deposited(SPHERE, vg.Box((4, 4, 4)))
    assert packing.stop_reason == "full"
    assert packing.position[:, 2].max() > 3.0


def test_units_change_no_bit():
    one = deposited(SPHERE, vg.Box((4, 4, 9), "x"), count=80)
    other = deposited(SPHERE.scaled(0.25), vg.Box((1, 1, 2.25), "x"), count=80)
    assert (other.position * 4 == one.position).all()


def test_wrong_calls_are_refused_in_one_sentence():
    with pytest.raises(InputError, match="container is 'cylinder' with periodic none: grains roll to a plane floor"):
        vg.pack(SPHERE, vg.Cylinder(3, 5), method="deposition", count=5)
    with pytest.raises(InputError, match="container is 'box' with periodic xyz: grains roll to a plane floor"):
        vg.pack(SPHERE, vg.Box((3, 3, 5), "xyz"), method="deposition", count=5)
    with pytest.raises(InputError, match="periodic is x: grains that fall toward the center have no periodic images"):
        vg.pack(SPHERE, vg.Box((3, 3, 5), "x"), method="deposition", count=5, toward="center")
    with pytest.raises(InputError, match=r"sticking is 1\.5: "):
        vg.pack(SPHERE, vg.Box((3, 3, 5)), method="deposition", count=5, sticking=1.5)
    with pytest.raises(InputError, match="toward is 'centre': it must be one of 'floor', 'center'"):
        vg.pack(SPHERE, vg.Box((3, 3, 5)), method="deposition", count=5, toward="centre")
