import math
import struct

import numpy as np
import pytest

from voxgran._base.errors import DirtyMeshError, FileFormatError, MissingFileError, OutputExistsError
from voxgran.shapes.family import make_shape
from voxgran.shapes.files import load_shape, save_shape
from voxgran.shapes.formats.mesh_files import READERS, WRITERS
from voxgran.shapes.model import Shape
from voxgran.shapes.repairing.repair import repair
from voxgran.shapes.tessellate import unit_box

pytestmark = pytest.mark.usefixtures("forked_readers")

VERTICES, FACES, _ = unit_box()
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
THIRD = 1 / 3  # no text with fewer than 16 digits gives it back


def test_an_image_says_what_makes_shapes_of_one(tmp_path):
    np.save(tmp_path / "cone.npy", np.zeros((2, 2, 2), dtype=bool))
    with pytest.raises(FileFormatError, match=r"'.npy': it is that of an image, of which load_labels makes shapes"):
        load_shape(tmp_path / "cone.npy")
    (tmp_path / "cone.step").write_text("")
    with pytest.raises(FileFormatError, match=r"'.step': known are .msh, .*; convert it"):
        load_shape(tmp_path / "cone.step")


def obj_text(faces, vertices=VERTICES):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices).tolist()]
    return "\n".join([*lines, *(("f " + " ".join(str(k + 1) for k in face)) for face in faces)]) + "\n"


def off_text(faces, vertices=VERTICES):
    rows = [" ".join(map(repr, row)) for row in np.asarray(vertices).tolist()]
    rows += [" ".join(map(str, [len(face), *face])) for face in faces]
    return "\n".join(["OFF", f"{len(vertices)} {len(faces)} 0", *rows]) + "\n"


def ply_header(order, count, faces, *, kind="double", extra=""):
    return (
        f"ply\nformat {order} 1.0\ncomment end_header is a word of a test\nelement vertex {count}\n"
        + "".join(f"property {kind} {axis}\n" for axis in "xyz")
        + f"{extra}element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )


def ply_text(faces, vertices=VERTICES):
    rows = [" ".join(map(repr, row)) for row in np.asarray(vertices).tolist()]
    rows += [" ".join(map(str, [len(face), *face])) for face in faces]
    return ply_header("ascii", len(vertices), len(faces)) + "\n".join(rows) + "\n"


def ply_longer(faces):
    """Return a PLY file with colors of faces in the header, in whose rows a list stands in place of these; and with
    numbers behind those of the vertices.
    """
    colors = "".join(f"property uchar {color}\n" for color in ("red", "green", "blue", "alpha"))
    text = ply_text(faces).replace("end_header\n", f"property list uchar float uv\n{colors}end_header\n", 2)
    head, body = text.split(colors + "end_header\n")
    rows = body.splitlines()
    rows = [f"{row} 7 7" for row in rows[: len(VERTICES)]] + [
        f"{row} {2 * len(row.split()) - 2}{' 0.5' * (2 * len(row.split()) - 2)} 9{' 1' * 9}"
        for row in rows[len(VERTICES) :]
    ]
    return head + colors + "end_header\n" + "\n".join(rows) + "\n"


def ply_binary(faces, vertices=VERTICES, *, mark="<"):
    order = "binary_little_endian" if mark == "<" else "binary_big_endian"
    body = np.asarray(vertices).astype(mark + "f8").tobytes()
    for face in faces:
        body += struct.pack(f"{mark}B{len(face)}i", len(face), *face)
    return ply_header(order, len(vertices), len(faces)).encode() + body


def ply_rich(faces, order="<"):
    """Return a PLY file with a list before the corners, of 64 bits, and a number behind them."""
    head = ply_header("binary_little_endian" if order == "<" else "binary_big_endian", len(VERTICES), len(faces))
    lists = "property list uchar float weights\nproperty list int int64 vertex_indices\nproperty uchar flag"
    body = VERTICES.astype(f"{order}f8").tobytes()
    for k, face in enumerate(faces):
        weights = [0.5] * (k % 3)
        row = len(weights), *weights, len(face), *face, 7
        body += struct.pack(f"{order}B{len(weights)}fi{len(face)}qB", *row)
    lines = [lists if line.startswith("property list") else line for line in head.splitlines()]
    return "\n".join([*lines, ""]).encode() + body


def stl_binary(faces, vertices=VERTICES, *, count=None):
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *np.asarray(vertices)[list(face)].ravel(), 0) for face in faces)
    return b"solid but binary".ljust(80) + struct.pack("<I", len(faces) if count is None else count) + body


def stl_text(faces, vertices=VERTICES):
    lines = ["solid box"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices)[list(face)].tolist()]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid box"]) + "\n"


MIXED = [*QUADS[:3], *FACES[6:].tolist()]
GOOD = {
    "triangles.obj": obj_text(FACES),
    "quads.obj": obj_text(QUADS),
    "mixed.obj": obj_text(MIXED),
    "full.obj": "mtllib x.mtl\n"
    + obj_text(QUADS).replace("v ", "vn 0 0 1\nvt 0 0\nv ").replace("f ", "usemtl a\nf ").replace("\n", " # why\n"),
    "colors.obj": "\n".join(
        line + " 0.5 0.5 0.5" if line.startswith("v") else line for line in obj_text(QUADS).splitlines()
    ),
    "slashes.obj": "\n".join(
        "f " + " ".join(f"{w}/1/{w}" for w in line.split()[1:]) if line.startswith("f") else line
        for line in obj_text(QUADS).splitlines()
    ),
    "normals.obj": "\n".join(
        "f " + " ".join(f"{w}//{w}" for w in line.split()[1:]) if line.startswith("f") else line
        for line in obj_text(QUADS).splitlines()
    ),
    "from_the_end.obj": "\n".join(
        "f " + " ".join(str(int(w) - 9) for w in line.split()[1:]) if line.startswith("f") else line
        for line in obj_text(QUADS).splitlines()
    ),
    "continued.obj": obj_text(QUADS).replace("f 1 ", "f 1 \\\n  "),
    "continued_mac.obj": obj_text(QUADS).replace("f 1 ", "f 1 \\\n  ").replace("\n", "\r"),
    "marked.ply": "\ufeff" + ply_text(QUADS),
    "windows.obj": obj_text(QUADS).replace("f 1 ", "f 1 \\\n  ").replace("\n", "\r\n"),
    "old_mac.obj": obj_text(QUADS).replace("\n", "\r"),
    "marked.obj": "\ufeff" + obj_text(QUADS).replace("v ", "  v\t"),
    "some_slashes.obj": obj_text(FACES).replace("f 1 ", "f 1/7 ").replace("f 2 ", "f 2//9 "),
    "mixed.off": off_text(MIXED),
    "edges.off": off_text(MIXED) + "edges of no interest\n",
    "windows.off": off_text(MIXED).replace("\n", "\r\n# why\r\n"),
    "one_line.off": off_text(QUADS).replace("OFF\n", "OFF ").replace("0\n", "0 # counts\n", 1),
    "mixed.ply": ply_text(MIXED),
    "little.ply": ply_binary(MIXED),
    "big.ply": ply_binary(MIXED, mark=">"),
    "rich.ply": ply_rich(MIXED),
    "rich_big.ply": ply_rich(MIXED, ">"),
    "triangles.ply": ply_binary(FACES),
    "triangles_text.ply": ply_text(FACES),
    "windows.ply": ply_text(QUADS).replace("\n", "\r\n"),
    "other_name.ply": ply_text(QUADS).replace("vertex_indices", "vertex_index"),
    "binary.stl": stl_binary(FACES),
    "text.stl": stl_text(FACES),
    "one_line.stl": stl_text(FACES).replace("\nvertex", " vertex").replace("\nend", " end"),
    "named.stl": stl_text(FACES).replace("solid box", "solid vertex of a vertex"),
    "words.stl": stl_text(FACES).replace("solid box", "solid endfacet endsolid"),
    "colors.off": off_text(MIXED).replace("\n3 ", " 0.5 1\n3 ").replace("\n4 ", " 0.5 1\n4 "),
    "joined.off": "\t " + off_text(QUADS).replace("OFF\n", "OFF").replace("0\n", "0 # or nah\n", 1),
    "longer_rows.ply": ply_longer(MIXED),
    "shouting.STL": stl_text(FACES).upper(),
}


@pytest.mark.parametrize("name", GOOD)
def test_good_files_are_read(name, tmp_path):
    content = GOOD[name]
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    shape = load_shape(path, unit="mm")
    assert shape.name == path.stem
    assert shape.unit == "mm"
    assert len(shape.faces) == 12
    assert len(shape.vertices) == 8
    assert shape.volume == pytest.approx(1.0, rel=1e-15)


L_SHAPE = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_concave_polygons_are_cut_along_their_ears(axis, tmp_path):
    floor = np.array([np.insert(np.array(p, dtype=float), axis, 0.0) for p in L_SHAPE])
    roof = floor + np.eye(3)[axis]
    ring = list(range(6))
    sides = [(k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6) for k in ring]
    faces = [ring[::-1], [k + 6 for k in ring], *sides]
    if axis == 1:
        faces = [face[::-1] for face in faces]
    # begin with the corner that a fan would get wrong
    faces[1] = [*faces[1][1:], faces[1][0]]
    path = tmp_path / "prism.obj"
    path.write_text(obj_text(faces, np.vstack([floor, roof])))
    assert load_shape(path).volume == pytest.approx(3.0, rel=1e-15)


@pytest.mark.parametrize("suffix", WRITERS)
def test_what_is_written_is_read_again(suffix, tmp_path):
    grain = make_shape("solid_union", seed=3, solids=3).scaled(THIRD)
    path = tmp_path / f"grain{suffix}"
    save_shape(grain, path)
    again = load_shape(path)
    assert list(tmp_path.iterdir()) == [path]
    if suffix == ".stl":
        assert again.volume == pytest.approx(grain.volume, rel=1e-6)
    else:
        assert (again.faces == grain.faces).all()
        back = again.vertices + np.array(again.offset)
        assert np.abs(back - grain.vertices).max() < 1e-16


def test_vertices_are_counted_from_those_before_the_face(tmp_path):
    (tmp_path / "two.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf -1/2 1/1 -4//3\nf 2 3 4\n")
    points, corners, counts = READERS[".obj"](tmp_path / "two.obj")
    assert (points.shape, corners.tolist(), counts.tolist()) == ((4, 3), [0, 1, 2, 3, 0, 0, 1, 2, 3], [3, 3, 3])


def test_coordinates_keep_their_last_digit(data_dir, tmp_path):
    lines = (data_dir / "eros.obj").read_text().splitlines()
    points = np.array([[float(w) for w in line.split()[1:]] for line in lines if line.startswith("v ")])
    eros = load_shape(data_dir / "eros.obj")
    assert (eros.geometry.vertices == points - np.array(eros.offset)).all()
    doubled = Shape.from_mesh(VERTICES * THIRD, FACES)
    for suffix in (".obj", ".off", ".ply", ".vtp"):
        save_shape(doubled, tmp_path / f"box{suffix}")
        assert np.abs(load_shape(tmp_path / f"box{suffix}").vertices).max() == THIRD / 2


@pytest.mark.parametrize(
    ("name", "volume"), [("eros.obj", 0.291331), ("itokawa_lp.obj", 0.411427), ("bennu_lp.obj", 1.407590)]
)
def test_scans_are_read(name, volume, data_dir):
    assert load_shape(data_dir / name).volume == pytest.approx(volume, abs=1e-6)


def test_vtk_and_gmsh_files_are_read(tmp_path):
    from voxgran._base.lazy import load

    pyvista, meshio = load("pyvista"), load("meshio")
    cube = pyvista.Cube()
    cube.save(tmp_path / "poly.vtk")
    cube.save(tmp_path / "poly.vtp")
    cube.cast_to_unstructured_grid().save(tmp_path / "grid.vtu")
    pyvista.ImageData(dimensions=(3, 3, 3), spacing=(0.5, 0.5, 0.5)).cast_to_unstructured_grid().save(
        tmp_path / "voxels.vtu"
    )
    cells = [("triangle", FACES[:6]), ("triangle", FACES[6:])]
    meshio.write_points_cells(tmp_path / "new.msh", VERTICES, [("triangle", FACES)], file_format="gmsh")
    meshio.write_points_cells(tmp_path / "old.msh", VERTICES, cells, file_format="gmsh22", binary=False)
    meshio.write_points_cells(tmp_path / "quads.msh", VERTICES, [("quad", np.array(QUADS))], file_format="gmsh")
    for path in sorted(tmp_path.iterdir()):
        assert load_shape(path).volume == pytest.approx(1.0, rel=1e-6), path.name


def cut(content, share):
    raw = content if isinstance(content, bytes) else content.encode()
    return raw[: int(len(raw) * share)]


NAN = np.where(VERTICES[0] == VERTICES, np.nan, VERTICES)
BAD = {
    "unknown.xyz": (b"1 2 3", "suffix"),
    "no_suffix": (b"1 2 3", "suffix"),
    "nothing.stl": (b"", "is empty"),
    "nothing.obj": (b"", "is empty"),
    "no_faces.stl": (stl_binary([]), "no faces"),
    "no_faces.obj": (obj_text([]), "no faces"),
    "no_faces.off": (off_text([]), "no faces"),
    "no_faces.ply": (ply_text([]), "no faces"),
    "no_faces_text.stl": (b"solid nothing\nendsolid nothing\n", "no faces"),
    "short.stl": (stl_binary(FACES, count=20), "12 of the 20 triangles"),
    "header.stl": (stl_binary(FACES)[:50], "cut"),
    "cut_text.stl": (cut(stl_text(FACES), 0.6), "cut"),
    "word.stl": (stl_text(FACES).replace("0.5", "half", 1), "no STL file"),
    "beyond.obj": (obj_text([*FACES[1:], (0, 1, 99)]), "vertex 99 of 8"),
    "before.obj": (obj_text(FACES) + "f -20 1 2\n", "line 21"),
    "zero.obj": (obj_text(FACES) + "f 0 1 2\n", "line 21"),
    "cut.obj": (obj_text(FACES)[: obj_text(FACES).index("f") - 8], "line 8"),
    "two_corners.obj": (obj_text([*FACES, (0, 1)]), "2 corners"),
    "word.obj": (obj_text(FACES).replace("0.5", "half", 1), "half"),
    "binary.obj": (bytes(range(256)) * 4, "has a byte 0"),
    "two_bytes.obj": (obj_text(FACES).encode("utf-16"), "texts are in UTF-8"),
    "ratio.obj": (obj_text(FACES).replace("0.5", "1/2", 1), "no number"),
    "cut.off": (cut(off_text(FACES), 0.7), "cut"),
    "counts.off": (b"OFF\n8 twelve 0\n", "OFF"),
    "other.off": (b"NOT A MESH\n", "OFF"),
    "only_name.off": (b"OFF\n", "lacks the numbers of vertices and faces"),
    "beyond.off": (off_text([*FACES[1:], (0, 1, 99)]), "vertex 99 of 8"),
    "rows.off": (off_text(FACES).replace(" 0.5\n", "\n", 1), "7 of 8 vertices and 12 of 12"),
    "fraction.off": (off_text([*FACES[1:], (0, 1, 2.5)]), "2.5"),
    "count.off": (off_text(FACES).replace("\n3 ", "\nnan ", 1), "nan"),
    "cut_list.ply": (cut(ply_rich(MIXED), 0.95), "cut"),
    "length.ply": (ply_text([*MIXED, (0, 1, 2)]).replace("3 0 1 2", "2.5 0 1 2"), "2.5"),
    "cut_text.ply": (cut(ply_text(FACES), 0.7), "cut"),
    "cut_points.ply": (cut(ply_binary(FACES), 0.5), "cut"),
    "cut_faces.ply": (cut(ply_binary(FACES), 0.9), "cut"),
    "header.ply": (cut(ply_binary(FACES), 0.1), "cut"),
    "type.ply": (ply_text(FACES).replace("double", "quadruple"), "quadruple"),
    "no_z.ply": (ply_text(FACES).replace("double z", "double w"), "'z'"),
    "huge.ply": (ply_binary(FACES).replace(b"vertex 8", b"vertex 99999999999999"), "cut"),
    "nan.obj": (obj_text(FACES, NAN), "not finite"),
    "nan.ply": (ply_text(FACES, NAN), "not finite"),
    "nan.stl": (stl_binary(FACES, NAN), "not finite"),
    "nan_text.stl": (stl_text(FACES, NAN), "not finite"),
    "words.vtp": (b"this is no XML", "VTK"),
    "words.vtk": (b"this is no VTK file", "VTK"),
    "words.msh": (b"this is no Gmsh file", "as a .msh file"),
    "cut.msh": (b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 8 1 8\n2 1 0 8\n1\n2\n", "as a .msh file"),
    "version.msh": (b"$MeshFormat\n9.9 0 8\n$EndMeshFormat\n", "as a .msh file"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_in_one_sentence(name, tmp_path, capfd):
    content, text = BAD[name]
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(FileFormatError) as caught:
        load_shape(path)
    message = str(caught.value)
    assert text in message
    assert message.startswith(str(path))
    assert "\n" not in message
    assert ": " in message
    assert capfd.readouterr() == ("", "")


def test_cut_vtk_files_are_refused(tmp_path, capfd):
    grain = make_shape("convex_polyhedron")
    whole, broken = tmp_path / "whole.vtp", tmp_path / "broken.vtp"
    save_shape(grain, whole)
    broken.write_bytes(cut(whole.read_bytes(), 0.5))
    with pytest.raises(FileFormatError):
        load_shape(broken)
    assert capfd.readouterr() == ("", "")


def test_missing_files_are_named(tmp_path):
    with pytest.raises(MissingFileError, match="is not there"):
        load_shape(tmp_path / "grain.stl")
    with pytest.raises(MissingFileError, match="is a folder"):
        load_shape(tmp_path)


def test_open_surfaces_are_refused(tmp_path):
    path = tmp_path / "open.obj"
    path.write_text(obj_text(FACES[1:]))
    said = "give repair=True or use vg.repair, or give surface=True where it is to stay open"
    with pytest.raises(DirtyMeshError, match=rf"^open\.obj has 3 open edges: a grain .*; {said}$"):
        load_shape(path)
    # each remedy that a message names is one that its caller has
    assert load_shape(path, surface=True).is_open
    with pytest.raises(DirtyMeshError, match=r"; use vg\.repair with a larger max_hole, or give surface=True where"):
        load_shape(path, repair=True)
    assert not repair(path, max_hole=1.0).shape.is_open


def test_several_bodies_are_refused_with_what_chooses_among_them(tmp_path):
    path, box = tmp_path / "two.obj", make_shape("box")
    vertices, faces = np.concatenate([box.vertices, box.vertices + 3]), np.concatenate([box.faces, box.faces + 8])
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines))
    for options in ({}, {"repair": True}):
        with pytest.raises(DirtyMeshError, match=r"; use vg\.repair with bodies='largest' or bodies='all'$"):
            load_shape(path, **options)
    assert len(repair(path, bodies="all").shapes) == 2
    assert len(repair(path, bodies="largest").shapes) == 1


def test_nothing_is_replaced_unasked(tmp_path):
    path = tmp_path / "grain.off"
    save_shape(make_shape("box"), path)
    before = path.read_bytes()
    with pytest.raises(OutputExistsError):
        save_shape(make_shape("cone"), path)
    assert path.read_bytes() == before
    with pytest.raises(FileFormatError, match="suffix"):
        save_shape(make_shape("cone"), tmp_path / "grain.step")


def test_all_that_is_written_can_be_read():
    assert set(WRITERS) <= set(READERS)


def test_quads_of_a_knot_are_closed(tmp_path):
    # a tube along a circle, its quadrangles not flat, each corner written once per face
    n, m = 24, 8
    u, v = np.meshgrid(np.arange(n) * math.tau / n, np.arange(m) * math.tau / m, indexing="ij")
    r = 1 + 0.3 * np.cos(v)
    points = np.stack([r * np.cos(u), r * np.sin(u), 0.3 * np.sin(v)], axis=-1)
    rings = [
        [points[i, j], points[(i + 1) % n, j], points[(i + 1) % n, (j + 1) % m], points[i, (j + 1) % m]]
        for i in range(n)
        for j in range(m)
    ]
    faces = np.arange(4 * n * m).reshape(-1, 4)
    path = tmp_path / "knot.obj"
    path.write_text(obj_text(faces, np.array(rings).reshape(-1, 3)))
    knot = load_shape(path)
    assert (len(knot.vertices), len(knot.faces)) == (n * m, 2 * n * m)
    assert knot.volume == pytest.approx(2 * math.pi**2 * 0.09, rel=0.15)
