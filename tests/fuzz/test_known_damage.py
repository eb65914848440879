"""Damage that once crashed the process, hung, printed or raised a bare error, one file each."""

import hashlib
import logging
import struct

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.checkpoint import load_checkpoint
from voxgran._base.errors import CheckpointError, FileFormatError, VoxgranError
from voxgran._base.lazy import load
from voxgran.shapes.formats import mesh_files
from voxgran.shapes.repairing import diagnose
from voxgran.shapes.repairing.repair import _angles
from voxgran.shapes.tessellate import unit_box

VERTICES, FACES, _ = unit_box()
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in VERTICES.tolist())
OBJ += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES.tolist())
PLY = "ply\nformat {} 1.0\nelement vertex 8\nproperty double x\nproperty double y\nproperty double z\n{}end_header\n"
ROWS = "".join(f"{x} {y} {z}\n" for x, y, z in VERTICES.tolist())
MSH = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n{0} {1} 1 8\n2 1 0 {1}\n$EndNodes\n$Elements\n1 {1} 1 8\n"
OLD_MSH = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n1 0 0 0\n$EndNodes\n$Elements\n{}\n1 2 2 0 1 1 1 1\n"
DUMP = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS pp pp ff\n0 2\n0 2\n0 2\n"
DUMP += "ITEM: ATOMS id x y z radius\n1 1 1 1 0.5\n"
VTK = "# vtk DataFile Version 5.1\nmade by a test\nASCII\nDATASET POLYDATA\nPOINTS 3 double\n0 0 0 1 0 0 0 1 0\n"
FIRST = "1.0 1.0 1.0 0.5\n"


def refusal(read, path, content, capfd):
    """Return the sentence with which a file is refused."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(FileFormatError) as caught:
        read(path)
    assert capfd.readouterr() == ("", "")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500
    assert str(path) in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("suffix", [".vtp", slow(".vtu"), ".vti"])
def test_xml_that_is_nested_too_deep(suffix, tmp_path, capfd):
    kind = {".vtp": "PolyData", ".vtu": "UnstructuredGrid", ".vti": "ImageData"}[suffix]
    text = f'<VTKFile type="{kind}">{"<a>" * 200_000}{"</a>" * 200_000}</VTKFile>'
    read = vg.load_image if suffix == ".vti" else vg.load_shape
    refusal(read, tmp_path / f"deep{suffix}", text, capfd)
    if suffix != ".vti":
        refusal(vg.load, tmp_path / f"points{suffix}", text, capfd)


@pytest.mark.parametrize("faces", ["POLYGONS 2 3\nOFFSETS vtktypeint64\n0 9999999\nCONNECTIVITY vtktypeint64\n0 1 2\n",
                                   "POLYGONS 2 3\nOFFSETS vtktypeint64\n0 3\nCONNECTIVITY vtktypeint64\n0 1 99999999\n",
                                   "POLYGONS 1 4\n3 0 1 -7777777\n"])  # fmt: skip
def test_corners_that_vtk_does_not_check(faces, tmp_path, capfd):
    refusal(vg.load_shape, tmp_path / "far.vtk", VTK + faces, capfd)


def test_a_vtk_image_of_more_voxels_than_memory(tmp_path, capfd):
    extent = "0 99999 0 99999 0 99999"
    text = f'<VTKFile type="ImageData" version="1.0"><ImageData WholeExtent="{extent}" Origin="0 0 0" Spacing="1 1 1">'
    text += f'<Piece Extent="{extent}"><CellData><DataArray type="Float64" Name="a" format="ascii">1 2 3</DataArray>'
    refusal(vg.load_image, tmp_path / "large.vti", text + "</CellData></Piece></ImageData></VTKFile>", capfd)


def test_a_damaged_vtk_image_prints_nothing(tmp_path, capfd):
    grid = load("pyvista").ImageData(dimensions=(4, 4, 4))
    grid.cell_data["labels"] = np.arange(27)
    grid.save(tmp_path / "image.vti")
    whole = (tmp_path / "image.vti").read_bytes()
    capfd.readouterr()
    refusal(vg.load_image, tmp_path / "image.vti", whole.replace(b"<CellData", b"<<ellData"), capfd)


def test_a_damaged_tiff_prints_nothing(tmp_path, capfd):
    pages = np.arange(60, dtype=np.uint16).reshape(3, 4, 5)
    pytest.importorskip("tifffile").imwrite(tmp_path / "good.tif", pages, photometric="minisblack")
    whole = bytearray((tmp_path / "good.tif").read_bytes())
    start = struct.unpack("<I", whole[4:8])[0]
    # a tag that tells where the samples lie has a type that there is none
    whole[start + 4 : start + 6] = b"\xff\xff"
    (tmp_path / "bad.tif").write_bytes(whole)
    logging.getLogger("tifffile").addHandler(handler := logging.StreamHandler())
    try:
        with pytest.raises(vg.VoxgranError):
            vg.load_labels(tmp_path / "bad.tif", voxel_size=1.0)
    finally:
        logging.getLogger("tifffile").removeHandler(handler)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("count", [slow(10**9), 10**15])
def test_gmsh_files_that_count_more_than_they_hold(count, tmp_path, capfd):
    refusal(vg.load_shape, tmp_path / "new.msh", MSH.format(1, count), capfd)
    refusal(vg.load_shape, tmp_path / "blocks.msh", MSH.format(count, 8), capfd)
    refusal(vg.load_shape, tmp_path / "old.msh", OLD_MSH.format(count, 1), capfd)
    refusal(vg.load_shape, tmp_path / "old.msh", OLD_MSH.format(1, count), capfd)


def test_a_face_of_very_many_corners(tmp_path, capfd):
    corners = np.random.default_rng(0).integers(1, 9, 60_000)
    assert "has a face of 60000 corners that is not convex: at most 5000" in refusal(
        vg.load_shape, tmp_path / "many.obj", OBJ + "f " + " ".join(map(str, corners)) + "\n", capfd
    )


def test_a_round_face_of_many_corners_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_files, "MOST_CORNERS", 500)
    angle = np.linspace(0, 2 * np.pi, 601)[:-1]
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    lines = [f"v {x!r} {y!r} {z}" for z in (0, 1) for x, y in ring.tolist()]
    lines += ["f " + " ".join(map(str, range(600, 0, -1))), "f " + " ".join(map(str, range(601, 1201)))]
    lines += [f"f {k + 1} {(k + 1) % 600 + 1} {601 + (k + 1) % 600} {601 + k}" for k in range(600)]
    (tmp_path / "can.obj").write_text("\n".join(lines))
    assert vg.load_shape(tmp_path / "can.obj").volume == pytest.approx(np.pi, rel=1e-4)


@pytest.mark.parametrize("index", ["99999999999999999999", "-99999999999999999999", "9" * 4000, "9" * 5000])
def test_indices_of_many_digits(index, tmp_path, capfd):
    refusal(vg.load_shape, tmp_path / "far.obj", f"{OBJ}f 1 2 {index}\n", capfd)
    refusal(vg.load_shape, tmp_path / "far.off", f"OFF\n8 1 0\n{ROWS}3 0 1 {index}\n", capfd)
    face = "element face 1\nproperty list int int vertex_indices\n"
    refusal(vg.load_shape, tmp_path / "far.ply", f"{PLY.format('ascii', face)}{ROWS}3 0 1 {index}\n", capfd)


@pytest.mark.parametrize("length", [float("inf"), float("nan"), -1.0, 1e300])
def test_lists_of_a_length_that_is_none(length, tmp_path, capfd):
    face = "element face 2\nproperty list double int vertex_indices\n"
    body = VERTICES.astype("<f8").tobytes() + struct.pack("<d3i", length, 0, 1, 2) * 2
    head = PLY.format("binary_little_endian", face).encode()
    assert "cannot be read as PLY" in refusal(vg.load_shape, tmp_path / "list.ply", head + body, capfd)
    body = f"{PLY.format('ascii', face)}{ROWS}{length} 0 1 2\n3 0 1 2\n"
    assert "cannot be read as PLY" in refusal(vg.load_shape, tmp_path / "list.ply", body, capfd)


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("read", [vg.load_shape, vg.load_cloud])
def test_records_that_take_no_space(order, read, tmp_path, capfd):
    body = ROWS.encode() if order == "ascii" else VERTICES.astype("<f8").tobytes()
    for extra, words in (
        ("element nothing 99999999999\n", "counts 99999999999 nothing of 0 properties"),
        ("element face 99999999999\nproperty list uchar int vertex_indices\n", "it ends within face records"),
        ("element face -1\nproperty list uchar int vertex_indices\n", "counts -1 face"),
    ):
        message = refusal(read, tmp_path / "many.ply", PLY.format(order, extra).encode() + body, capfd)
        assert words in message


def test_signalling_nan_warns_of_nothing(tmp_path, capfd):
    corner = struct.pack("<9fI2f", *[0.0] * 9, 0x7F800001, 0.0, 0.0)
    stl = bytes(80) + struct.pack("<I", 1) + corner + bytes(2)
    assert "not finite" in refusal(vg.load_shape, tmp_path / "nan.stl", stl, capfd)
    head = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nPOINTS 1\nDATA binary\n"
    refusal(vg.load_cloud, tmp_path / "nan.pcd", head + struct.pack("<I2f", 0x7F800001, 0.0, 0.0), capfd)


def test_faces_of_one_corner(tmp_path, capfd):
    text = PLY.format("ascii", "element face 1\nproperty int vertex_indices\n") + f"{ROWS}0\n"
    assert "gives one corner for each face" in refusal(vg.load_shape, tmp_path / "one.ply", text, capfd)


@pytest.mark.parametrize("old", ["", "f 1 2 8\n" * 100])
def test_where_edges_are_wrong_no_crossings_are_counted(old, tmp_path, monkeypatch):
    """Faces that lie on each other, as in damaged files, take time with the square of their number."""
    monkeypatch.setattr(diagnose, "count_crossings", lambda *_: pytest.fail("they were counted"))
    text = OBJ + old if old else OBJ.replace(OBJ.splitlines(keepends=True)[-1], "")
    (tmp_path / "open.obj").write_text(text)
    with pytest.raises(vg.VoxgranError, match=r"edges without exactly two faces|open edges"):
        vg.load_shape(tmp_path / "open.obj")


def test_off_files_that_count_below_zero(tmp_path, capfd):
    assert "it counts -1 of something" in refusal(vg.load_shape, tmp_path / "f.off", f"OFF\n-1 1 0\n{ROWS}", capfd)


@pytest.mark.parametrize("value", ["1e160", "-1e300"])
def test_coordinates_of_which_no_volume_can_be_made(value, tmp_path, capfd):
    shown = f"{float(value):g}"
    assert f"coordinate is {shown} at index (0, 0)" in refusal(
        vg.load_shape, tmp_path / "far.obj", OBJ.replace("v -0.5", f"v {value}", 1), capfd
    )
    assert f"line 2: x y z r is 1 {shown} 1 0.5; all must be finite and at most 1e+60 in magnitude" in refusal(
        vg.load, tmp_path / "far.txt", f"{FIRST}1 {value} 1 0.5\n", capfd
    )
    assert f"points is {shown} at index (1, 2)" in refusal(
        vg.load_cloud, tmp_path / "far.xyz", f"0 0 0\n0 0 {value}\n1 0 0\n", capfd
    )
    assert f"atom 0: x y z r is {shown} 1 1 0.5" in refusal(
        vg.load, tmp_path / "far.dump", DUMP.replace("1 1 1 1 0.5", f"1 {value} 1 1 0.5"), capfd
    )
    assert f"has a box of [{abs(float(value))}, 2.0, 2.0]: " in refusal(
        vg.load, tmp_path / "far.dump", DUMP.replace("\n0 2\n", f"\n0 {value.strip('-')}\n", 1), capfd
    )


def test_radii_of_which_no_volume_can_be_made(tmp_path, capfd):
    assert "line 1: x y z r is 1 1 1 1e-200" in refusal(vg.load, tmp_path / "small.txt", "1 1 1 1e-200\n", capfd)


def test_coordinates_in_arrays_follow_the_same_rule():
    with pytest.raises(vg.VoxgranError, match=r"vertices is -1e\+160 at index \(0, 0\)"):
        vg.Shape.from_mesh(VERTICES * 2e160, FACES)
    with pytest.raises(vg.VoxgranError, match=r"points is 1e\+300"):
        vg.Cloud.of([[0, 0, 1e300]])
    with pytest.raises(vg.VoxgranError, match=r"grain is 1e\+18: numbers of grains are whole and at most 2\^53"):
        vg.Cloud.of([[0, 0, 1]], grain=[1e18])
    assert vg.Shape.from_mesh(VERTICES * 1e40, FACES).volume == pytest.approx(1e120)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("ITEM: ATOMS id", "ITEM:\nITEM: ATOMS id", "'ITEM:' is not 5 numbers|line 6"),
        ("ITEM: BOX BOUNDS", "ITEM:", "the frame is cut off"),
        ("1 1 1 1 0.5\n", "1 1 1 1 0.5 7\n", "line 10: '1 1 1 1 0.5 7' is not 5 numbers"),
        ("1 1 1 1 0.5\n", "1 1 1\n", "line 10: '1 1 1' is not 5 numbers"),
        ("0 2\n0 2\n0 2\n", "0 2\n0 2\n0\n", "line 8: '0' is not 2 numbers"),
        ("0 2\n0 2\n0 2\n", "0 2\n0 2 0\n0 2\n", "line 7: '0 2 0' is not 2 numbers"),
        ("ITEM: BOX BOUNDS pp pp ff\n0 2\n0 2\n0 2\n", "", "the frame is cut off"),
        ("\n1 1 1 1 0.5\n", "\n1 1 1 1 0.5\nITEM: BOX BOUNDS pp pp ff\n0 2\n0 2\n", "the frame is cut off"),
        ("ATOMS\n1\n", "ATOMS\nnan\n", "which says nan"),
        ("ATOMS\n1\n", "ATOMS\n\n", "line 4: '' is not 1 numbers"),
        ("ATOMS\n1\n", "ATOMS\n1 1\n", "line 4: '1 1' is not 1 numbers"),
    ],
)
def test_dumps_of_ragged_rows(old, new, words, tmp_path, capfd):
    assert old in DUMP
    if words.startswith("'ITEM:'"):
        (tmp_path / "p.dump").write_text(DUMP.replace(old, new))
        assert vg.load(tmp_path / "p.dump").count == 1
        return
    assert words in refusal(vg.load, tmp_path / "p.dump", DUMP.replace(old, new), capfd)


@pytest.mark.parametrize(
    "text",
    ["[" * 10**6, '{"a":' * 10**5, '{"kind": ' + "[" * 10**5 + "]" * 10**5 + "}", '{"' + "k" * 10**6 + '": 1}',
     '{"kind": "' + "b" * 10**6 + '"}', '{"kind": "box", "lengths": [' + "1, " * 10**5 + "1]}",
     '{"kind": "box", "lengths": [1' + "0" * 400 + ", 1, 1]}", '{"kind": "box", "lengths": [1e200, 1, 1]}', "1" * 10**6,
     '{"kind": "mesh", "vertices": [[0, 0, 1]], "faces": [[0, 0, 99999999999999999999]]}',
     '{"kind": "mesh", "file": "none.obj"}', '{"kind": "sphere", "radius": 1e999}'],
)  # fmt: skip
def test_containers_in_comments_that_are_bombs(text, tmp_path, capfd):
    message = refusal(vg.load, tmp_path / "p.txt", f"# container {text}\n{FIRST}", capfd)
    assert "line 1: the container cannot be read" in message


def test_a_name_of_a_column_that_is_all_brackets(tmp_path, capfd):
    assert "there is no x, y:" in refusal(vg.load, tmp_path / "p.csv", "[" * 50_000 + ",a,b,c\n1,2,3,4\n", capfd)


def test_numbers_of_clumps_that_are_none(tmp_path, capfd):
    head = "#format x_y_z_r_clumpId\n" + FIRST.replace("\n", " 0\n")
    assert "and clumps whole numbers" in refusal(vg.load, tmp_path / "p.txt", f"{head}2 2 2 1 1e300\n", capfd)
    assert "and clumps whole numbers" in refusal(vg.load, tmp_path / "p.txt", f"{head}2 2 2 1 0.5\n", capfd)


def test_a_table_of_one_long_row_and_many_short_ones(tmp_path, capfd):
    text = "1 " * 100_000 + "\n" + "1\n" * 100_000
    assert "and 100000 numbers are needed" in refusal(vg.load_cloud, tmp_path / "wide.xyz", text, capfd)


def test_point_clouds_that_count_below_zero_or_name_half_a_normal(tmp_path, capfd):
    head = "FIELDS x y z normal_x\nSIZE 8 8 8 8\nTYPE F F F F\nCOUNT 1 1 1 1\nPOINTS {}\nDATA ascii\n0 0 0 1\n"
    assert "'-1' is no whole number" in refusal(vg.load_cloud, tmp_path / "p.pcd", head.format(-1), capfd)
    wide = head.replace("COUNT 1 1 1 1", "COUNT 1 1 1 99999999").format(1)
    assert "its points have 4 numbers" in refusal(vg.load_cloud, tmp_path / "p.pcd", wide, capfd)
    (tmp_path / "p.pcd").write_text(head.format(1))
    assert vg.load_cloud(tmp_path / "p.pcd").normals is None


def test_arrays_of_numpy_that_are_none(tmp_path, capfd):
    for suffix in (".npy", ".npz"):
        message = refusal(vg.load_image, tmp_path / f"image{suffix}", "no array", capfd)
        assert f"a {suffix} file of NumPy is needed" in message
        assert "pickle" not in message


def test_a_checkpoint_that_is_no_archive_has_a_sentence_of_its_own(tmp_path):
    for body in (b"", b"no archive", b"PK\x03\x04", b"\x93NUMPY\x01\x00"):
        path = tmp_path / "c.checkpoint"
        path.write_bytes(
            b"voxgran checkpoint 1 %s %d\n" % (hashlib.sha256(body).hexdigest().encode(), len(body)) + body
        )
        with pytest.raises(CheckpointError, match=r"holds no archive of arrays with a header: .*start anew") as caught:
            load_checkpoint(path)
        assert "pickle" not in str(caught.value)


def test_scenes_of_too_many_brackets_or_digits(tmp_path, capfd):
    for text in ("a = " + "[" * 10**5, "a = " + "9" * 10**5):
        assert "is not TOML" in refusal(vg.Scene.from_toml, tmp_path / "s.toml", text, capfd)


def test_a_mesh_whose_faces_have_no_area_cannot_be_mended(tmp_path):
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nf 1 1 2\nf 2 2 2\n")
    for repair in (False, True):
        with pytest.raises(vg.VoxgranError, match=r"no faces|no volume"):
            vg.load_shape(tmp_path / "flat.obj", repair=repair)


def test_a_gravity_whose_square_is_no_number(tmp_path):
    packing = vg.Packing.of([vg.make_shape("sphere")], vg.Box((3, 3, 3)), position=[(1, 1, 1)], gravity="-z")
    vg.save(packing, tmp_path / "good.xyzr")
    text = (tmp_path / "good.xyzr").read_text()
    assert "-1.0" in text
    (tmp_path / "far.xyzr").write_text(text.replace("-1.0", "-1e300"))
    with pytest.raises(VoxgranError, match="gravity is"):
        vg.load(tmp_path / "far.xyzr")


def test_a_comment_without_words_below_the_container(tmp_path):
    packing = vg.Packing.of([vg.make_shape("sphere")], vg.Box((3, 3, 3)), position=[(1, 1, 1)])
    vg.save(packing, tmp_path / "good.xyzr")
    first, rest = (tmp_path / "good.xyzr").read_text().split("\n", 1)
    lines = [first, *rest.split("\n")]
    at = next(k for k, line in enumerate(lines) if "container" in line)
    lines.insert(at + 1, "#")
    (tmp_path / "bare.xyzr").write_text("\n".join(lines))
    assert vg.load(tmp_path / "bare.xyzr").container == packing.container


def test_a_cell_of_a_study_with_a_key_of_many_characters(tmp_path):
    shape = [{"family": "sphere", "file": "a.stl", "x" * 50_000: 1}]
    base = {"shape": shape, "container": {"kind": "box", "lengths": [4, 4, 4]}, "packing": {"method": "rsa"}}
    with pytest.raises(VoxgranError) as caught:
        vg.Study(base=base, axes={"packing.count": [3, 5]}).cells()
    assert len(str(caught.value)) < 1000


def test_crowded_edges_of_no_length_have_an_angle():
    assert np.isfinite(_angles(np.zeros((1, 3)), np.ones((1, 3)))).all()
