"""Grains that fall one after the other, and stick or roll."""

from pathlib import Path

import numpy as np
import pytest
from kit import slow
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.measures.registered.density import bulk_solid_fraction

SCAN = vg.load_shape(Path(__file__).parents[4] / "data" / "eros.obj")
SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
GRADED, WIDE = vg.sizes.uniform(0.6, 1.4), vg.sizes.uniform(0.3, 1.7)


def deposited(shape, container, **options):
    """Return a packing that is proven to be free of overlap."""
    packing = vg.pack(shape, container, method="deposition", **options)
    assert vg.verify(packing).ok
    return packing


def walls_near(container, point):
    """Return the distances of a point from the walls, and the unit vectors toward them; in closed form, as a twin."""
    if container.kind in ("mesh", "polygon"):
        return walls_of_mesh(container, point)
    lower, upper = container.bounds
    flat = {"cylinder": (2,), "sphere": (), "disk": ()}.get(container.kind, range(container.dimension))
    found = []
    for axis in flat:
        if not container.periodic[axis]:
            found.append((point[axis] - lower[axis], -np.eye(3)[axis]))
            found.append((upper[axis] - point[axis], np.eye(3)[axis]))
    if container.kind in ("cylinder", "sphere", "disk"):
        away = point - (lower + upper) / 2
        away[2] *= container.kind == "sphere"
        far = np.linalg.norm(away)
        found.append((container.radius - far, away / max(far, 1e-300)))
    return found


def nearest_on_segments(one, two, point):
    """Return the points of segments (m, 3) that are nearest to a point."""
    along = two - one
    share = np.clip(((point - one) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
    return one + share[:, None] * along


def walls_of_mesh(container, point):
    """Return the distances of a point from all triangles of a mesh or sides of a polygon, and unit vectors to them."""
    if container.dimension == 2:
        loops = [container.corners, *container.holes]
        one = np.concatenate([np.column_stack([loop, np.zeros(len(loop))]) for loop in loops])
        two = np.concatenate([np.column_stack([np.roll(loop, -1, axis=0), np.zeros(len(loop))]) for loop in loops])
        nearest = nearest_on_segments(one, two, point)
    else:
        vertices, faces = container.mesh()
        a, b, c = np.moveaxis(vertices[faces], 1, 0)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        foot = point - ((point - a) * normal).sum(axis=1)[:, None] * normal
        pairs = ((a, b), (b, c), (c, a))
        inside = np.all([(np.cross(q - p, foot - p) * normal).sum(axis=1) >= 0 for p, q in pairs], axis=0)
        sides = np.array([nearest_on_segments(p, q, point) for p, q in pairs])
        best = np.linalg.norm(sides - point, axis=2).argmin(axis=0)
        nearest = np.where(inside[:, None], foot, sides[best, np.arange(len(faces))])
    away = np.linalg.norm(nearest - point, axis=1)
    return list(zip(away, (nearest - point) / away[:, None], strict=True))


def contacts_below(packing):
    """Return for each grain the unit vectors from it to what touches it, walls included, within 1e-9."""
    container, up = packing.container, packing.dimension - 1
    lower, upper = container.bounds
    lengths = np.where(container.periodic, upper - lower, np.inf)
    centers, radii = packing.position, packing.diameters / 2
    vectors = [[] for _ in centers]
    for i in range(len(centers)):
        step = centers - centers[i]
        step -= np.where(np.isfinite(lengths), np.round(step / lengths), 0) * np.where(np.isfinite(lengths), lengths, 0)
        away = np.linalg.norm(step, axis=1)
        near = np.flatnonzero((away < radii + radii[i] + 1e-9) & (away > 0))
        vectors[i] += [step[j] / away[j] for j in near if j < i]
        # a lid carries nothing
        vectors[i] += [n for gap, n in walls_near(container, centers[i]) if gap < radii[i] + 1e-9 and n[up] < 0.999]
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
        (vg.Cylinder(2.6, 12), None),
        (vg.Cylinder(2.6, 22, origin=(3, -2, 1)), WIDE),
        # grains rest on one other and the wall
        (vg.Cylinder(0.8, 200), GRADED),
        (vg.Sphere(3.6), None),
        (vg.Sphere(5.2, origin=(-1, 5, 2)), WIDE),
        (vg.ClosedMesh(vg.Shape.from_mesh(*vg.Box((6, 5, 9)).mesh())), GRADED),
        slow(vg.ClosedMesh(vg.make_shape("superquadric", diameter=9.0)), None),
        (vg.ClosedMesh(vg.make_shape("solid_union", seed=3, diameter=10.0)), GRADED),
        slow(vg.ClosedMesh(SCAN.scaled(9.0 / SCAN.diameter)), WIDE),
    ],
)
def test_no_sphere_has_a_way_down(container, sizes):
    packing = deposited(SPHERE, container, count=150, sizes=sizes)
    assert packing.count > 100
    for vectors in contacts_below(packing):
        assert vectors
        assert not has_way_down(vectors, 2)


@pytest.mark.parametrize(
    "container",
    [
        vg.Rectangle((12, 30)),
        vg.Disk(9),
        vg.Disk(9, origin=(3, -4)),
        vg.Polygon([[0, 0], [20, 0], [20, 9], [9, 9], [9, 30], [0, 25]]),
        vg.Polygon([[0, 0], [20, 0], [20, 20], [0, 20]], holes=[[[8, 8], [12, 9], [11, 12], [8, 12]]]),
    ],
)
def test_disks_rest_on_two_others_or_walls(container):
    packing = deposited(DISK, container, count=150, sizes=GRADED)
    assert packing.count == 150
    assert np.ptp(packing.position[:, 2]) == 0
    for vectors in contacts_below(packing):
        flat = [*vectors, (0, 0, 1.0), (0, 0, -1.0)]
        assert not has_way_down(flat, 1)


@pytest.mark.parametrize(
    "container",
    [vg.Box((10, 10, 30)), vg.Cylinder(6, 30), vg.Sphere(9), vg.ClosedMesh(vg.make_shape("torus", diameter=18.0))],
)
def test_no_path_ends_without_rest(container):
    packing = deposited(SPHERE, container, count=2000, sizes=GRADED)
    assert packing.provenance["lost"] == 0
    assert packing.count > 1400


def test_grains_fall_evenly_over_the_section_of_a_cylinder():
    """Half of the grains that stick to the floor are beyond the radius of half of the area."""
    packing = deposited(SPHERE, vg.Cylinder(31, 4), count=400, sticking=1)
    low = packing.position[packing.position[:, 2] < 0.5 + 1e-9]
    far = np.linalg.norm(low[:, :2], axis=1) / 30.5
    assert len(low) > 200
    assert (far**2).mean() == pytest.approx(0.5, abs=3 * np.sqrt(1 / 12 / len(low)))


def test_spheres_that_stick_stay_at_what_they_touch_first():
    packing = deposited(SPHERE, vg.Sphere(5), sticking=1)
    for i, vectors in enumerate(contacts_below(packing)):
        # the lowest sphere or the wall is straight below, or beside
        assert vectors, i
        assert min(vector[2] for vector in vectors) < 1e-6
    assert packing.solid_fraction < 0.25


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
    assert 0.5 < inside < 0.68 if dimension == 3 else 0.75 < inside < 0.94
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
    with pytest.raises(InputError, match="periodic is xyz: grains fall along z, to a floor; give a container"):
        vg.pack(SPHERE, vg.Box((3, 3, 5), "xyz"), method="deposition", count=5)
    with pytest.raises(InputError, match="periodic is y: grains fall along y, to a floor"):
        vg.pack(DISK, vg.Rectangle((3, 5), "y"), method="deposition", count=5)
    with pytest.raises(InputError, match="periodic is x: grains that fall toward the center have no periodic images"):
        vg.pack(SPHERE, vg.Box((3, 3, 5), "x"), method="deposition", count=5, toward="center")
    with pytest.raises(InputError, match=r"sticking is 1\.5: "):
        vg.pack(SPHERE, vg.Box((3, 3, 5)), method="deposition", count=5, sticking=1.5)
    with pytest.raises(InputError, match="toward is 'centre': it must be one of 'floor', 'center'"):
        vg.pack(SPHERE, vg.Box((3, 3, 5)), method="deposition", count=5, toward="centre")
