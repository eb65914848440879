"""Deviation of the solid fraction over windows: independent places, lattices, mixtures, exact volumes of cells."""

import math
import warnings

import numpy as np
import pytest
from kit import lattice, mesh_box, slow
from scipy.spatial.transform import Rotation

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.cylinder import Cylinder
from voxgran.containers.kinds.disk import Disk
from voxgran.containers.kinds.mesh import ClosedMesh
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.containers.kinds.sphere import Sphere
from voxgran.measures.model import measure
from voxgran.measures.registered.homogeneity import _covariance, _deviation, _fit, cell_volumes, homogeneity
from voxgran.measures.window import Solids
from voxgran.packing.model import Packing
from voxgran.packing.pack import pack
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

SPHERE = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
DISK = Shape.of(Outline("disk", radius=0.5), name="disk")


def grains(position, container, scale=1.0, **more):
    """Return spheres, or disks, of equal size at positions."""
    shape = SPHERE if container.dimension == 3 else DISK
    more = {"gravity": None} | more
    return Packing.of([shape], container, position=position, scale=np.full(len(position), scale), **more)


def gas(container, count, seed):
    """Return tiny spheres at independent places in a box or rectangle."""
    low, high = container.bounds
    return grains(low + stream(seed, "gas").random((count, 3)) * (high - low), container, 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "container",
    [Box((10, 10, 10), periodic="xyz"), Box((10, 10, 10)), Rectangle((10, 10), periodic="xy"), Rectangle((10, 10))],
    ids=["periodic", "walls", "periodic 2D", "walls 2D"],
)
def test_independent_places_decay_with_the_root_of_the_volume(container):
    d, count = container.dimension, 3000
    found = [homogeneity(gas(container, count, seed), inset=0.0) for seed in range(10)]
    exponents = np.array([one.exponent for one in found])
    assert exponents.mean() == pytest.approx(-0.5, abs=0.03)
    # the stated error is that of the scatter, which ten packings give to a quarter
    assert 0.5 < np.mean([one.exponent_error for one in found]) / exponents.std(ddof=1) < 2
    deviations = np.array([one.deviation for one in found])
    numbers = count * (found[0].size / 10) ** d
    exact = found[0].solid_fraction / np.sqrt(numbers)
    assert deviations.mean(axis=0) / exact == pytest.approx(np.ones(len(exact)), abs=0.15)
    large = found[0].windows < 300
    ratio = deviations.std(axis=0, ddof=1)[large] / np.mean([one.error for one in found], axis=0)[large]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.45)
    # 5 % is reached at 400 points
    assert np.mean([one.representative_size for one in found]) == pytest.approx(10 * (400 / count) ** (1 / d), rel=0.15)


@pytest.mark.parametrize(
    "container", [Rectangle((5, 6), periodic="xy"), Rectangle((5, 6)), Box((3, 4, 3), periodic="x")]
)
def test_deviations_are_those_of_windows_at_all_places(container):
    """The plain twin cuts each window out of the packing."""
    d, (low, high) = container.dimension, container.bounds
    position = low + 0.3 + stream(2, "place").random((15, 3)) * (high - low - 0.6)
    position[:, d:] = 0
    packing = grains(position, container, 0.5)
    found, solids = homogeneity(packing, inset=0.0), Solids(packing)
    counts = np.floor((high - low)[:d] / 0.25 + 1e-9).astype(int)
    edges = (high - low)[:d] / counts
    steps = np.rint(found.size / np.prod(edges) ** (1 / d)).astype(int)
    for k, step in enumerate(steps[:3]):
        places = [range(n if wraps else n - step + 1) for n, wraps in zip(counts, container.periodic, strict=False)]
        corners = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, d) * edges + low[:d]
        values = [float(solids.volume(corner, corner + step * edges)) for corner in corners]
        share = step**d / np.prod(counts)
        exact = np.std(values) / np.prod(step * edges) / math.sqrt(1 - share)
        assert found.deviation[k] == pytest.approx(exact, rel=1e-9)
        assert found.windows[k] == pytest.approx(1 / share)


def scattered(kind, seed):
    """Return a random packing."""
    cube = Box((12, 12, 12), periodic="xyz")
    if kind.startswith("independent"):
        box, count = (Box((14, 14, 14)), 1570) if "walls" in kind else (cube, 990)
        return grains(box.bounds[1] * stream(seed, "gas").random((count, 3)), box)
    if kind == "dense":
        return pack([SPHERE], cube, method="expand", solid_fraction=0.55, seed=seed)
    if kind == "bed":
        return pack([SPHERE], Box((12, 12, 16)), method="deposition", count=1980, seed=seed)
    container = {
        "rsa": cube,
        "rsa, a wall": Box((14, 14, 14), periodic="xy"),
        "disks": Rectangle((24, 24), periodic="xy"),
        "cylinder": Cylinder(7, 14),
    }[kind]
    shape = DISK if kind == "disks" else SPHERE
    return pack([shape], container, method="rsa", solid_fraction=0.3, seed=seed)


@pytest.mark.parametrize(
    "kind",
    ["disks", *map(slow, ("independent, walls", "independent", "rsa", "rsa, a wall", "cylinder", "dense", "bed"))],
)
def test_stated_errors_are_the_scatter_over_seeds(kind):
    found = [homogeneity(scattered(kind, seed)) for seed in range(24)]
    exponent, stated = (np.array([getattr(one, name) for one in found]) for name in ("exponent", "exponent_error"))
    assert 0.7 < exponent.std(ddof=1) / stated.mean() < 1.4
    deviation, error = (np.array([getattr(one, name) for one in found]) for name in ("deviation", "error"))
    large = found[0].size > 1.9
    assert 0.6 < np.median(deviation.std(axis=0, ddof=1)[large] / error.mean(axis=0)[large]) < 1.6
    size = np.array([[one.representative_size, one.representative_size_error] for one in found])
    assert 0.5 < size[:, 0].std(ddof=1) / size[:, 1].mean() < 1.6


@pytest.mark.slow
@pytest.mark.parametrize("periodic", [slow((True, True)), (True, False), slow((False, False))])
def test_the_covariance_of_deviations_is_that_of_drawn_fields(periodic):
    """Cells with normal values, some of them smoothed, whose variance is above 0 at all sizes."""
    steps, fields = [2, 4, 7], stream(3, "fields").normal(size=(800, 32, 36))
    fields = fields + np.roll(fields, 1, axis=1)
    held = np.ones((32, 36), dtype=bool)
    drawn = np.log([[_deviation(field, held, step, np.array(periodic)) for step in steps] for field in fields])
    stated = np.mean([_covariance(field, 1.0, steps, np.array(periodic)) for field in fields], axis=0)
    assert stated == pytest.approx(np.cov(drawn.T), rel=0.12)


def turned_lattice():
    """Return touching spheres of a simple cubic lattice that is not aligned with the box."""
    grid = (lattice(44, 44, 44) - 22) @ Rotation.from_rotvec([0.4, 0.7, -0.3]).as_matrix().T + [0.1, 0.2, 0.3]
    return grains(grid[(np.abs(grid) < 10).all(axis=1)], Box((20, 20, 20), origin=(-10, -10, -10)))


def test_a_lattice_decays_faster_than_the_surface():
    found = homogeneity(turned_lattice())
    assert found.exponent < -2 / 3
    assert found.solid_fraction == pytest.approx(math.pi / 6, abs=2e-3)
    assert found.representative_size < 1.7


def test_windows_of_whole_cells_of_a_lattice_do_not_differ():
    found = homogeneity(grains(lattice(8, 8, 8), Box((8, 8, 8), periodic="xyz")))
    assert found.size.tolist() == [0.5, 1, 1.5, 2, 2.5, 3.5]
    # half a sphere lies in each half cell, whatever its place
    assert found.deviation == pytest.approx(np.zeros(6), abs=1e-12)
    moved = homogeneity(grains(lattice(8, 8, 8) + 0.2, Box((8, 8, 8), periodic="xyz")))
    assert moved.deviation[[1, 3]] == pytest.approx([0, 0], abs=1e-12)
    # others hold more or less of the sites at their ends
    assert (moved.deviation[[0, 2, 4, 5]] > 0.01).all()
    assert found.solid_fraction == pytest.approx(math.pi / 6)
    assert found.representative_size == 0.5


def test_two_halves_of_different_density_do_not_decay():
    dense, loose = lattice(10, 20, 20) / 2, lattice(7, 14, 14) / 1.4 + [5, 0, 0]
    found = homogeneity(grains(np.concatenate([dense, loose]), Box((10, 10, 10)), 0.5), inset=0.0)
    assert found.exponent > -0.15
    # half the difference of the solid fractions
    apart = math.pi / 6 * (1 - (1.4 / 2) ** 3) / 2
    assert found.deviation[found.size > 1.5].max() == pytest.approx(apart, rel=0.25)
    assert math.isnan(found.representative_size) or found.representative_size > 100


@pytest.mark.parametrize("shape", ["sphere", "ellipsoid", "mesh", "disk", "polygon"])
@pytest.mark.parametrize("periodic", [True, False])
def test_cells_hold_what_windows_hold(shape, periodic):
    shapes = {
        "sphere": SPHERE,
        "ellipsoid": Shape.of(Primitive("ellipsoid", (0.7, 0.4, 0.5)), name="ellipsoid"),
        "mesh": mesh_box((0.9, 0.7, 0.5)),
        "disk": DISK,
        "polygon": Shape.of(Outline("polygon", vertices=[[0, 0], [1, 0], [0.4, 0.9]]), name="polygon"),
    }
    flat = shape in ("disk", "polygon")
    container = Rectangle((3, 4), periodic="xy" if periodic else False) if flat else Box((3, 4, 5), periodic=periodic)
    high = container.bounds[1]
    position = np.column_stack([lattice(2, 2) * [1.5, 2], np.zeros(4)]) if flat else lattice(2, 2, 2) * [1.5, 2, 2.5]
    packing = Packing.of([shapes[shape]], container, position=position + np.array([0.3 * periodic, 0.2, 0]))
    d = packing.dimension
    counts = np.array([4, 5, 6][:d])
    edges = high[:d] / counts
    solids = Solids(packing)
    found = cell_volumes(solids, np.zeros(d), edges, np.ones(tuple(counts), dtype=bool))
    for cell in np.ndindex(*counts):
        low = np.array(cell) * edges
        assert found[cell] == pytest.approx(float(solids.volume(low, low + edges)), abs=1e-12)
    assert found.sum() == pytest.approx(packing.volumes.sum(), rel=1e-9) or not periodic
    some = np.zeros(tuple(counts), dtype=bool)
    some[(1,) * d] = True
    assert cell_volumes(solids, np.zeros(d), edges, some)[some] == pytest.approx(found[some])
    assert cell_volumes(solids, np.zeros(d), edges, some)[~some].sum() == 0


def test_overlapping_spheres_count_once():
    packing = grains([[1.0, 1, 1], [1.5, 1, 1]], Box((2, 2, 2), periodic="xyz"))
    found = cell_volumes(Solids(packing), np.zeros(3), np.ones(3), np.ones((2, 2, 2), dtype=bool))
    lens = math.pi / 12 * (4 * 0.5 + 0.5) * (2 * 0.5 - 0.5) ** 2
    assert found.sum() == pytest.approx(2 * math.pi / 6 - lens, rel=1e-12)


def test_the_mean_is_the_bulk_solid_fraction():
    packing = pack([SPHERE], Box((13, 13, 13)), method="expand", solid_fraction=0.55, seed=1)
    tree = measure(packing, ["density", "homogeneity"])
    found = homogeneity(packing)
    assert found.solid_fraction == pytest.approx(float(tree.bulk_solid_fraction), rel=1e-12)
    assert found.exponent < -0.45
    assert float(tree.homogeneity_exponent) == found.exponent
    assert tree.homogeneity_exponent.attrs["error"] == found.exponent_error
    assert tree["profiles"].window_deviation.values.tolist() == found.deviation.tolist()


@pytest.mark.parametrize(
    "container", [Cylinder(4, 9), Sphere(5), ClosedMesh(mesh_box((8.0, 9.0, 8.0))), Disk(6)], ids=lambda c: c.kind
)
def test_other_containers(container):
    low, high = container.bounds
    position = low + stream(6, "gas").random((9000, 3)) * (high - low)
    if container.dimension == 2:
        position[:, 2] = 0
    packing = grains(position[container.signed_distance(position) < -0.01], container, 1e-3)
    found = homogeneity(packing)
    assert found.exponent == pytest.approx(-0.5, abs=0.08)
    assert found.solid_fraction == pytest.approx(packing.solid_fraction, rel=0.05)


def test_below_the_surface_of_a_bed():
    centers = lattice(8, 8, 8)
    bed = grains(centers, Box((8, 8, 16)), gravity="-z")
    assert homogeneity(bed, inset=0.0).solid_fraction == pytest.approx(math.pi / 6, rel=0.03)


@pytest.mark.parametrize("lengths", [(5, 5, 5), (20, 20, 5)], ids=str)
def test_windows_that_see_single_grains_give_no_exponent(lengths):
    generator = stream(5, "places")
    place = generator.random((int(0.74 * np.prod(lengths)), 3)) * lengths
    box = Box(lengths, periodic="xyz" if lengths[2] == lengths[0] else "xy")
    found = homogeneity(Packing.of([SPHERE], box, position=place))
    assert len(found.size) > 1
    assert math.isnan(found.exponent)
    assert math.isnan(found.representative_size)


def test_the_fit():
    volume = np.array([1.0, 2, 4, 8, 16])
    exponent, reached = _fit(0.3 * volume**-0.7, volume, np.ones(5), 0.0, 0.3 * 3**-0.7)
    assert exponent == pytest.approx(-0.7)
    assert reached == pytest.approx(3)
    # extrapolated
    assert _fit(0.3 * volume**-0.7, volume, np.ones(5), 0.0, 0.3 * 100**-0.7)[1] == pytest.approx(100)
    # only the last three follow another power
    bent = np.where(volume < 4, 1.0, 4 / volume)
    assert _fit(bent, volume, np.ones(5), 4.0, 0.5)[0] == pytest.approx(-1)
    assert math.isnan(_fit(np.ones(5), volume, np.ones(5), 0.0, 0.5)[1])
    assert _fit(np.zeros(5), volume, np.ones(5), 0.0, 0.5)[1] == 1.0
    assert math.isnan(_fit(np.zeros(5), volume, np.ones(5), 0.0, 0.5)[0])


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-50, slow(1e50)])
def test_tiny_and_huge_lengths(scale):
    for container in (Box((8, 9, 10)), Box((8, 9, 10), periodic="xyz"), Cylinder(4, 9), Rectangle((8, 9))):
        low, high = container.bounds
        position = low + (0.2 + 0.6 * stream(9, "gas").random((400, 3))) * (high - low)
        one = homogeneity(grains(position, container, 0.3))
        two = homogeneity(grains(position * scale, container.scaled(scale), 0.3 * scale))
        assert two.deviation == pytest.approx(one.deviation, rel=1e-6)
        assert two.size == pytest.approx(one.size * scale)
        assert two.exponent == pytest.approx(one.exponent, rel=1e-6)
        assert two.representative_size == pytest.approx(one.representative_size * scale, rel=1e-6, nan_ok=True)


def test_few_grains():
    for container in (Box((4, 4, 4)), Box((4, 4, 4), periodic="xyz"), Cylinder(2, 4), Rectangle((4, 4)), Disk(2)):
        with warnings.catch_warnings(action="error"):
            for count in (0, 1):
                tree = measure(grains(container.bounds.mean(axis=0)[None][:count], container), "homogeneity")
                assert count or math.isnan(float(tree.homogeneity_exponent))


def test_what_is_refused():
    packing = grains(lattice(4, 4, 4), Box((4, 4, 4), periodic="xyz"))
    with pytest.raises(InputError, match="tolerance is 0"):
        homogeneity(packing, tolerance=0)
    with pytest.raises(InputError, match="inset is -1"):
        homogeneity(packing, inset=-1)


@pytest.mark.parametrize("height", [3.03, 3.4])
def test_a_region_thinner_than_the_smallest_window_has_no_windows(height):
    """Bars as flat as the region would be called cubes of their volume."""
    found = homogeneity(grains(lattice(6, 6, 3), Box((6, 6, height), periodic="xy")))
    assert not len(found.size)
    assert math.isnan(found.representative_size)


def test_a_region_without_solid_has_no_representative_size():
    found = homogeneity(grains([[0.5, 0.7, 3.2]], Box((6, 6, 6))))
    assert math.isnan(found.representative_size)
