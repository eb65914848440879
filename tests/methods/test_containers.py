"""Every packing method in every container, also in a user's own: grains stay inside, or the container is refused."""

import itertools
import warnings

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran.packing.digital.container_lattice import ContainerLattice, free_voxels
from voxgran.packing.method import method_registry

BALL = vg.make_shape("sphere", diameter=0.8)


class Ring:
    """A user's own container: what is between two upright cylinders of radius 0.5 and 2."""

    kind, dimension, periodic = "ring", 3, (False, False, False)

    def __init__(self, size=1.0):
        self.size = size

    volume = property(lambda self: np.pi * (2**2 - 0.5**2) * 3 * self.size**3)
    bounds = property(lambda self: self.size * np.array([[-2.0, -2.0, 0.0], [2.0, 2.0, 3.0]]))

    def signed_distance(self, points):
        x, y, z = np.asarray(points, dtype=float).T / self.size
        away = np.hypot(x, y)
        return self.size * np.max([away - 2.0, 0.5 - away, -z, z - 3.0], axis=0)

    def mesh(self):
        return vg.Cylinder(2.0 * self.size, 3.0 * self.size).mesh()

    def scaled(self, factor):
        return Ring(self.size * factor)

    def to_mapping(self):
        return {"kind": self.kind, "size": self.size}


class Ward(Ring):
    """A user's own container in two dimensions."""

    kind, dimension = "ward", 2
    volume = property(lambda self: np.pi * (2**2 - 0.5**2) * self.size**2)
    bounds = property(lambda self: self.size * np.array([[-2.0, -2.0, 0.0], [2.0, 2.0, 0.0]]))

    def signed_distance(self, points):
        away = np.linalg.norm(np.asarray(points, dtype=float)[:, :2], axis=1) / self.size
        return self.size * np.maximum(away - 2.0, 0.5 - away)

    def scaled(self, factor):
        return Ward(self.size * factor)


def bent():
    """Return a mesh that is not convex: two boxes that make an L."""
    corners = np.array([(0, 0), (3, 0), (3, 1.4), (1.4, 1.4), (1.4, 3), (0, 3)])
    vertices = np.vstack([np.column_stack([corners, np.full(6, z)]) for z in (0.0, 3.0)])
    top = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 5), (3, 4, 5)])
    sides = [(k, (k + 1) % 6, 6 + k) for k in range(6)] + [((k + 1) % 6, 6 + (k + 1) % 6, 6 + k) for k in range(6)]
    return vg.ClosedMesh(vg.Shape.from_mesh(vertices, np.vstack([top[:, ::-1], top + 6, sides])))


SOLID = {
    "box": vg.Box((3, 3, 3), "x"),
    "cylinder": vg.Cylinder(2.0, 3.0),
    "sphere": vg.Sphere(2.0, origin=(5, 0, 0)),
    "mesh": bent(),
    "own": Ring(),
}
HOLED = vg.Polygon([(0, 0), (6, 0), (6, 4), (3, 2.5), (0, 4)], holes=[[(2, 1), (3, 1), (3, 2), (2, 2)]])
X, Y = np.indices((120, 90))
PICTURE = (((X - 60) / 55) ** 2 + ((Y - 45) / 40) ** 2 < 1) & (np.hypot(X - 40, Y - 45) > 12)
FLAT = {
    "rectangle": vg.Rectangle((3, 3), "x"),
    "disk": vg.Disk(2.0, origin=(5, 1)),
    "polygon": HOLED,
    "picture": vg.Polygon.from_image(PICTURE, pixel_size=0.05),
    "own, flat": Ward(),
}

#: cases that take seconds
LONG = [("control_point", "mesh"), ("jam", "picture"), ("compress", "box"), ("growth", "box")]
#: containers whose walls a compression moves
COMPRESSIBLE = ("box", "cylinder", "sphere", "rectangle", "disk")


@pytest.mark.parametrize(
    ("method", "container"),
    [
        # distances that a class computes in Python, asked for of grains that jam
        slow(method, container)
        if (method == "jam" and container.startswith("own")) or (method, container) in LONG
        else (method, container)
        for method, container in itertools.product(vg.packing_methods(), [*SOLID, *FLAT])
    ],
)
def test_grains_stay_inside_or_the_container_is_refused(method, container):
    where, shape = {**SOLID, **FLAT}[container], BALL if container in SOLID else vg.make_shape("disk", diameter=0.8)
    known = method_registry().get(method)
    if where.dimension not in known.dimensions:
        pytest.skip("another dimension")
    if container.startswith("own") and not known.any_container:
        words = f"container is of type {type(where).__name__}, known by .* only, which method '{method}' does not take"
        with pytest.raises(InputError, match=words):
            vg.pack(shape, where, method=method, count=5)
        return
    if method == "apollonian" and container not in ("sphere", "rectangle", "disk"):
        with pytest.raises(InputError, match="exact gaskets are in"):
            vg.pack(shape, where, method=method, count=5)
        return
    if method == "multilayer" and container not in ("box", "rectangle"):
        with pytest.raises(InputError, match="layers lie on the floor"):
            vg.pack(shape, where, method=method, count=5)
        return
    if method == "compress" and container not in COMPRESSIBLE:
        with pytest.raises(InputError, match="its walls do not move"):
            vg.pack(shape, where, method=method, count=5)
        return
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        packing = vg.pack(shape, where, method=method, count=12 if where.dimension == 3 else 5)
    assert packing.count >= 4
    assert vg.verify(packing).ok if container in ("disk", "polygon", "picture") else vg.verify(packing).escaped == 0
    where = packing.container if method == "compress" else where
    if where.dimension == 3 or container.startswith("own"):
        assert (where.signed_distance(packing.position) + packing.diameters / 2).max() <= 1e-9


@pytest.mark.parametrize("where", [Ring(), Ward()])
def test_free_voxels_of_any_container_lie_wholly_inside(where):
    dimension, (lower, upper) = where.dimension, where.bounds
    corners = np.indices((2,) * dimension + (1,) * (3 - dimension)).reshape(3, -1).T
    for size in (0.07, 0.083, 0.1, 0.13):
        shape = np.maximum(((upper - lower) / size).astype(np.int64), 1)
        free = free_voxels(where, ContainerLattice(np.array(lower), size, shape))
        for corner in corners:
            assert where.signed_distance(lower + size * (np.argwhere(free) + corner)).max() <= 1e-12
        assert free.sum() * size**dimension > 0.65 * where.volume


def test_what_is_not_wholly_a_container_is_told_what_it_lacks():
    class Half:
        dimension, bounds = 3, np.array([[0.0] * 3, [1.0] * 3])

        def signed_distance(self, points):
            return np.zeros(len(points))

    with pytest.raises(InputError, match="container has no kind, periodic, volume, mesh, scaled, to_mapping: a cont"):
        vg.pack(BALL, Half(), method="digital", count=1)
