"""Images that stay in their files hold what `load_image` reads, and what is wrong with a file is said in a sentence."""

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, MissingFileError, TooLargeError
from voxgran.lattice import image as lattice_image
from voxgran.shapes.images.image_files import Image

pytestmark = pytest.mark.usefixtures("forked_readers")

da = pytest.importorskip("dask.array")
h5py = pytest.importorskip("h5py")
nrrd = pytest.importorskip("nrrd")
tifffile = pytest.importorskip("tifffile")
zarr = pytest.importorskip("zarr")

VALUES = (np.arange(9 * 10 * 12).reshape(9, 10, 12) * 31 % 251).astype(np.uint16)


def in_blocks(path, **options):
    image = vg.open_image(path, block=(4, 5, 7), **options)
    assert isinstance(image.values, da.Array)
    assert image.values.chunks == ((4, 4, 1), (5, 5), (7, 5))
    assert np.array_equal(image.values[1:8, ::3, 2].compute(), VALUES[1:8, ::3, 2])
    assert np.array_equal(np.asarray(image), VALUES)
    return image


def write_meta(path, *, data="LOCAL", order="False", values=VALUES, more=""):
    head = f"ObjectType = Image\nNDims = 3\nDimSize = 9 10 12\nElementType = MET_USHORT\n{more}"
    head += (
        f"ElementSpacing = 0.5 0.5 0.7\nOffset = 1 2 3\nBinaryDataByteOrderMSB = {order}\nElementDataFile = {data}\n"
    )
    octets = values.astype(">u2" if order == "True" else "<u2").tobytes(order="F")
    path.write_bytes(head.encode() + (octets if data == "LOCAL" else b""))
    if data != "LOCAL":
        (path.parent / data).write_bytes(octets)


def test_arrays_and_memory_maps(tmp_path):
    in_blocks(VALUES)
    in_blocks(da.from_array(VALUES, chunks=3))
    in_blocks(Image(VALUES, (1.0, 1.0, 2.0)))
    for values in (VALUES, np.asfortranarray(VALUES)):
        np.save(tmp_path / "a.npy", values)
        assert in_blocks(tmp_path / "a.npy", voxel_size=0.1, unit="mm").unit == "mm"


def test_zarr(tmp_path):
    array = zarr.create_array(tmp_path / "a.zarr", shape=VALUES.shape, chunks=(4, 4, 4), dtype=VALUES.dtype)
    array[...] = VALUES
    array.attrs.update({"voxel_size": [0.5, 0.5, 1.0], "unit": "mm", "origin": [1.0, 2.0, 3.0]})
    image = in_blocks(tmp_path / "a.zarr")
    assert (image.voxel_size, image.unit, image.origin) == ((0.5, 0.5, 1.0), "mm", (1.0, 2.0, 3.0))
    assert vg.open_image(tmp_path / "a.zarr").values.numblocks == (1, 1, 1)
    group = zarr.open_group(tmp_path / "g.zarr", mode="w")
    group.create_array("one", data=VALUES)
    in_blocks(tmp_path / "g.zarr")
    group.create_array("two", data=VALUES)
    in_blocks(tmp_path / "g.zarr", key="two")
    with pytest.raises(FileFormatError, match="arrays one, two: say which one by its key"):
        vg.open_image(tmp_path / "g.zarr")
    with pytest.raises(FileFormatError, match="no array 'three'"):
        vg.open_image(tmp_path / "g.zarr", key="three")


def write_ome(path, layout, values, axes="tczyx", **changes):
    """Write an image of OME-Zarr of two scales, of NGFF 0.4 in zarr 2 or 0.5 in zarr 3."""
    group = zarr.open_group(path, mode="w", zarr_format=layout)
    arranged = np.transpose(values).reshape((1,) * (len(axes) - 3) + values.shape[::-1])
    levels = []
    for k in range(2):
        data = np.ascontiguousarray(arranged[..., :: k + 1, :: k + 1, :: k + 1])
        group.create_array(str(k), data=data, chunks=(*data.shape[:-3], 4, 4, 4))
        steps = [
            {"type": "scale", "scale": [1.0] * (len(axes) - 3) + [0.5 * (k + 1), 0.25 * (k + 1), 0.25 * (k + 1)]},
            {"type": "translation", "translation": [0.0] * (len(axes) - 3) + [10.0, 20.0, 30.0]},
        ]
        levels.append({"path": str(k), "coordinateTransformations": steps})
    named = [{"name": name, **({"type": "space", "unit": "micrometer"} if name in "xyz" else {})} for name in axes]
    scales = [{"version": "0.4", "axes": named, "datasets": levels, **changes}]
    group.attrs.update({"multiscales": scales} if layout == 2 else {"ome": {"version": "0.5", "multiscales": scales}})


@pytest.mark.parametrize("layout", [2, 3])
@pytest.mark.parametrize("axes", ["zyx", "tczyx"])
def test_ome_zarr_tells_axes_edges_and_unit(tmp_path, layout, axes):
    twice = [{"type": "scale", "scale": [1.0] * (len(axes) - 3) + [2.0] * 3}]
    write_ome(tmp_path / "a.zarr", layout, VALUES, axes)
    image = in_blocks(tmp_path / "a.zarr")
    assert (image.voxel_size, image.unit) == ((0.25, 0.25, 0.5), "um")
    # that of the centre of the first voxel is told
    assert image.origin == (29.875, 19.875, 9.75)
    assert vg.open_image(tmp_path / "a.zarr", voxel_size=0.1, unit="mm").voxel_size == (0.1, 0.1, 0.1)
    coarse = vg.open_image(tmp_path / "a.zarr", key="1")
    assert np.array_equal(np.asarray(coarse), VALUES[::2, ::2, ::2])
    assert coarse.voxel_size == (0.5, 0.5, 1.0)
    write_ome(tmp_path / "b.zarr", layout, VALUES, axes, coordinateTransformations=twice)
    image = vg.open_image(tmp_path / "b.zarr")
    assert (image.voxel_size, image.origin) == ((0.5, 0.5, 1.0), (59.75, 39.75, 19.5))
    with pytest.raises(FileFormatError, match="no array '7': there are 0, 1"):
        vg.open_image(tmp_path / "a.zarr", key="7")


def test_ome_zarr_of_several_channels_and_of_two_axes_is_refused(tmp_path):
    group = zarr.open_group(tmp_path / "a.zarr", mode="w")
    group.create_array("0", data=np.zeros((2, 4, 4, 4), dtype=np.uint8), chunks=(1, 4, 4, 4))
    for axes, words in (("czyx", "2 along c, 4 along z"), ("czyy", "4 along y, 4 along y")):
        scales = [{"axes": [{"name": name} for name in axes], "datasets": [{"path": "0"}]}]
        group.attrs["multiscales"] = scales
        with pytest.raises(FileFormatError, match=words):
            vg.open_image(tmp_path / "a.zarr")


def test_a_zarr_of_very_many_parts_is_refused_soon(tmp_path):
    zarr.create_array(tmp_path / "a.zarr", shape=(10**9, 7, 7), chunks=(4, 4, 4), dtype="u2")
    with pytest.raises(TooLargeError, match="parts of 4 x 4 x 4"):
        vg.open_image(tmp_path / "a.zarr")


@pytest.mark.parametrize("start", [4, 8])
def test_a_slice_with_a_damaged_index_is_named(tmp_path, start):
    (tmp_path / "scan").mkdir()
    for k in range(3):
        tifffile.imwrite(tmp_path / "scan" / f"{k}.tif", VALUES[:, :, k].T)
    whole = bytearray((tmp_path / "scan" / "1.tif").read_bytes())
    # where the index lies, and how many entries it has
    whole[start : start + 4] = b"\xf0\xff\xff\x7f"
    (tmp_path / "scan" / "1.tif").write_bytes(whole)
    with pytest.raises(FileFormatError, match=r"scan/1\.tif"):
        np.asarray(vg.open_image(tmp_path / "scan"))


def test_a_zarr_in_one_part_must_not_be_larger_than_the_memory(tmp_path, monkeypatch):
    zarr.create_array(tmp_path / "a.zarr", data=VALUES, chunks=VALUES.shape)
    in_blocks(tmp_path / "a.zarr")
    monkeypatch.setattr(lattice_image, "memory_limit", lambda: 4 * VALUES.nbytes - 1)
    with pytest.raises(TooLargeError, match=r"parts of 9 x 10 x 12 voxels.*write it in smaller parts"):
        vg.open_image(tmp_path / "a.zarr")


def test_hdf5(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("scan/grey", data=VALUES, chunks=(3, 5, 6), compression="gzip")
    in_blocks(tmp_path / "a.h5")
    in_blocks(tmp_path / "a.h5", key="/scan/grey")
    with pytest.raises(FileFormatError, match="no array 'other': there are scan/grey"):
        vg.open_image(tmp_path / "a.h5", key="other")
    (tmp_path / "b.h5").write_bytes((tmp_path / "a.h5").read_bytes()[:1000])
    with pytest.raises(FileFormatError, match="cut or damaged"):
        vg.open_image(tmp_path / "b.h5")


@pytest.mark.parametrize("compression", [slow(None), "zlib"])
def test_tiff_stacks_and_folders_of_slices(tmp_path, compression):
    how = {"compression": compression, "photometric": "minisblack"}
    tifffile.imwrite(tmp_path / "a.tif", VALUES.T, **how)
    in_blocks(tmp_path / "a.tif")
    folder = tmp_path / "slices"
    folder.mkdir()
    for k, page in enumerate(VALUES.T):
        tifffile.imwrite(folder / f"slice {k}.tif", page, **how)
    (folder / "notes.txt").write_text("of the scanner")
    in_blocks(folder)
    tifffile.imwrite(folder / "slice 7.tif", VALUES.T[7, :, :5], **how)
    with pytest.raises(FileFormatError, match=r"slice 7.tif has slice 7 .* of the shape \(10, 5\)"):
        vg.open_image(folder)
    whole = (folder / "slice 3.tif").read_bytes()
    (folder / "slice 3.tif").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileFormatError, match=r"slice 3.tif"):
        vg.open_image(folder)


def test_tiff_keeps_its_lattice_and_a_cut_stack_names_the_slice(tmp_path):
    vg.save_image(VALUES, tmp_path / "a.tif", voxel_size=(0.1, 0.1, 0.2), unit="mm")
    image = in_blocks(tmp_path / "a.tif")
    assert (image.voxel_size, image.unit) == ((0.1, 0.1, 0.2), "mm")
    whole = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "b.tif").write_bytes(whole[: len(whole) // 3])
    with pytest.raises(FileFormatError, match=r"ends within slice \d+"):
        vg.open_image(tmp_path / "b.tif")


def test_a_slice_that_cannot_be_decoded_is_said_when_it_is_read(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", VALUES.T, compression="zlib", photometric="minisblack")
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        begin = file.pages[6].dataoffsets[0]
    with (tmp_path / "a.tif").open("r+b") as file:
        file.seek(begin)
        file.write(bytes(30))
    image = vg.open_image(tmp_path / "a.tif")
    with pytest.raises(FileFormatError, match=r"a.tif cannot be read"):
        image.values.compute()


@pytest.mark.parametrize("order", ["False", "True"])
@pytest.mark.parametrize("data", ["LOCAL", "a.raw"])
def test_meta_images(tmp_path, order, data):
    write_meta(tmp_path / "a.mha", data=data, order=order)
    image, expected = in_blocks(tmp_path / "a.mha"), vg.load_image(tmp_path / "a.mha")
    assert (image.voxel_size, image.origin) == (expected.voxel_size, expected.origin)
    assert image.voxel_size == (0.5, 0.5, 0.7)


def test_nrrd_attached_and_detached(tmp_path):
    header = {"spacings": [0.1, 0.1, 0.2], "units": ["mm"] * 3, "encoding": "raw"}
    for name in ("a.nrrd", "a.nhdr"):
        nrrd.write(str(tmp_path / name), VALUES.astype(">u2"), header)
        image = in_blocks(tmp_path / name)
        assert (image.voxel_size, image.unit) == ((0.1, 0.1, 0.2), "mm")
    nrrd.write(str(tmp_path / "z.nrrd"), VALUES, header | {"encoding": "gzip"})
    in_blocks(tmp_path / "z.nrrd")


def test_values_that_are_cut_or_lie_elsewhere_are_refused(tmp_path):
    write_meta(tmp_path / "a.mha", values=VALUES[:, :, :11])
    with pytest.raises(FileFormatError, match="it is cut; write it again"):
        vg.open_image(tmp_path / "a.mha")
    write_meta(tmp_path / "a.mhd", data="a.raw")
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.mhd").write_text((tmp_path / "a.mhd").read_text().replace("a.raw", "../a.raw"))
    (tmp_path / "in" / "a.nhdr").write_text(
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: ../a.raw\n"
    )
    for name in ("a.mhd", "a.nhdr"):
        with pytest.raises(FileFormatError, match=r"in it or in one file beside it"):
            vg.open_image(tmp_path / "in" / name)


@pytest.mark.parametrize("head", ["DimSize = 9 x 12", "DimSize = -9 10 12", "ElementSpacing = 1 1", "HeaderSize = a"])
def test_damaged_headers_are_refused(tmp_path, head):
    write_meta(tmp_path / "a.mha", more=head + "\n")
    text = (tmp_path / "a.mha").read_bytes().replace(head.partition(" ")[0].encode() + b" =", b"Old =")
    (tmp_path / "a.mha").write_bytes(text.replace(b"Old =" + head.partition("=")[2].encode(), head.encode()))
    with pytest.raises((FileFormatError, InputError)):
        vg.open_image(tmp_path / "a.mha")


def test_bad_calls(tmp_path):
    with pytest.raises(MissingFileError, match="is not there"):
        vg.open_image(tmp_path / "none.zarr")
    with pytest.raises(InputError, match=r"voxel_size is \[1, 1\]: .* give one or three"):
        vg.open_image(VALUES, voxel_size=[1, 1])
    with pytest.raises(InputError, match="voxel_size"):
        vg.open_image(VALUES, voxel_size=(1, 1, 1, 1))
    with pytest.raises(InputError, match="three axes"):
        vg.open_image(VALUES[0])
    with pytest.raises(InputError, match="three axes"):
        vg.open_image([[1, 2], [3]])
    with pytest.raises(InputError, match="block"):
        vg.open_image(VALUES, block=(4, 4))
    with pytest.raises(InputError, match="block"):
        vg.open_image(VALUES, block=0)
