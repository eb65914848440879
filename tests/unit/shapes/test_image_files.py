"""Images of every format come in with axes x, y, z, or are refused in one line."""

import numpy as np
import pytest
import pyvista
from kit import dicom_slice, slow

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, MissingLibraryError
from voxgran._base.seeds import stream
from voxgran.shapes.images.image_files import load_image

pytestmark = pytest.mark.usefixtures("forked_readers")

IMAGE = np.arange(60, dtype=np.uint16).reshape(3, 4, 5)


def write(path, suffix):
    if suffix == ".npy":
        np.save(path, IMAGE)
    elif suffix == ".npz":
        np.savez_compressed(path, labels=IMAGE)
    elif suffix in (".tif", ".tiff"):
        tifffile = pytest.importorskip("tifffile")
        tifffile.imwrite(
            path, np.moveaxis(IMAGE, (0, 1, 2), (2, 1, 0)), compression="zlib" if suffix == ".tiff" else None
        )
    elif suffix == ".nrrd":
        pytest.importorskip("nrrd").write(str(path), IMAGE, {"spacings": [0.1, 0.2, 0.3]})
    else:
        grid = pyvista.ImageData(dimensions=(4, 5, 6), spacing=(0.1, 0.2, 0.3), origin=(1, 2, 3))
        grid.cell_data["labels"] = IMAGE.ravel(order="F")
        grid.save(path)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".tif", ".tiff", ".nrrd", ".vti"])
def test_every_format_comes_in_alike(suffix, tmp_path):
    path = tmp_path / f"image{suffix}"
    write(path, suffix)
    image = load_image(path)
    np.testing.assert_array_equal(image.values, IMAGE)
    assert image.values.dtype == IMAGE.dtype
    if suffix in (".nrrd", ".vti"):
        assert image.voxel_size == pytest.approx((0.1, 0.2, 0.3))
    if suffix == ".vti":
        assert image.origin == (1, 2, 3)
    if suffix in (".npy", ".tif"):
        base = image.values
        while base is not None and not isinstance(base, np.memmap):
            base = base.base
        assert isinstance(base, np.memmap)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".tif", ".nrrd", ".vti"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_what_is_cut_off_is_refused_in_one_line(suffix, share, tmp_path):
    path = tmp_path / f"image{suffix}"
    write(path, suffix)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(FileFormatError) as caught:
        load_image(path)
    assert "\n" not in str(caught.value)


def test_points_of_a_vtk_image_stand_for_the_voxels_about_them(tmp_path):
    grid = pyvista.ImageData(dimensions=(3, 4, 5), spacing=(2, 2, 2))
    grid.point_data["labels"] = IMAGE.ravel(order="F")
    grid.save(tmp_path / "image.vti")
    image = load_image(tmp_path / "image.vti")
    np.testing.assert_array_equal(image.values, IMAGE)
    assert image.origin == (-1, -1, -1)


def test_of_several_arrays_one_is_chosen_by_its_key(tmp_path):
    np.savez(tmp_path / "image.npz", grey=IMAGE, labels=IMAGE + 1)
    with pytest.raises(FileFormatError, match="arrays grey, labels: say which"):
        load_image(tmp_path / "image.npz")
    with pytest.raises(FileFormatError, match="no array 'lables'"):
        load_image(tmp_path / "image.npz", key="lables")
    np.testing.assert_array_equal(load_image(tmp_path / "image.npz", key="labels").values, IMAGE + 1)


def test_objects_are_not_unpickled(tmp_path):
    np.save(tmp_path / "image.npy", np.array([{"a": 1}]), allow_pickle=True)
    with pytest.raises(FileFormatError, match="cannot be read"):
        load_image(tmp_path / "image.npy")


def test_a_missing_library_is_named_with_its_remedy(tmp_path, monkeypatch):
    # in a process of its own
    monkeypatch.undo()
    (tmp_path / "image.nrrd").write_text("NRRD0004\n")
    (tmp_path / "nrrd.py").write_text("raise ImportError('not installed')\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingLibraryError, match=r"voxgran\[images\]"):
        load_image(tmp_path / "image.nrrd")


def test_a_real_voxel_image_becomes_a_grain(data_dir):
    (shape,) = vg.load_labels(data_dir / "ice_cream_cone.npy", voxel_size=1.0, border="keep")
    mask = np.load(data_dir / "ice_cream_cone.npy")
    assert shape.volume == pytest.approx((mask > 0).sum(), rel=1e-6)


@pytest.mark.parametrize(
    "head",
    [
        slow({"spacings": [1.0, 2.0, 1500.0], "units": ["mm", "mm", "um"]}),
        {"space dimension": 3, "space directions": np.diag([1.0, 2.0, 1500.0]), "space units": ["mm", "mm", "um"]},
    ],
)
def test_axes_of_several_units_are_converted(head, tmp_path):
    nrrd, path = pytest.importorskip("nrrd"), str(tmp_path / "a.nrrd")
    labels = np.zeros((6, 6, 6), dtype=np.uint8)
    labels[2:4, 2:4, 2:4] = 1
    nrrd.write(path, labels, head)
    image = load_image(path)
    assert (image.voxel_size, image.unit) == (pytest.approx((1.0, 2.0, 1.5)), "mm")
    assert vg.load_labels(path)[0].unit == vg.packing_of_labels(path).unit == "mm"
    assert vg.load_labels(path, voxel_size=1.0)[0].unit is None
    assert vg.packing_of_labels(path, voxel_size=1.0, unit="cm").unit == "cm"
    for read in (vg.load_labels, vg.packing_of_labels):
        with pytest.raises(InputError, match="unit is 'um' and the file has its voxels in mm: leave the unit out"):
            read(path, unit="um")
    key = "units" if "units" in head else "space units"
    nrrd.write(path, labels, {**head, key: ["mm", "mm", "foo"]})
    with pytest.raises(FileFormatError, match="axes in mm and mm and foo: where units differ each must be known"):
        load_image(path)
    nrrd.write(path, labels, {**head, key: ["foo", "foo", "foo"]})
    assert load_image(path).unit is None


def small():
    return np.arange(2 * 3 * 4, dtype=np.uint16).reshape(2, 3, 4) * 7


def test_a_metaimage_has_its_lattice_and_its_values_beside_it(tmp_path):
    head = (
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nDimSize = 2 3 4\n"
        "ElementSpacing = 0.1 0.2 0.4\nOffset = 1.05 2.1 3.2\nElementType = MET_USHORT\nElementDataFile = "
    )
    (tmp_path / "scan.mhd").write_text(f"{head}scan.raw\n")
    (tmp_path / "scan.raw").write_bytes(small().ravel(order="F").tobytes())
    (tmp_path / "one.mha").write_bytes(f"{head}LOCAL\n".encode() + small().ravel(order="F").tobytes())
    for name in ("scan.mhd", "one.mha"):
        image = vg.load_image(tmp_path / name)
        np.testing.assert_array_equal(image.values, small())
        assert image.voxel_size == pytest.approx((0.1, 0.2, 0.4))
        # the file tells where the middle of the first voxel is
        assert image.origin == pytest.approx((1.0, 2.0, 3.0))
    for other in ("../scan.raw", "none.raw", "LIST"):
        (tmp_path / "far.mhd").write_text(f"{head}{other}\n")
        with pytest.raises(FileFormatError, match="they must lie in it or in one file beside it"):
            vg.load_image(tmp_path / "far.mhd")


def test_a_folder_of_files_that_are_no_slices_is_told(tmp_path):
    (tmp_path / "a.txt").write_text("no slice")
    with pytest.raises(FileFormatError, match=r"holds a\.txt, and no slices: files of DICOM, TIFF or PNG are needed"):
        vg.load_image(tmp_path)
    # what is damaged is told as such
    (tmp_path / "b.dcm").write_bytes(dicom_slice(small()[:, :, 0], 0, 0.4)[:200])
    with pytest.raises(FileFormatError, match="cut or damaged"):
        vg.load_image(tmp_path)


def test_a_folder_of_dicom_slices_is_an_image_in_millimetres(tmp_path):
    for k in range(4):
        (tmp_path / f"slice{3 - k}.dcm").write_bytes(dicom_slice(small()[:, :, k], k, 0.4))
    image = vg.load_image(tmp_path)
    assert image.values.shape == (2, 3, 4)
    np.testing.assert_array_equal(image.values, small())
    assert image.voxel_size == pytest.approx((0.1, 0.2, 0.4))
    assert image.unit == "mm"
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError):
        vg.load_image(tmp_path / "empty")


def test_tiff_of_ome_and_imagej_tell_the_edges_of_a_voxel(tmp_path):
    tifffile = pytest.importorskip("tifffile")
    pages = small().transpose(2, 1, 0)
    told = {"axes": "ZYX", "PhysicalSizeX": 0.1, "PhysicalSizeY": 0.2, "PhysicalSizeZ": 0.4}
    told |= {f"PhysicalSize{axis}Unit": "mm" for axis in "XYZ"}
    tifffile.imwrite(tmp_path / "ome.ome.tif", pages, metadata=told)
    kept = {"axes": "ZYX", "spacing": 0.4, "unit": "mm"}
    tifffile.imwrite(tmp_path / "imagej.tif", pages, imagej=True, resolution=(10.0, 5.0), metadata=kept)
    tifffile.imwrite(tmp_path / "plain.tif", pages, photometric="minisblack")
    for name in ("ome.ome.tif", "imagej.tif"):
        image = vg.load_image(tmp_path / name)
        np.testing.assert_array_equal(image.values, small())
        assert image.voxel_size == pytest.approx((0.1, 0.2, 0.4))
        assert image.unit == "mm"
    assert vg.load_image(tmp_path / "plain.tif").voxel_size is None


@pytest.mark.parametrize(
    ("way", "share"), [("one series", 0.97), ("one series", 0.6), ("pages alone", 0.6), ("plain", 0.6)]
)
def test_a_tiff_that_is_cut_names_the_slice_and_no_slice_is_lost(way, share, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    pages = stream(0, "pages").integers(0, 5, (20, 30, 40), dtype=np.uint16)
    path = tmp_path / "scan.tif"
    if way == "one series":
        tifffile.imwrite(path, pages, photometric="minisblack", compression="zlib", metadata=None)
    elif way == "plain":
        tifffile.imwrite(path, pages, photometric="minisblack")
    else:
        with tifffile.TiffWriter(path) as writer:
            for page in pages:
                writer.write(page, compression="zlib", contiguous=False)
    np.testing.assert_array_equal(vg.load_image(path).values, pages.transpose(2, 1, 0))
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    slice_number = {0.97: 19, 0.6: 12 if way == "plain" else r"1[12]"}[share]
    with pytest.raises(FileFormatError, match=rf"within slice {slice_number} \(from 0 on\): it is cut"):
        vg.load_image(path)


def test_edges_that_are_given_have_precedence_over_the_file(tmp_path):
    vg.save_image(small(), tmp_path / "scan.tif", voxel_size=0.5, unit="mm")
    told, given = vg.load_image(tmp_path / "scan.tif"), vg.load_image(tmp_path / "scan.tif", voxel_size=(1, 1, 2))
    assert (told.voxel_size, told.unit) == (pytest.approx((0.5, 0.5, 0.5)), "mm")
    assert (given.voxel_size, given.unit) == ((1.0, 1.0, 2.0), None)
    with pytest.raises(InputError, match="the file has its voxels in mm"):
        vg.load_image(tmp_path / "scan.tif", unit="um")
    with pytest.raises(InputError, match="give one or three"):
        vg.load_image(tmp_path / "scan.tif", voxel_size=(1, 2))
