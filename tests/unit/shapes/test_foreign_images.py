"""Folders of slices, values without a header and files of MATLAB: `load_image` and `open_image` read them alike."""

import json

import numpy as np
import pytest
from PIL import Image as Picture

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, MissingFileError
from voxgran.cli import main

pytestmark = pytest.mark.usefixtures("forked_readers")

h5py = pytest.importorskip("h5py")
scipy_io = pytest.importorskip("scipy.io")
tifffile = pytest.importorskip("tifffile")
pytest.importorskip("dask.array")

#: eleven slices, so that the tenth one has a longer name
VALUES = (np.arange(4 * 5 * 11).reshape(4, 5, 11) * 31 % 251).astype(np.uint8)


@pytest.fixture(params=["load_image", "open_image"])
def read(request):
    return getattr(vg, request.param)


def as_pictures(folder, values, kind=None, suffix=".png"):
    folder.mkdir(exist_ok=True)
    for z in range(values.shape[2]):
        picture = Picture.fromarray(np.ascontiguousarray(values[:, :, z].T))
        (picture if kind is None else picture.convert(kind)).save(folder / f"slice_{z}{suffix}")
    return folder


@pytest.mark.parametrize("kind", [None, "RGB", "P", "LA"])
def test_folders_of_png_slices(kind, read, tmp_path):
    image = read(as_pictures(tmp_path / "png", VALUES, kind), voxel_size=0.1, unit="mm")
    assert image.values.dtype == np.uint8
    np.testing.assert_array_equal(np.asarray(image), VALUES)
    assert (image.voxel_size, image.unit) == ((0.1, 0.1, 0.1), "mm")


def test_png_slices_of_labels_and_masks_keep_their_type(read, tmp_path):
    wide = VALUES.astype(np.uint16) * 200
    np.testing.assert_array_equal(np.asarray(read(as_pictures(tmp_path / "wide", wide))), wide)
    masks = read(as_pictures(tmp_path / "masks", VALUES > 100))
    assert masks.values.dtype == np.bool_
    np.testing.assert_array_equal(np.asarray(masks), VALUES > 100)


@pytest.mark.parametrize("count", [1, 11])
def test_folders_of_tiff_slices(count, read, tmp_path):
    folder = as_pictures(tmp_path / "tiff", VALUES[:, :, :count], suffix=".tif")
    (folder / "notes.txt").write_text("of no interest")
    np.testing.assert_array_equal(np.asarray(read(folder)), VALUES[:, :, :count])


def test_slices_that_make_no_image_are_refused(read, tmp_path):
    folder = as_pictures(tmp_path / "png", VALUES)
    Picture.new("RGB", (4, 5), (1, 2, 3)).save(folder / "slice_4.png")
    with pytest.raises(FileFormatError, match=r"slice_4.png has colors: slices of grey values or labels"):
        np.asarray(read(folder))
    Picture.fromarray(np.zeros((4, 4), dtype=np.uint8)).save(folder / "slice_4.png")
    with pytest.raises(FileFormatError, match=r"slice_4.png is slice 4 .* of \(4, 4\) pixels .* take it away"):
        read(folder)
    (folder / "slice_4.png").write_bytes(b"\x89PNG cut")
    with pytest.raises(FileFormatError, match=r"slice_4.png cannot be read as a .png file"):
        read(folder)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError, match="has no files: slices or a zarr array are needed"):
        read(tmp_path / "empty")


@pytest.mark.parametrize("dtype", ["uint8", ">u2", "<f4"])
def test_values_without_a_header(dtype, read, tmp_path):
    (tmp_path / "scan.raw").write_bytes(VALUES.astype(dtype).tobytes(order="F"))
    image = read(tmp_path / "scan.raw", shape=VALUES.shape, dtype=dtype, voxel_size=2.0)
    np.testing.assert_array_equal(np.asarray(image), VALUES)
    assert image.voxel_size == (2.0, 2.0, 2.0)


@pytest.mark.parametrize(
    ("error", "options", "match"),
    [
        (FileFormatError, {}, r"scan.raw has 220 bytes and no header: .*shape=\(nx, ny, nz\)"),
        (
            FileFormatError,
            {"shape": (4, 5, 10), "dtype": "u1"},
            "has 220 bytes, and 4 x 5 x 10 voxels of uint8 have 200",
        ),
        (InputError, {"shape": (4, 55), "dtype": "u1"}, "three numbers of voxels are needed"),
        (InputError, {"shape": (4, 5, -11), "dtype": "u1"}, "shape is -11: it must be a whole number, at least 1"),
        (InputError, {"shape": (4, 5, 11), "dtype": "bytes9"}, "dtype is 'bytes9': a type of numbers is needed"),
        (InputError, {"shape": (4, 5, 11)}, "dtype is None: a type of numbers is needed"),
        (InputError, {"dtype": "u1"}, "shape is None: three numbers"),
    ],
)
def test_values_whose_shape_or_type_is_missing_or_wrong_are_refused(error, options, match, read, tmp_path):
    (tmp_path / "scan.raw").write_bytes(VALUES.tobytes(order="F"))
    with pytest.raises(error, match=match):
        read(tmp_path / "scan.raw", **options)
    with pytest.raises(MissingFileError):
        read(tmp_path / "none.raw", shape=(1, 1, 1), dtype="u1")


@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_files(compressed, read, tmp_path):
    path = tmp_path / "scan.mat"
    scipy_io.savemat(path, {"bed": VALUES, "text": "words"}, do_compression=compressed)
    np.testing.assert_array_equal(np.asarray(read(path)), VALUES)
    scipy_io.savemat(path, {"bed": VALUES, "mask": VALUES > 9})
    with pytest.raises(FileFormatError, match=r"has the arrays bed, mask: say which one by its key"):
        read(path)
    np.testing.assert_array_equal(np.asarray(read(path, key="mask")), VALUES > 9)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(FileFormatError, match="cut or damaged"):
        read(path)


def test_matlab_files_of_version_7_3(read, tmp_path):
    path = tmp_path / "scan.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("bed", data=VALUES.T, chunks=(3, 2, 2))
        file.create_dataset("#refs#/a", data=VALUES)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    np.testing.assert_array_equal(np.asarray(read(path)), VALUES)
    part = vg.open_image(path, block=(2, 5, 4)).values[1:3, 2, 4:9]
    np.testing.assert_array_equal(part.compute(), VALUES[1:3, 2, 4:9])


def test_files_in_parts_are_loaded_too(tmp_path):
    with h5py.File(tmp_path / "scan.h5", "w") as file:
        file["bed"] = VALUES
    np.testing.assert_array_equal(vg.load_image(tmp_path / "scan.h5").values, VALUES)
    vg.save_image(VALUES, tmp_path / "scan.zarr", voxel_size=0.5, unit="mm")
    image = vg.load_image(tmp_path / "scan.zarr")
    np.testing.assert_array_equal(image.values, VALUES)
    assert (image.voxel_size, image.unit) == ((0.5, 0.5, 0.5), "mm")


@pytest.mark.parametrize("packing", ["tiff_lzw", "group4", "jpeg", "packbits", "tiff_adobe_deflate"])
def test_tiff_packed_in_the_usual_ways(packing, read, tmp_path):
    pytest.importorskip("imagecodecs")
    steps = np.repeat(np.repeat(VALUES[:, :, 0] > 100, 8, axis=0), 8, axis=1)
    values = steps if packing == "group4" else steps.astype(np.uint8) * 200
    Picture.fromarray(values).save(tmp_path / "slice.tif", compression=packing)
    found = np.asarray(read(tmp_path / "slice.tif"))
    found = found.reshape(values.shape[::-1])
    assert any(np.abs(one.astype(float) - values.T).max() <= 4 for one in (found, found[:, ::-1]))


def test_commands_read_files_without_a_header(tmp_path, capsys):
    labels = np.zeros((6, 8, 10), dtype=">u2")
    labels[1:4, 1:5, 2:8], labels[4:6, 5:8, 2:8] = 1, 2
    (tmp_path / "scan.raw").write_bytes(labels.tobytes(order="F"))
    known = ["--shape", "6,8,10", "--dtype", ">u2"]
    assert main(["image", "info", str(tmp_path / "scan.raw"), *known, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["voxels"] == "6 x 8 x 10"
    assert main(["labels", str(tmp_path / "scan.raw"), *known, "--voxel-size", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["grains"] == 2
    assert main(["image", "info", str(tmp_path / "scan.raw")]) == 2
    assert "at the prompt --shape nx,ny,nz --dtype uint16" in capsys.readouterr().err
