import math

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.contacts.walls import escape_depths
from voxgran.containers.kinds.sphere import Sphere
from voxgran.containers.model import Container
from voxgran.geometry.rotation import normalized
from voxgran.shapes.mesh import Mesh


def test_volume_bounds_and_mesh_agree():
    sphere = Sphere(1.5, origin=(1, -1, 3))
    assert sphere.volume == pytest.approx(4.5 * math.pi, rel=1e-15)
    np.testing.assert_array_equal(sphere.bounds, [[-0.5, -2.5, 1.5], [2.5, 0.5, 4.5]])
    mesh = Mesh(*sphere.mesh())
    assert mesh.volume == pytest.approx(sphere.volume, rel=3e-3)
    np.testing.assert_allclose(sphere.signed_distance(mesh.vertices), 0, atol=1e-14)
    np.testing.assert_allclose(
        sphere.signed_distance([(1, -1, 3), (1, -1, 5), (1, 3, 3)]), [-1.5, 0.5, 2.5], atol=1e-15
    )
    assert isinstance(sphere, Container)
    assert sphere.scaled(2) == Sphere(3, origin=(2, -2, 6))


@pytest.mark.parametrize("radius", [0, -1, np.nan, "1"])
def test_bad_sizes_are_refused(radius):
    with pytest.raises(InputError, match="radius of the sphere"):
        Sphere(radius)


SHAPES = [
    vg.make_shape("sphere"),
    vg.make_shape("ellipsoid", semi_axes=(0.9, 0.5, 0.3)),
    vg.make_shape("ellipsoid", semi_axes=(0.7, 0.7, 0.3)),
    vg.make_shape("box", lengths=(1.3, 0.8, 0.5)),
    vg.make_shape("cylinder"),
    vg.make_shape("cone"),
    vg.make_shape("convex_polyhedron", seed=1),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_grains_reach_beyond_the_wall_by_their_farthest_point(shape):
    """Against support points in many directions, which come from below."""
    generator, n = stream(1, "sphere container"), 12
    container = Sphere(2.0, origin=(0.5, 0, -0.2))
    ways = generator.normal(size=(n, 3))
    places = (
        np.array(container.origin) + generator.random((n, 1)) ** 0.5 * 2 * ways / np.linalg.norm(ways, axis=1)[:, None]
    )
    # some exactly at the middle, and on an axis of the grain
    places[0] = container.origin
    turns = normalized(generator.normal(size=(n, 4)))
    turns[:2], places[1] = (1, 0, 0, 0), np.array([0.5, 0, 0.1])
    scale = 0.5 + generator.random(n)
    grains = vg.Packing.of([shape], container, position=places, scale=scale, orientation=turns)
    found = escape_depths(grains)
    directions = generator.normal(size=(60_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for k in range(n):
        body = shape.geometry.support(directions) if hasattr(shape.geometry, "support") else shape.vertices
        world = body * scale[k] @ grains.matrices[k].T + places[k]
        sampled = container.signed_distance(world).max()
        assert -1e-12 <= found[k] - sampled < 2e-3


def test_a_sphere_is_packed_measured_saved_and_drawn(tmp_path):
    container = vg.Sphere(4.0, origin=(10, 0, -3))
    options = {"method": "advancing_front", "mode": "dense", "order": "lowest"}
    packing = vg.pack(vg.make_shape("sphere"), container, sizes=vg.sizes.uniform(0.6, 1.2), **options)
    proof = vg.verify(packing)
    assert proof.ok
    beyond = container.signed_distance(packing.position) + packing.bounding_radii
    assert beyond.max() <= 1e-12
    # pockets at the wall: many touch it
    assert (np.abs(beyond) < 1e-10).sum() > 20
    # from the middle outwards a shell stays open; from the bottom up only the top does
    inner = vg.pack(vg.make_shape("sphere"), container, **{**options, "order": "nearest"})
    assert inner.solid_fraction < packing.solid_fraction - 0.05
    tree = vg.measure(packing, which=["density", "profile"])
    assert float(tree["/"].solid_fraction) == pytest.approx(packing.solid_fraction, rel=1e-12)
    assert 0.5 < float(tree["/"].bulk_solid_fraction) < 0.72
    vg.save(packing, tmp_path / "sphere.vtp")
    assert vg.load(tmp_path / "sphere.vtp").container == container
    spheres = vg.pack(
        vg.make_shape("sphere"), vg.Sphere(2.0), method="digital", count=9, voxel_size=0.1, sweeps=50, feed="at_once"
    )
    assert vg.verify(spheres).ok
    points = vg.pack(vg.make_shape("box"), vg.Sphere(2.0), method="control_point", count=9, sweeps=50, spacing=0.3)
    assert points.count == 9
    assert vg.verify(points).ok


def test_profiles_of_a_full_sphere_are_full():
    """A grain as large as its container fills each slice of it."""
    container = vg.Sphere(0.5)
    whole = vg.Packing.of([vg.make_shape("sphere")], container, position=[(0, 0, 0)])
    assert vg.verify(whole).ok
    profile = vg.measure(whole, which=["profile"])["/profiles"]
    for axis in "xyz":
        values = profile[f"solid_fraction_{axis}"].values
        np.testing.assert_allclose(values[np.isfinite(values)], 1.0, atol=1e-6)
