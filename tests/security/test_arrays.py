"""Images in zarr, HDF5, netCDF, TIFF and PNG that would run code, read other files, or fill the memory."""

import json
import os
import pickle
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, TooLargeError, VoxgranError

h5py = pytest.importorskip("h5py")
tifffile = pytest.importorskip("tifffile")
zarr = pytest.importorskip("zarr")

SECRET = b"what nobody else may read, and what is as long as an array is: 64 B"[:64]
RAW = {"shape": [4, 4, 4], "chunks": [4, 4, 4], "dtype": "|u1", "compressor": None, "filters": None}
RAW |= {"zarr_format": 2, "fill_value": 0, "order": "C", "dimension_separator": "."}
BYTES = {"name": "bytes", "configuration": {"endian": "little"}}


class Hostile:
    """An object whose pickle makes a file when it is read."""

    def __init__(self, mark):
        self.mark = str(mark)

    def __reduce__(self):
        return Path.touch, (Path(self.mark),)


@pytest.fixture
def mark(tmp_path):
    """Return a file that is there once code of a file has run."""
    yield tmp_path / "touched"
    assert not (tmp_path / "touched").exists()


@pytest.fixture
def secret(tmp_path):
    """Return a file that lies beside the folder of the files that are read."""
    (tmp_path / "in").mkdir()
    (tmp_path / "secret").write_bytes(SECRET)
    return tmp_path / "secret"


def refused(path, *, key=None, match=None, read=vg.open_image):
    with pytest.raises(VoxgranError, match=match) as caught:
        np.asarray(read(path, **({} if key is None else {"key": key})))
    assert "\n" not in str(caught.value)
    assert caught.type in (FileFormatError, InputError)


def write_v2(folder, chunk, **changes):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ".zarray").write_text(json.dumps({**RAW, **changes}))
    (folder / "0.0.0").write_bytes(chunk)
    return folder


def write_v3(folder, chunk, codecs):
    grid = {"name": "regular", "configuration": {"chunk_shape": [4, 4, 4]}}
    about = {"zarr_format": 3, "node_type": "array", "shape": [4, 4, 4], "data_type": "uint8", "chunk_grid": grid}
    about |= {"fill_value": 0, "codecs": codecs, "attributes": {}}
    about["chunk_key_encoding"] = {"name": "default", "configuration": {"separator": "."}}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "zarr.json").write_text(json.dumps(about))
    (folder / "c.0.0.0").write_bytes(chunk)
    return folder


PICKLE = {"id": "pickle"}
IN_ARRAYS = [
    {"compressor": PICKLE},
    {"filters": [PICKLE]},
    {"filters": [{"id": "shuffle"}, PICKLE], "compressor": {"id": "zlib"}},
    {"dtype": "|O", "filters": [PICKLE]},
    {"dtype": "|O", "compressor": PICKLE},
    {"dtype": "|O", "filters": [{"id": "vlen-array", "dtype": "<i8"}]},
    {"filters": [{"id": "json2"}]},
]


@pytest.mark.parametrize("place", ["array", "group", "consolidated", "ome"])
@pytest.mark.parametrize("changes", IN_ARRAYS)
def test_codecs_of_zarr_that_are_programs_are_refused(place, changes, mark, tmp_path):
    path = tmp_path / "a.zarr"
    array = path if place == "array" else path / "0"
    write_v2(array, pickle.dumps(Hostile(mark)), **changes)
    if place != "array":
        (path / ".zgroup").write_text('{"zarr_format": 2}')
    if place == "consolidated":
        hidden = {**RAW, **changes}
        # what is listed holds, and not what lies there
        write_v2(array, pickle.dumps(Hostile(mark)))
        listed = {".zgroup": {"zarr_format": 2}, "0/.zarray": hidden}
        (path / ".zmetadata").write_text(json.dumps({"zarr_consolidated_format": 1, "metadata": listed}))
    if place == "ome":
        scales = [{"axes": [{"name": name} for name in "zyx"], "datasets": [{"path": "0"}]}]
        (path / ".zattrs").write_text(json.dumps({"multiscales": scales}))
    refused(path)
    if place != "consolidated":
        refused(path, key=None if place == "array" else "0")


@pytest.mark.parametrize("name", ["pickle", "numcodecs.pickle", "vlen-utf8", "os.system"])
@pytest.mark.parametrize("inner", [False, True])
def test_codecs_of_zarr_3_are_numbers_only(name, inner, mark, tmp_path):
    codecs = [BYTES, {"name": name, "configuration": {}}]
    if inner:
        shard = {"chunk_shape": [4, 4, 4], "codecs": codecs, "index_codecs": [BYTES]}
        codecs = [{"name": "sharding_indexed", "configuration": shard}]
    refused(write_v3(tmp_path / "a.zarr", pickle.dumps(Hostile(mark)), codecs))


@pytest.mark.parametrize("layout", [2, 3])
def test_known_codecs_of_zarr_are_read(layout, tmp_path):
    values = np.arange(64, dtype=np.uint8).reshape(4, 4, 4)
    if layout == 2:
        packed = zlib.compress(np.diff(values.ravel(), prepend=0).astype(np.uint8).tobytes())
        steps = [{"id": "delta", "dtype": "|u1", "astype": "|u1"}]
        path = write_v2(tmp_path / "a.zarr", packed, filters=steps, compressor={"id": "zlib", "level": 1})
    else:
        path = tmp_path / "a.zarr"
        made = zarr.create_array(path, shape=(4, 4, 4), chunks=(2, 2, 2), shards=(4, 4, 4), dtype="u1")
        made[...] = values
    assert np.array_equal(vg.open_image(path), values)


@pytest.mark.parametrize("chunks", [[0, 4, 4], [4, 4, 0]])
def test_chunks_of_no_length_are_refused(chunks, tmp_path):
    refused(write_v2(tmp_path / "a.zarr", b"", chunks=chunks))


def packed_zeros(many, *, gzip):
    """Return so many times 2**20 zeros as zlib or gzip has them, of which one block is computed."""
    packer, zeros = zlib.compressobj(9, wbits=-15), bytes(2**20)
    packer.compress(zeros)
    packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(zeros) + packer.flush(zlib.Z_FULL_FLUSH)
    check = 0 if gzip else 1
    for _ in range(many):
        check = (zlib.crc32 if gzip else zlib.adler32)(zeros, check)
    begin = bytes((31, 139, 8, 0, 0, 0, 0, 0, 0, 3)) if gzip else bytes((0x78, 0xDA))
    end = struct.pack("<II", check, many * 2**20) if gzip else struct.pack(">I", check)
    return begin + block * many + packer.flush() + end


@pytest.mark.parametrize("kind", ["zarr", "zarr shard", "hdf5", "tiff"])
def test_a_chunk_that_unpacks_to_more_than_the_memory_is_refused(kind, tmp_path, monkeypatch):
    monkeypatch.setattr("voxgran._base.guarded.MEMORY", 2**28)
    bomb = packed_zeros(600, gzip=kind == "zarr shard")
    path = tmp_path / f"a.{kind[:4]}"
    if kind == "zarr":
        write_v2(path, bomb, compressor={"id": "zlib", "level": 9})
    elif kind == "zarr shard":
        gzip = {"name": "gzip", "configuration": {"level": 1}}
        shard = {"chunk_shape": [4, 4, 4], "codecs": [BYTES, gzip], "index_codecs": [BYTES]}
        inner = bomb + struct.pack("<QQ", 0, len(bomb))
        write_v3(path, inner, [{"name": "sharding_indexed", "configuration": shard}])
    elif kind == "hdf5":
        path = tmp_path / "a.h5"
        with h5py.File(path, "w") as file:
            made = file.create_dataset("x", shape=(16, 16, 16), dtype="u1", chunks=(16, 16, 16), compression="gzip")
            made.id.write_direct_chunk((0, 0, 0), bomb)
    else:
        path = tmp_path / "a.tif"
        tifffile.imwrite(path, np.zeros((16, 16), dtype=np.uint8), compression="zlib")
        raw = path.read_bytes()
        with tifffile.TiffFile(path) as file:
            tag = file.pages[0].tags["StripOffsets"], file.pages[0].tags["StripByteCounts"]
        raw = bytearray(raw + bomb)
        for one, value in zip(tag, (len(raw) - len(bomb), len(bomb)), strict=True):
            raw[one.valueoffset : one.valueoffset + 4] = struct.pack("<I", value)
        path.write_bytes(raw)
    before = Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]
    refused(path)
    after = Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]
    assert int(after) - int(before) < 2**18


def png(width, height):
    """Return a picture of one colour, of a few bytes for a million pixels."""

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(1 + 4 * width)) for _ in range(height)) + packer.flush()
    head = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def test_a_picture_that_unpacks_to_more_than_the_memory_is_refused(tmp_path, monkeypatch):
    (tmp_path / "small.png").write_bytes(png(8, 8))
    assert vg.load_image(tmp_path / "small.png").values.shape == (8, 8)
    (tmp_path / "a.png").write_bytes(png(4000, 4000))
    assert (tmp_path / "a.png").stat().st_size < 2**17
    monkeypatch.setattr("voxgran._base.guarded.MEMORY", 2**26)
    monkeypatch.setattr("voxgran._base.guarded.MEMORY_PER_BYTE", 1)
    refused(tmp_path / "a.png", read=vg.load_image)


def test_hdf5_reads_no_other_file(secret):
    path = secret.parent / "in" / "a.h5"
    other = secret.parent / "other.h5"
    with h5py.File(other, "w") as file:
        file["y"] = np.frombuffer(SECRET, dtype=np.uint8).reshape(4, 4, 4)
    layout = h5py.VirtualLayout(shape=(4, 4, 4), dtype="u1")
    layout[...] = h5py.VirtualSource(str(other), "y", shape=(4, 4, 4))
    with h5py.File(path, "w") as file:
        file.create_dataset("external", shape=(4, 4, 4), dtype="u1", external=[(str(secret), 0, 64)])
        file.create_virtual_dataset("virtual", layout)
        file["link"] = h5py.ExternalLink(str(other), "/y")
        file["soft"] = h5py.SoftLink("/link")
        file["folder"] = h5py.ExternalLink(str(other), "/")
        file["own"] = np.ones((4, 4, 4))
    for key, words in (
        ("external", "'/external' in other files: write them into it"),
        ("virtual", "'/virtual' in other files"),
        ("link", "no array 'link'"),
        ("soft", "no array 'soft'"),
        ("folder/y", "no array 'folder/y'"),
    ):
        refused(path, key=key, match=words)
    assert np.asarray(vg.open_image(path, key="own")).sum() == 64


def test_a_file_that_names_none_at_first_reads_no_other_later(secret):
    path = secret.parent / "in" / "a.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("x", data=np.zeros((4, 4, 4), dtype=np.uint8))
    image = vg.open_image(path)
    path.unlink()
    with h5py.File(path, "w") as file:
        file.create_dataset("x", shape=(4, 4, 4), dtype="u1", external=[(str(secret), 0, 64)])
    with pytest.raises(FileFormatError, match="in other files"):
        np.asarray(image)


@pytest.mark.usefixtures("forked_readers")
@pytest.mark.parametrize("kind", ["external", "virtual", "link"])
def test_netcdf_reads_no_other_file(kind, secret):
    path, other = secret.parent / "in" / "a.nc", secret.parent / "other.h5"
    with h5py.File(other, "w") as file:
        file["y"] = np.frombuffer(SECRET, dtype=np.uint8)
    with h5py.File(path, "w") as file:
        if kind == "external":
            file.create_dataset("x", shape=(64,), dtype="u1", external=[(str(secret), 0, 64)])
        elif kind == "virtual":
            layout = h5py.VirtualLayout(shape=(64,), dtype="u1")
            layout[...] = h5py.VirtualSource(str(other), "y", shape=(64,))
            file.create_virtual_dataset("x", layout)
        else:
            file["x"] = h5py.ExternalLink(str(other), "/y")
    words = "has the values of 'x' in other files: write them into it" if kind == "virtual" else "cannot be read"
    refused(path, read=vg.load_statistics, match=words)


@pytest.mark.usefixtures("forked_readers")
def test_a_learned_distribution_reads_no_other_file(tmp_path):
    path = tmp_path / "a.nc"
    vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=12)).save(path)
    with h5py.File(path, "a") as file:
        held = file["vertices"][...]
        del file["vertices"]
        layout = h5py.VirtualLayout(shape=held.shape, dtype=held.dtype)
        layout[...] = h5py.VirtualSource("other.h5", "y", shape=held.shape)
        file.create_virtual_dataset("vertices", layout)
    refused(path, read=vg.ShapeModel.load, match="has the values of 'vertices' in other files")


@pytest.mark.parametrize("name", ["a.zarr", "a.mhd", "a.nhdr"])
def test_links_in_a_folder_lead_to_no_other_place(name, secret):
    path = secret.parent / "in" / name
    if name == "a.zarr":
        write_v2(path, b"")
        (path / "0.0.0").unlink()
        place = path / "0.0.0"
    else:
        place = path.with_suffix(".raw")
        meta = "ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\n"
        nrrd = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\nendian: little\n"
        path.write_text(
            f"{meta}ElementDataFile = {place.name}\n" if name == "a.mhd" else f"{nrrd}data file: {place.name}\n"
        )
    place.symlink_to(secret)
    refused(path, match=r"link to another place|they must lie in it or in one file beside it")
    if name == "a.mhd":
        refused(path, read=vg.load_image, match="they must lie in it")
    place.unlink()
    os.link(secret, place)
    assert np.asarray(vg.open_image(path)).size == 64


OME = """<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" UUID="urn:uuid:1">
<Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint8" SizeX="4" SizeY="4" SizeZ="2" SizeC="1"
SizeT="1"><TiffData IFD="0" FirstZ="0" PlaneCount="1"><UUID FileName="a.tif">urn:uuid:1</UUID></TiffData>
<TiffData IFD="0" FirstZ="1" PlaneCount="1"><UUID FileName="{}">urn:uuid:2</UUID></TiffData></Pixels></Image></OME>"""


@pytest.mark.usefixtures("forked_readers")
@pytest.mark.parametrize("packed", [None, "zlib"])
@pytest.mark.parametrize("name", ["../secret", "/secret", "beside.tif"])
def test_a_tiff_file_reads_no_other_file(name, packed, secret):
    path = secret.parent / "in" / "a.tif"
    for place in (secret, path.with_name("beside.tif")):
        tifffile.imwrite(place, np.full((4, 4), 7, dtype=np.uint8), compression=packed)
    told = OME.format(f"{secret.parent}{name}" if name.startswith("/") else name)
    how = {"metadata": None, "compression": packed}
    tifffile.imwrite(path, np.zeros((4, 4), dtype=np.uint8), description=told.encode(), **how)
    refused(path, read=vg.load_image, match="has slices in other files, which may lie anywhere")
    assert not np.asarray(vg.open_image(path)).any()
    # all slices in one file
    told = told.replace('FileName="beside.tif">urn:uuid:2', 'FileName="a.tif">urn:uuid:1').replace(
        'IFD="0" FirstZ="1"', 'IFD="1" FirstZ="1"'
    )
    if name == "beside.tif":
        tifffile.imwrite(path, np.full((2, 4, 4), 3, dtype=np.uint8), description=told.encode(), **how)
        assert vg.load_image(path).values.tolist() == np.full((4, 4, 2), 3).tolist()


META = "ObjectType = Image\n{}NDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\nElementDataFile = {}\n"


@pytest.mark.usefixtures("forked_readers")
@pytest.mark.parametrize(
    ("comment", "name"),
    [
        ("Comment = ElementDataFile = LOCAL\n", "../secret"),
        ("Name = ElementDataFile=LOCAL\n", "../secret"),
        ("", "LIST\n../secret\n../secret\n../secret\n../secret"),
        ("", "LIST 3D\n../secret"),
        ("", "s%d 1 4 1"),
    ],
)
def test_a_metaimage_names_one_file_in_one_line(comment, name, secret):
    path = secret.parent / "in" / "a.mhd"
    path.write_text(META.format(comment, name))
    for beside in ("LOCAL", "LIST", "LIST 3D", "s%d 1 4 1"):
        (path.parent / beside).write_bytes(bytes(64))
    for k in range(1, 5):
        (path.parent / f"s{k}").symlink_to(secret)
    for read in (vg.load_image, vg.open_image):
        refused(path, read=read, match="does not say in one line where its values are")
    path.write_text(META.format("Comment = data of all\n", "LOCAL") + "7" * 64)
    assert (vg.load_image(path).values == ord("7")).all()
    assert (np.asarray(vg.open_image(path)) == ord("7")).all()


def test_an_array_takes_half_of_the_memory_since_it_is_passed_on(tmp_path, monkeypatch):
    path = write_v2(tmp_path / "a.zarr", b"", shape=[400, 1000, 1000], chunks=[400, 1000, 1000], fill_value=1)
    monkeypatch.setattr("voxgran._base.guarded.memory_limit", lambda: 600 * 2**20)
    with pytest.raises(TooLargeError, match="does not fit in memory"):
        vg.load_image(path)


def test_arrays_without_voxels_and_with_too_many_are_refused(tmp_path, capfd):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("none", (0, 3, 3), dtype="u1")
        file.create_dataset("many", (10**6, 10**6, 10**6), chunks=(100, 100, 100), dtype="u1")
    refused(tmp_path / "a.h5", key="none", match=r"shape \(0, 3, 3\)")
    assert vg.load_image(tmp_path / "a.h5", key="none").values.shape == (0, 3, 3)
    with pytest.raises(TooLargeError, match="does not fit in memory"):
        vg.load_image(tmp_path / "a.h5", key="many")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("told", [{"voxel_size": ["x", 1, 1]}, {"voxel_size": [-1, 1, 1]}, {"origin": 5}, {"ome": 5}])
def test_attributes_are_checked(told, tmp_path):
    array = zarr.create_array(tmp_path / "a.zarr", shape=(4, 4, 4), dtype="u1")
    array.attrs.update(told)
    refused(tmp_path / "a.zarr")
