"""The largest place of a shape in a cell, against closed forms and SciPy's linear programmes."""

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

import voxgran as vg
from voxgran._base.seeds import philox_key
from voxgran.containers.kernel_container import kernel_container
from voxgran.geometry.rotation import rotation_matrices
from voxgran.packing.model import Packing
from voxgran.packing.tessellation.voronoi_bodies import bodies_of, farthest_from_axis, poses_of, reach_along
from voxgran.packing.tessellation.voronoi_cells import Cells, seeds_of
from voxgran.packing.tessellation.voronoi_fit import Places, empty_programme, fit_shapes
from voxgran.packing.tessellation.voronoi_grains import corners_of

KEY = philox_key(1, "test")


def regular(shape):
    """Return a shape at unit equivalent diameter."""
    return shape.scaled(1 / shape.diameter)


class Fits:
    """Grains of one shape in the cells of seeds."""

    def __init__(self, container, shape, place, most=np.inf):
        n = len(place)
        self.container, self.shape, self.place, self.n = container, regular(shape), place, n
        self.cells = Cells(kernel_container(container, from_corner=True))
        self.cells.grow()
        self.seeds = seeds_of(place, np.zeros(n), self.cells.walls)
        self.arm, self.turn, self.size = np.zeros((n, 3)), np.tile([1.0, 0, 0, 0], (n, 1)), np.zeros(n)
        self.most = np.full(n, most)

    def fit(self, tries=1, *, around=False):
        poses = poses_of([self.shape], np.zeros(self.n, dtype=int), self.arm, self.turn, self.size)
        places = Places(self.arm.copy(), self.turn.copy(), self.size.copy())
        cells = self.cells.around(self.seeds, bodies_of([self.shape]), poses)
        assert fit_shapes(cells, empty_programme(128), places, around, self.most, tries, KEY, 0, self.n) == self.n
        self.arm, self.turn, self.size = places
        return self

    def packing(self):
        place = self.place + self.arm + self.container.bounds[0]
        return Packing.of([self.shape], self.container, position=place, scale=self.size, orientation=self.turn)


def one(container, shape, tries=1, **options):
    """Return the size of the largest place in a container."""
    place = 0.3 * (container.bounds[1] - container.bounds[0])[None]
    if container.kind in ("cylinder", "sphere", "disk"):
        place = 0.45 * (container.bounds[1] - container.bounds[0])[None]
    fits = Fits(container, shape, place, **options).fit(tries)
    assert vg.verify(fits.packing()).ok
    return float(fits.size[0])


def random_places(container, count, seed=0):
    lower, upper = container.bounds
    return np.random.default_rng(seed).random((count, 3)) * (upper - lower)


def test_the_largest_sphere_touches_the_nearest_walls():
    sphere, disk = vg.make_shape("sphere"), vg.make_shape("disk")
    assert one(vg.Box((3, 2, 5)), sphere) == pytest.approx(2)
    assert one(vg.Rectangle((3, 2)), disk) == pytest.approx(2)
    assert one(vg.Cylinder(1, 5), sphere) == pytest.approx(2, rel=1e-6)
    assert one(vg.Sphere(1.5), sphere) == pytest.approx(3, rel=1e-6)
    assert one(vg.Disk(1), disk) == pytest.approx(2, rel=1e-6)
    # the radius of the circle in a triangle with sides 3, 4, 5 is 1
    assert one(vg.Polygon([(0, 0), (4, 0), (0, 3)]), disk) == pytest.approx(2)
    assert one(vg.Box((3, 2, 5)), sphere, most=0.7) == pytest.approx(0.7)


def test_the_largest_cube_in_a_cube_a_sphere_and_a_cylinder():
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    edge = (np.pi / 6) ** (1 / 3)
    # in a cube one that is parallel to it: the search finds it nearly
    assert one(vg.Box((2, 2, 2)), cube, 400) * edge == pytest.approx(2, rel=0.02)
    # in a sphere any orientation does
    assert one(vg.Sphere(1), cube) * edge == pytest.approx(2 / np.sqrt(3), rel=1e-4)
    # in a flat cylinder one that stands, and in a long one the square across has the diameter as diagonal
    assert one(vg.Cylinder(3, 1), cube, 400) * edge == pytest.approx(1, rel=0.03)


def test_a_cube_in_a_plane_turned_by_a_known_angle():
    # the largest square in one that is turned by an angle a has the edge 1 / (cos a + sin a)
    square = vg.Shape.of(vg.shapes.outline.Outline("polygon", vertices=[(0, 0), (1, 0), (1, 1), (0, 1)]), name="square")
    fits = Fits(vg.Rectangle((1, 1)), square, np.array([[0.3, 0.6, 0.0]])).fit(1)
    angle = 2 * np.arctan2(fits.turn[0, 3], fits.turn[0, 0])
    edge = fits.size[0] * np.sqrt(np.pi / 4)
    assert edge == pytest.approx(1 / (abs(np.cos(angle)) + abs(np.sin(angle))))
    assert Fits(vg.Rectangle((1, 1)), square, np.array([[0.3, 0.6, 0.0]])).fit(150).size[0] * np.sqrt(
        np.pi / 4
    ) == pytest.approx(1, rel=1e-3)


@pytest.mark.parametrize(
    ("container", "shape"),
    [
        (vg.Box((3, 3, 3), "x"), vg.make_shape("solid_union", seed=3)),
        (vg.Box((3, 3, 3)), vg.make_shape("cone")),
        (vg.Rectangle((3, 3)), vg.make_shape("polygon")),
    ],
)
def test_places_are_the_optima_of_linear_programmes(container, shape):
    d = container.dimension
    fits = Fits(container, shape, random_places(container, 25)).fit(1)
    bodies, turn = bodies_of([fits.shape]), rotation_matrices(fits.turn)
    for i in range(25):
        corners = corners_of(fits.cells, fits.seeds, i)
        planes = ConvexHull(corners).equations
        planes = planes[np.abs(planes[:, d:3]).max(axis=1, initial=0) < 0.5]
        reach = [reach_along(bodies, 0, turn[i].ravel(), *normal, np.zeros(3)) for normal in planes[:, :3]]
        rows = np.column_stack([planes[:, :d], reach])
        best = linprog([0] * d + [-1], A_ub=rows, b_ub=-planes[:, 3], bounds=[(None, None)] * (d + 1))
        assert fits.size[i] == pytest.approx(best.x[-1], rel=1e-6)
    assert vg.verify(fits.packing()).ok


@pytest.mark.parametrize("kind", ["box", "ellipsoid", "cylinder", "cone", "spherocylinder", "sphere", "solid_union"])
def test_reaches_are_those_of_many_points_of_the_surface(kind):
    shape = regular(vg.make_shape(kind, **({"seed": 1} if kind == "solid_union" else {})))
    bodies, rng = bodies_of([shape]), np.random.default_rng(0)
    turn = rotation_matrices(np.array([[0.5, 0.5, -0.5, 0.5]]))[0]
    points = shape.vertices @ turn.T
    way = np.zeros(6)
    for normal in rng.normal(size=(20, 3)):
        normal /= np.linalg.norm(normal)
        found = reach_along(bodies, 0, turn.ravel(), *normal, way)
        assert found == pytest.approx((points @ normal).max(), abs=shape.tessellation_error + 1e-12)
        assert found >= (points @ normal).max() - 1e-12
    for place in rng.normal(size=(5, 3)):
        for axes in (2, 3):
            far = np.linalg.norm((place + 0.7 * points)[:, :axes], axis=1).max()
            found = farthest_from_axis(bodies, 0, turn.ravel(), 0.7, *place, axes, way)
            assert found == pytest.approx(far, abs=shape.tessellation_error + 1e-9)
            assert np.linalg.norm(way[:3]) == pytest.approx(1)


@pytest.mark.parametrize(
    ("container", "kind"),
    [(vg.Box((4, 4, 4), "xyz"), "box"), (vg.Box((4, 4, 4)), "ellipsoid"), (vg.Cylinder(2, 3), "cylinder")],
)
def test_rounds_enlarge_all_places_and_keep_grains_apart(container, kind):
    place = random_places(container, 60)
    place = place[container.signed_distance(place + container.bounds[0]) < 0]
    fits = Fits(container, vg.make_shape(kind), place).fit(20)
    before = [fits.size.copy()]
    assert vg.verify(fits.packing()).ok
    for _ in range(3):
        fits.fit(10, around=True)
        before.append(fits.size.copy())
        assert vg.verify(fits.packing()).ok
    assert (np.diff(before, axis=0) >= 0).all()
    assert (before[-1] ** 3).sum() > 1.08 * (before[0] ** 3).sum()


def test_more_orientations_find_larger_places():
    place = random_places(vg.Box((3, 3, 3)), 40)
    found = [(Fits(vg.Box((3, 3, 3)), vg.make_shape("box"), place).fit(n).size ** 3).sum() for n in (1, 8, 60)]
    assert found[1] > 1.15 * found[0]
    assert found[2] > 1.1 * found[1]
