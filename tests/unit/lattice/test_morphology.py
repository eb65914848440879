"""Operations with spheres against SciPy's structuring elements; local thickness against all spheres."""

import itertools

import numpy as np
import pytest
from kit import slow
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.lattice import thickness

RADII = [0.0, 1.0, np.sqrt(2), 1.9, np.sqrt(5), 3.0, 4.4]
AROUND = (True, True, True)


def sphere(radius):
    reach = int(np.ceil(radius))
    x = np.arange(-reach, reach + 1)
    return x[:, None, None] ** 2 + x[None, :, None] ** 2 + x[None, None, :] ** 2 <= radius**2 * (1 + 1e-12)


@pytest.fixture(scope="module")
def mask():
    return stream(5, "mask").random((15, 14, 13)) < 0.4


@pytest.mark.parametrize("radius", RADII)
def test_spheres_of_any_radius_are_those_of_scipy(mask, radius):
    element = sphere(radius)
    dilated, eroded = binary_dilation(mask, element), binary_erosion(mask, element, border_value=1)
    assert np.array_equal(vg.dilation(mask, radius), dilated)
    assert np.array_equal(vg.erosion(mask, radius), eroded)
    assert np.array_equal(vg.opening(mask, radius), binary_dilation(eroded, element))
    assert np.array_equal(vg.closing(mask, radius), binary_erosion(dilated, element, border_value=1))


@pytest.mark.parametrize("radius", [1.0, 2.3])
def test_periodic_images_are_those_of_27_copies(mask, radius):
    tiled = np.tile(mask, (3, 3, 3))
    inner = tuple(slice(n, 2 * n) for n in mask.shape)
    for operation in (vg.dilation, vg.erosion, vg.opening, vg.closing):
        assert np.array_equal(operation(mask, radius, periodic=AROUND), operation(tiled, radius)[inner])


def test_laws(mask):
    for radius in (1.0, 2.0):
        assert np.array_equal(vg.erosion(mask, radius), ~vg.dilation(~mask, radius))
        opened, closed = vg.opening(mask, radius), vg.closing(mask, radius)
        assert (opened <= mask).all()
        assert (mask <= closed).all()
        assert np.array_equal(vg.opening(opened, radius), opened)
        assert np.array_equal(vg.closing(closed, radius), closed)


def test_no_free_voxel_and_no_taken_one():
    full, empty = np.ones((4, 5, 6), dtype=bool), np.zeros((4, 5, 6), dtype=bool)
    assert vg.erosion(full, 1e6).all()
    assert not vg.dilation(empty, 1e6).any()
    assert vg.dilation(np.pad(full, 1), 1e6).all()
    with pytest.raises(InputError, match="radius"):
        vg.erosion(full, -1.0)
    with pytest.raises(InputError, match="three axes"):
        vg.opening(full[0], 1.0)


def all_spheres(mask, copies=(1, 1, 1)):
    """Return the local thickness, by painting the sphere of each voxel and of its copies: the plain twin."""
    inner = tuple(slice(n * (many // 2), n * (many // 2 + 1)) for n, many in zip(mask.shape, copies, strict=True))
    squares = np.round(distance_transform_edt(np.tile(mask, copies))[inner] ** 2)
    places = np.argwhere(mask)
    found = np.zeros(mask.shape)
    for shift in itertools.product(*(np.arange(many) - many // 2 for many in copies)):
        for voxel in places:
            near = ((places - voxel - np.array(shift) * mask.shape) ** 2).sum(axis=1) < squares[tuple(voxel)]
            part = tuple(places[near].T)
            found[part] = np.maximum(found[part], squares[tuple(voxel)])
    return 2 * np.sqrt(found)


@pytest.mark.parametrize("index", [0, slow(1), slow(2), slow(3)])
def test_local_thickness_is_that_of_all_spheres(index):
    generator = stream(6, "spheres", index)
    x = np.indices((22, 21, 23))
    mask = np.zeros(x.shape[1:], dtype=bool)
    for _ in range(7):
        middle, radius = generator.uniform(2, 20, 3), generator.uniform(2, 7)
        mask |= ((x - middle[:, None, None, None]) ** 2).sum(axis=0) < radius**2
    for part in (mask, ~mask):
        assert np.allclose(vg.local_thickness(part), all_spheres(part), rtol=1e-6)


@pytest.mark.parametrize("periodic", ["", "x", slow("yz")])
@pytest.mark.parametrize("shape", [(20, 9, 7), (70, 9, 4), slow((5, 8, 70))])
def test_local_thickness_of_wide_rooms(shape, periodic):
    # a few free voxels at one end: spheres of many voxels, wider than the image and than the boxes that are divided
    generator = stream(8, "room", *shape)
    mask = np.ones(shape, dtype=bool)
    mask[tuple(generator.integers(0, [n // 2 for n in shape], (6, 3)).T)] = False
    expected = all_spheres(mask, [7 if axis in periodic else 1 for axis in "xyz"])
    assert expected.max() > 15
    assert np.allclose(vg.local_thickness(mask, periodic=periodic or False), expected, rtol=1e-6)


@pytest.mark.slow
def test_local_thickness_has_the_same_bits_in_double_precision(mask, monkeypatch):
    expected = vg.local_thickness(mask)
    monkeypatch.setattr(thickness, "SINGLE", 0)
    assert np.array_equal(vg.local_thickness(mask), expected)


def test_local_thickness_of_periodic_images():
    mask = stream(7, "noise").random((9, 8, 10)) < 0.98
    tiled = vg.local_thickness(np.tile(mask, (3, 3, 3)))
    assert np.array_equal(vg.local_thickness(mask, periodic=AROUND), tiled[9:18, 8:16, 10:20])


def test_local_thickness_of_what_is_known():
    slab = np.zeros((30, 30, 20), dtype=bool)
    slab[:, :, 5:11] = True
    assert set(np.unique(vg.local_thickness(slab)[slab])) == {6.0}
    x = np.indices((40, 40, 40)) - 19.5
    sphere_of_15 = (x**2).sum(axis=0) < 15**2
    widths = vg.local_thickness(sphere_of_15)
    # its center lies between voxels: spheres about centers are a little smaller
    assert 28 < np.median(widths[sphere_of_15]) <= 30
    with pytest.raises(InputError, match="no free voxel"):
        vg.local_thickness(np.ones((3, 3, 3), dtype=bool))
