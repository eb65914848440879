"""Label images: a plain twin, volumes, periodic faces and the file."""

import itertools
import warnings

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, PackingWarning, TooLargeError
from voxgran._base.lazy import load as load_library
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.geometry.rotation import random_rotations
from voxgran.io.image import lattice_over, save_image, to_image
from voxgran.measures import painting
from voxgran.packing.model import Packing
from voxgran.shapes.images.image_files import load_image
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

pytestmark = pytest.mark.usefixtures("forked_readers")

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
BOX = Shape.of(Primitive("box", (1.0, 1.0, 1.0)), name="box")


def contains(shape, points):
    """Return whether points in the body frame lie in a primitive or a clump."""
    geometry = shape.geometry
    if isinstance(geometry, Primitive):
        return geometry.contains(points)
    apart = np.linalg.norm(points[:, None] - geometry.centers, axis=2)
    return (apart <= geometry.radii).any(axis=1)


def plain_image(packing, voxel_size):
    """Test every voxel center against every image of every grain: the twin of the kernel."""
    edges, counts = lattice_over(packing, voxel_size)
    lower = packing.container.bounds[0]
    axes = [lower[axis] + (np.arange(counts[axis]) + 0.5) * edges[axis] for axis in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    lengths = packing.container.bounds[1] - packing.container.bounds[0]
    image = np.zeros(len(points), dtype=np.int32)
    steps = [(-1, 0, 1) if periodic else (0,) for periodic in packing.container.periodic]
    for grain in reversed(range(packing.count)):
        for step in itertools.product(*steps):
            away = points - packing.position[grain] - np.array(step) * lengths
            body = away @ packing.matrices[grain] / packing.scale[grain]
            image[contains(packing.shapes[packing.shape_id[grain]], body)] = grain + 1
    return image.reshape(counts)


def test_the_image_is_that_of_the_plain_twin(mixed):
    known = np.flatnonzero(mixed.shape_id != 0)
    packing = Packing.of(
        mixed.shapes,
        mixed.container,
        **{name: getattr(mixed, name)[known] for name in ("position", "orientation", "scale", "shape_id")},
    )
    image = to_image(packing, 0.125)
    assert image.dtype == np.int32
    assert image.shape == (32, 40, 48)
    np.testing.assert_array_equal(image, plain_image(packing, 0.125))
    np.testing.assert_array_equal(to_image(packing, 0.125, labels=False), image > 0)
    for edges in ((0.125, 0.125, 0.25), (0.25, 0.125, 0.5), (0.2, 0.1, 0.1)):
        uneven = to_image(packing, edges)
        assert uneven.shape == tuple(round(length / edge) for length, edge in zip((4, 5, 6), edges, strict=True))
        np.testing.assert_array_equal(uneven, plain_image(packing, edges))


@pytest.mark.parametrize("suffix", [".vti", ".tif"])
def test_three_edges_of_a_voxel_come_back_from_files(suffix, tmp_path):
    image = np.arange(24, dtype=np.int32).reshape(2, 3, 4)
    save_image(image, tmp_path / f"image{suffix}", voxel_size=(0.1, 0.15, 0.4), unit="mm")
    back = load_image(tmp_path / f"image{suffix}")
    np.testing.assert_array_equal(back.values, image)
    assert back.voxel_size == pytest.approx((0.1, 0.15, 0.4), rel=1e-6)
    assert back.unit == "mm"
    for wrong in ((0.1, 0.2), (0.1, 0.2, 0.3, 0.4), 0.0, (0.1, -1, 0.1), "abc"):
        with pytest.raises(InputError, match="every edge must be a finite number above 0; give one or three"):
            save_image(image, tmp_path / f"other{suffix}", voxel_size=wrong)


def test_meshes_keep_their_volume(block):
    packing = Packing.of([block], Box((4, 4, 4)), position=[[2, 2, 2]], orientation=[[0.5, 0.5, 0.5, 0.5]], scale=[1.3])
    image = to_image(packing, 0.05)
    assert image.sum() * 0.05**3 == pytest.approx(packing.volumes[0], rel=0.03)
    middle = (np.argwhere(image) + 0.5).mean(axis=0) * 0.05
    np.testing.assert_allclose(middle, [2, 2, 2], atol=0.03)


def test_the_volume_converges_at_the_second_order():
    """The lattice points in a sphere shifted at random deviate from its volume by h**2."""
    box, places = Box((2, 2, 2)), 1 + 0.1 * stream(3, "places").random((40, 3))
    sizes, spread = np.array([0.2, 0.1, 0.05]), []
    for size in sizes:
        packings = [Packing.of([BALL], box, position=[place]) for place in places]
        errors = [to_image(p, size, labels=False).sum() * size**3 / p.volumes[0] - 1 for p in packings]
        spread.append(np.sqrt(np.mean(np.square(errors))))
    rate = np.polyfit(np.log(sizes), np.log(spread), 1)[0]
    assert 1.7 < rate < 2.4
    assert spread[-1] < 3e-3


def test_a_grain_goes_on_across_a_periodic_face():
    for shape in (BALL, BOX, Shape.of(Spheres(np.zeros((1, 3)), np.array([0.5])), name="clump")):
        shapes = [shape]
        inner = Packing.of(shapes, Box((4, 4, 4), periodic=(True, True, True)), position=[[2, 2, 2]])
        corner = Packing.of(shapes, inner.container, position=[[0, 4, 8]])
        rolled = np.roll(to_image(inner, 0.25), (-8, 8, 8), axis=(0, 1, 2))
        np.testing.assert_array_equal(to_image(corner, 0.25), rolled)
        walled = Packing.of(shapes, Box((4, 4, 4)), position=[[0, 2, 2]])
        assert to_image(walled, 0.25).sum() * 2 == to_image(inner, 0.25).sum()


def test_a_grain_larger_than_a_periodic_box_fills_it():
    packing = Packing.of(
        [Shape.from_mesh(BOX.scaled(3.0).vertices, BOX.faces)],
        Box((2, 2, 2), periodic=(True, True, True)),
        position=[[1, 1, 1]],
    )
    assert (to_image(packing, 0.25) == 1).all()


def test_where_two_grains_hold_a_center_the_first_counts():
    shapes = [BALL.scaled(2.0), BOX]
    for order in ([0, 1], [1, 0]):
        packing = Packing.of(shapes, Box((4, 4, 4)), position=[[2, 2, 2]] * 2, shape_id=order)
        image = to_image(packing, 0.25)
        first = Packing.of(shapes, packing.container, position=[[2, 2, 2]], shape_id=order[:1])
        np.testing.assert_array_equal(image == 1, to_image(first, 0.25) == 1)


def test_in_two_dimensions_there_is_one_layer(flat):
    image = to_image(flat, 0.02)
    assert image.shape == (200, 200, 1)
    areas = np.bincount(image.ravel(), minlength=4)[1:] * 0.02**2
    np.testing.assert_allclose(areas, flat.volumes, rtol=0.02)


def test_an_empty_packing_is_void():
    assert not to_image(Packing.of([], Box((1, 1, 1)), position=[]), 0.1).any()


def test_a_period_that_is_no_whole_number_of_voxels_is_said(spheres):
    with pytest.warns(PackingWarning, match=r"period along x is 13\.3333 voxels .*; take 0\.2857142857"):
        image = to_image(spheres, 0.3)
    assert image.shape == (14, 14, 14)


def test_bad_voxel_sizes_are_refused(spheres):
    for value in (0.0, -1.0, np.nan, "a"):
        with pytest.raises(InputError, match="voxel_size"):
            to_image(spheres, value)
    with pytest.raises(TooLargeError, match="take larger voxels"):
        to_image(spheres, 1e-4)


@pytest.mark.parametrize("labels", [True, False])
def test_the_file_holds_the_image(spheres, labels, tmp_path):
    image = to_image(spheres, 0.25, labels=labels)[:, :12, :9]
    save_image(image, tmp_path / "i.vti", voxel_size=0.25, origin=(1, 2, 3))
    data = load_library("pyvista").read(tmp_path / "i.vti")
    assert data.dimensions == (17, 13, 10)
    assert data.origin == (1, 2, 3)
    np.testing.assert_array_equal(data.cell_data["image"].reshape(image.shape, order="F"), image)


@pytest.mark.parametrize("shape", [(5, 4, 3), (5, 4, 1), (1, 4, 3), (5, 1, 3), (2, 3, 4)])
@pytest.mark.parametrize("kind", [np.bool_, np.int64, np.float32])
def test_a_stack_of_pages_comes_back_and_has_pages_along_z(shape, kind, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    image = (np.arange(np.prod(shape)).reshape(shape) % 7).astype(kind)
    save_image(image, tmp_path / "i.tif", voxel_size=0.5)
    back = load_image(tmp_path / "i.tif").values
    np.testing.assert_array_equal(np.asarray(back).reshape(shape), image)
    pages = tifffile.imread(tmp_path / "i.tif")
    assert pages.dtype == (np.float32 if kind is np.float32 else np.uint8)
    if shape[2] > 1 and 1 not in shape:
        np.testing.assert_array_equal(pages[1], image[:, :, 1].T)


@pytest.mark.parametrize(
    ("values", "kind"),
    [((0, 255), "uint8"), ((0, 256), "uint16"), ((0, 65536), "int32"), ((-1, 3), "int32"), ((0, 2**40), "int64")],
)
def test_stacks_have_the_smallest_type_that_holds_the_labels(values, kind, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    save_image(np.array(values).reshape(1, 1, 2), tmp_path / "i.tiff", voxel_size=1.0)
    pages = tifffile.imread(tmp_path / "i.tiff")
    assert (pages.dtype, tuple(pages.ravel())) == (np.dtype(kind), values)


def test_images_of_another_kind_are_refused(tmp_path):
    with pytest.raises(FileFormatError, match=r"kept as \.vti, \.tif, \.tiff, \.zarr; choose one"):
        save_image(np.zeros((2, 2, 2)), tmp_path / "i.png", voxel_size=1.0)
    for bad in (np.zeros((2, 2)), np.full((2, 2, 2), "a")):
        with pytest.raises(InputError, match="give numbers along x, y and z"):
            save_image(bad, tmp_path / "i.vti", voxel_size=1.0)


def test_porespy_measures_the_same_porosity():
    """The image is what users of porespy take: True (or above 0) for solid, so that the void is its inverse."""
    porespy = pytest.importorskip("porespy")
    ticks = np.arange(4) + 0.5
    position = np.array(np.meshgrid(ticks, ticks, ticks)).reshape(3, -1).T
    shape = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
    packing = Packing.of([shape], Box((4, 4, 4), "xyz"), position=position)
    labels = to_image(packing, 0.05)
    assert porespy.metrics.porosity(labels == 0) == pytest.approx(packing.porosity, abs=6e-3)
    assert porespy.metrics.porosity(~to_image(packing, 0.05, labels=False)) == pytest.approx(packing.porosity, abs=6e-3)
    assert len(np.unique(labels)) - 1 == packing.count


@pytest.mark.parametrize("shape", [BALL, BOX])
def test_grains_many_periods_away_take_no_more_images(shape):
    near = Packing.of([shape], Box((4, 4, 4), "xy"), position=[(1, 1, 1), (3.875, 2, 2)])
    away = Packing.of([shape], Box((4, 4, 4), "xy"), position=[(1, 1 - 4e5, 1), (3.875 + 4e9, 2, 2)])
    assert np.array_equal(to_image(away, 0.25), to_image(near, 0.25))
    chords = [load_library("voxgran").measure(packing, which=["voids"])["voids"] for packing in (near, away)]
    assert chords[0].equals(chords[1])


def test_a_tilt_of_no_whole_number_of_voxels_is_told():
    # axes y and z are as many voxels, but what comes back along y is shifted along x by 3.75
    box = vg.Box((4, 4, 4), "xyz", tilt=(1.5, 0, 0.8))
    bed = vg.Packing.of(vg.make_shape("sphere"), box, position=[[0.2, 0.3, 0.4]])
    with pytest.warns(PackingWarning, match=r"the tilt xy is 3\.75 voxels and the image does not repeat") as caught:
        image = vg.to_image(bed, 0.4)
    assert len(caught) == 1
    assert image.any()
    with warnings.catch_warnings(action="error"):
        vg.to_image(bed, 0.1)
        vg.to_image(bed, (0.5, 0.4, 0.4))


SOLIDS = {
    "ellipsoid": Primitive("ellipsoid", (0.4, 0.7, 1.1)),
    "cylinder": Primitive("cylinder", (0.5, 1.4)),
    "cone": Primitive("cone", (0.6, 1.5)),
    "spherocylinder": Primitive("spherocylinder", (0.4, 1.0)),
    "box": Primitive("box", (0.6, 0.9, 1.3)),
}


@pytest.mark.parametrize("edges", [(0.2, 0.25, 0.125), (0.125, 0.2, 0.2)])
@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_voxelized_once_for_each_image_whatever_the_edges(name, edges, monkeypatch):
    shape = Shape.of(SOLIDS[name], name=name)
    packing = Packing.of(
        shape,
        Box((4, 5, 4), "xyz"),
        position=[(0.1, 2.5, 2), (2.0, 4.9, 1.1)],
        orientation=random_rotations(stream(3, name), 2),
    )
    calls = []
    for call in ("occupy", "centers_in"):
        real = getattr(painting, call)
        monkeypatch.setattr(painting, call, lambda *given, real=real, **more: calls.append(1) or real(*given, **more))
    image = to_image(packing, edges)
    np.testing.assert_array_equal(image, plain_image(packing, edges))
    # once for each periodic image that may reach into the cell, not for each row of voxels
    assert len(calls) <= 8


@pytest.mark.parametrize(
    "outline", [Outline("disk", radius=0.45), Outline("polygon", vertices=np.array([(-0.5, -0.4), (0.7, 0), (0, 0.6)]))]
)
def test_outlines_are_voxelized_with_any_edges(outline):
    turns = np.array([[np.cos(a), 0, 0, np.sin(a)] for a in (0.3, 2.0)])
    flat = Packing.of(
        Shape.of(outline, name="outline"), Rectangle((4, 3)), position=[(1.1, 1.2, 0), (2.9, 1.9, 0)], orientation=turns
    )
    # each fifth column of the centers of squares
    np.testing.assert_array_equal(to_image(flat, (0.05, 0.01, 1.0)), to_image(flat, 0.01)[2::5])
