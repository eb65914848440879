"""Pore sizes between spheres and walls in closed form: known pores, plain twins of the kernels, errors that hold."""

import itertools
import math

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran.geometry.sphere_pairs import spheres_near
from voxgran.lattice.thickness import cover
from voxgran.measures.model import measure
from voxgran.measures.pores import Bodies, pores_of
from voxgran.measures.registered.voids import voids

SPHERE, DISK = vg.make_shape("sphere"), vg.make_shape("disk")
OFFSETS = ((0.0, 0.0, 0.0), (0.13, 0.29, 0.41), (0.47, 0.02, 0.33))


def empty(container):
    """Return a container without grains."""
    shape = SPHERE if container.dimension == 3 else DISK
    return vg.Packing.of([shape], container, position=np.zeros((0, 3)))


def lattice(kind, offset=(0.0, 0.0, 0.0)):
    """Return touching spheres on a cubic or a face-centered lattice, or disks on a square one, periodic."""
    cell = [(0, 0, 0)] if kind != "fcc" else [(0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5)]
    edge, d = math.sqrt(2) if kind == "fcc" else 1.0, 2 if kind == "square" else 3
    corners = itertools.product(*([range(2)] * d), *([[0]] * (3 - d)))
    place = np.array([np.add(corner, one) * edge for corner in corners for one in cell])
    place[:, :d] += np.array(offset)[:d]
    box = vg.Rectangle((2, 2), periodic="xy") if d == 2 else vg.Box((2 * edge,) * 3, periodic="xyz")
    return vg.Packing.of([DISK if d == 2 else SPHERE], box, position=place)


KNOWN = {
    "sphere": (empty(vg.Sphere(3.0)), 6.0),
    "box": (empty(vg.Box((2.7, 3.3, 4.1))), 2.7),
    "cylinder": (empty(vg.Cylinder(1.3, 5.0)), 2.6),
    "disk": (empty(vg.Disk(1.7)), 3.4),
    **{f"cubic {k}": (lattice("cubic", offset), math.sqrt(3) - 1) for k, offset in enumerate(OFFSETS)},
    **{f"fcc {k}": (lattice("fcc", offset), math.sqrt(2) - 1) for k, offset in enumerate(OFFSETS)},
    **{f"square {k}": (lattice("square", offset), math.sqrt(2) - 1) for k, offset in enumerate(OFFSETS)},
}


@pytest.mark.parametrize("name", [slow(name) if name in ("fcc 0", "fcc 1") else name for name in KNOWN])
def test_the_largest_pore_has_its_diameter(name):
    packing, widest = KNOWN[name]
    tree = measure(packing, "voids")
    assert float(tree.pore_size_max) == pytest.approx(widest, rel=0.01)
    assert abs(float(tree.pore_size_max) - widest) < 2 * tree.pore_size_max.attrs["error"]
    # voxels of another size, of which a pore is not a whole number
    size = float(tree.pore_size_voxel_size) * 1.37
    found = voids(packing, voxel_size=size)
    assert found.sizes.max() <= widest * (1 + 1e-9)
    assert found.sizes.max() == pytest.approx(widest, abs=0.15 * size)


def test_the_largest_pore_between_cubes_is_within_the_error():
    cube, spacing = vg.make_shape("box", lengths=(0.806,) * 3), 1.0075
    place = (np.indices((3,) * 3).reshape(3, -1).T + 0.5) * spacing
    packing = vg.Packing.of([cube], vg.Box((3 * spacing,) * 3, periodic="xz"), position=place)
    assert pores_of(packing, 0.1).bodies is None
    tree = measure(packing, "voids")
    assert abs(float(tree.pore_size_max) - math.sqrt(3) * (spacing - 0.806)) < 2 * tree.pore_size_max.attrs["error"]


@pytest.mark.parametrize("name", ["box", "cylinder", slow("cubic 1"), slow("fcc 2"), "square 1"])
def test_means_are_within_twice_their_error_of_those_of_fine_voxels(name):
    packing = KNOWN[name][0]
    tree = measure(packing, "voids")
    size = float(tree.pore_size_voxel_size)
    exact = [voids(packing, voxel_size=size / factor) for factor in (2, 3)]
    for number in ("pore_size_mean", "pore_size_std", "pore_size_median"):
        for finer in exact:
            if finer.size_voxel < 0.7 * size:
                assert abs(float(tree[number]) - finer.numbers()[number]) < 2 * tree[number].attrs["error"], number


@pytest.mark.slow
def test_the_error_of_the_largest_pore_decays_with_the_voxel():
    sizes, missed = (0.2, 0.1, 0.05), []
    for size in sizes:
        found = [
            float(pores_of(lattice(kind, offset), size).sizes().max()) - math.sqrt(square) + 1
            for kind, square in (("cubic", 3), ("fcc", 2))
            for offset in OFFSETS[1:]
        ]
        missed.append(math.sqrt(np.mean(np.square(found))))
    assert np.polyfit(np.log(sizes), np.log(missed), 1)[0] > 0.8, missed


def test_the_largest_sphere_of_a_voxel_against_a_plain_search():
    generator = np.random.default_rng(4)
    place, scale = generator.uniform(0, 3, (20, 3)), generator.uniform(0.2, 1.0, 20)
    packing = vg.Packing.of([SPHERE], vg.Box((3, 3, 3), periodic="xy"), position=place, scale=scale)
    bodies, edge = Bodies.of(packing), 0.2
    points = generator.uniform(0.1, 2.9, (400, 3))
    images = np.concatenate([place + np.array([i, j, 0]) for i in (-3, 0, 3) for j in (-3, 0, 3)])

    def room(at):
        """Return the distances of points from spheres and walls."""
        away = np.linalg.norm(at[..., None, :] - images, axis=-1) - np.tile(scale / 2, 9)
        return np.minimum(away.min(axis=-1), np.minimum(at[..., 2], 3 - at[..., 2]))

    points = points[room(points) > 0][:30]
    found = bodies.largest_near(points, room(points) + 0.1, edge)
    assert found[:, 3] == pytest.approx(room(found[:, :3]), abs=1e-12)
    assert np.abs(found[:, :3] - points).max() <= edge / 2 + 1e-12
    steps = np.stack(np.meshgrid(*[np.linspace(-edge / 2, edge / 2, 9)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    best = room(points[:, None] + steps).max(axis=1)
    # steps of 1/32 of the edge; a search along ridges may stop before its end
    assert (found[:, 3] - best).min() > -0.15 * edge
    assert abs((found[:, 3] - best).mean()) < 0.02 * edge


@pytest.mark.parametrize("around", [(False, False, False), (True, False, True)])
def test_spheres_with_any_center_cover_as_all_of_them(around):
    generator = np.random.default_rng(5)
    shape = np.array([70, 9, 11])
    mask = generator.random(tuple(shape)) < 0.8
    spheres = np.column_stack([generator.uniform(-0.5, shape - 0.5, (60, 3)), generator.uniform(0.5, 60, 60)])
    turns = itertools.product(*([-2, -1, 0, 1, 2] if turn else [0] for turn in around))
    centers = np.concatenate([spheres[:, :3] + turn * shape for turn in turns])
    squares = np.tile(spheres[:, 3], len(centers) // 60)
    places = np.argwhere(mask)
    held = ((places[:, None] - centers) ** 2).sum(axis=2) < squares
    expected = np.zeros(mask.shape)
    expected[mask] = np.where(held, squares, 0.0).max(axis=1)
    assert np.array_equal(cover(mask, spheres, around), expected)


@pytest.mark.parametrize("periodic", [(False, False, False), (True, False, True), (True, True, True)])
def test_spheres_near_points_against_all_pairs(periodic):
    generator = np.random.default_rng(6)
    lower, lengths = np.array([1.0, 0.0, -1.0]), np.array([3.0, 2.0, 4.0])
    points = lower + generator.uniform(-0.2, 1.2, (40, 3)) * lengths
    centers = lower + generator.uniform(-0.2, 1.2, (50, 3)) * lengths
    reach, radii = generator.uniform(0.1, 1.0, 40), 10 ** generator.uniform(-2, 0, 50)
    i, j, image = spheres_near(
        points, reach, centers, radii, lower=lower, periods=np.diag(np.where(periodic, lengths, 0.0))
    )
    assert (np.diff(i) >= 0).all()
    expected = set()
    for turn in itertools.product(*(range(-4, 5) if around else (0,) for around in periodic)):
        away = np.linalg.norm(points[:, None] - centers - np.array(turn) * lengths, axis=2)
        for a, b in zip(*np.nonzero(away <= reach[:, None] + radii), strict=True):
            expected.add((int(a), int(b), *turn))
    assert len(i) == len(expected)
    assert {(int(a), int(b), *map(int, turn)) for a, b, turn in zip(i, j, image, strict=True)} == expected


def test_a_mirrored_packing_has_mirrored_sizes():
    place = np.array([[1.1, 1.7, 1.4], [2.3, 0.9, 2.2]])
    images = []
    for at in (place, 3 - place):
        pores = pores_of(vg.Packing.of([SPHERE], vg.Box((3, 3, 3)), position=at, gravity=None), 0.15)
        image = np.zeros(pores.mask.shape)
        image[pores.mask] = pores.sizes()
        images.append(image)
    # the search may end at other points of a flat ridge
    assert np.isclose(images[0], images[1][::-1, ::-1, ::-1], atol=0.05).mean() > 0.95


def test_shapes_and_walls_of_other_forms_keep_the_distances_of_the_image():
    clump = vg.fit_clump(vg.make_shape("ellipsoid", semi_axes=(0.4, 0.4, 0.8)), max_spheres=8).to_shape()
    for shape, known in ((clump, True), (vg.make_shape("cylinder"), False)):
        packing = vg.Packing.of([shape], vg.Box((3, 3, 3)), position=[(1.5, 1.5, 1.5)])
        assert (Bodies.of(packing) is not None) == known
    wall = vg.ClosedMesh(vg.make_shape("solid_union", seed=1).scaled(5))
    assert Bodies.of(vg.Packing.of([SPHERE], wall, position=[(0, 0, 0)])) is None
