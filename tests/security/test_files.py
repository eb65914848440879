"""The promises of SECURITY.md about files of strangers that no other test holds."""

import argparse
import ast
import contextlib
import dataclasses
import hashlib
import html
import io
import json
import os
import pickle
import re
import signal
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import numpy as np
import pytest
from kit import Forked, slow

import voxgran as vg
from voxgran._base.checkpoint import load_checkpoint
from voxgran._base.errors import CheckpointError, FileFormatError, InputError, TooLargeError, VoxgranError
from voxgran.cli import main
from voxgran.cli.terminal import show, table
from voxgran.io.series import listed_times
from voxgran.shapes.images import image_files
from voxgran.study.runs import Record, from_text, to_text

pytestmark = pytest.mark.usefixtures("jagged_pictures", "forked_readers")

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "voxgran"
#: what a hostile file would do
TOUCH = "import pathlib; pathlib.Path({!r}).touch()"


def test_templates_take_only_figures_as_markup():
    templates = list(PACKAGE.rglob("*.j2"))
    assert templates
    for path in templates:
        text = path.read_text()
        assert "autoescape" not in text
        # matplotlib escapes what it writes (tests/unit/report/test_plots.py)
        assert set(re.findall(r"\{\{[^}]*\|\s*safe\b[^}]*\}\}", text)) <= {"{{ figure.svg | safe }}"}, path.name


class Hostile:
    """An object whose pickle makes a file when it is read."""

    def __init__(self, mark):
        self.mark = str(mark)

    def __reduce__(self):
        return exec, (TOUCH.format(self.mark),)


READERS = [
    lambda path: vg.load_labels(path, voxel_size=1.0),
    vg.load_image,
    vg.load_shape,
    vg.load,
    lambda path: vg.load_cloud(path),
]


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".vtp", ".nc", ".stl", ".csv", ".xyz", ".pkl", ".toml"])
def test_pickled_objects_are_refused(suffix, tmp_path):
    mark, path = tmp_path / "touched", tmp_path / f"hostile{suffix}"
    held = np.array([Hostile(mark)], dtype=object)
    if suffix == ".npy":
        np.save(path, held, allow_pickle=True)
    elif suffix == ".npz":
        np.savez(path, held, allow_pickle=True)
    else:
        path.write_bytes(pickle.dumps(Hostile(mark)))
    for read in READERS:
        with pytest.raises(VoxgranError):
            read(path)
    with pytest.raises(VoxgranError):
        vg.Scene.from_toml(path)
    assert not mark.exists()
    # the file is as hostile as it should be
    if suffix == ".npy":
        np.load(path, allow_pickle=True)
        assert mark.exists()


def test_archives_that_grow_without_bound_are_refused(tmp_path):
    path, body = tmp_path / "bomb.npz", io.BytesIO()
    np.save(body, np.zeros((100, 100, 100), dtype=np.int64))
    with zipfile.ZipFile(path, "w", compression=zipfile.ZIP_BZIP2) as archive:
        archive.writestr("labels.npy", body.getvalue())
    assert path.stat().st_size < body.tell() / 10_000
    with pytest.raises(VoxgranError, match=r"compressed by method 12: .*DEFLATE \(8\); save it again"):
        vg.load_image(path)


def test_arrays_that_state_more_than_they_hold_are_refused(tmp_path):
    path, body = tmp_path / "lie.npz", io.BytesIO()
    np.lib.format.write_array_header_1_0(body, {"descr": "<i8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(path, "w", compression=zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("labels.npy", body.getvalue())
    with pytest.raises(VoxgranError):
        vg.load_image(path)


@pytest.mark.parametrize("size", [2**30, 2**40])
def test_arrays_larger_than_the_memory_are_refused_before_they_are_read(size, tmp_path, monkeypatch):
    path, body = tmp_path / "bomb.npz", io.BytesIO()
    np.save(body, np.zeros(2**21, dtype=np.uint8))
    with zipfile.ZipFile(path, "w", compression=zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("labels.npy", body.getvalue())
    assert path.stat().st_size < body.tell() / 500
    monkeypatch.setattr(image_files, "memory_limit", lambda: 2**20)
    with pytest.raises(TooLargeError, match=r"holds 'labels' of 2097280 bytes: more than the memory"):
        vg.load_image(path)


def test_checkpoints_that_grow_are_refused(tmp_path):
    body = io.BytesIO()
    np.savez_compressed(body, header=np.zeros(2**22, dtype=np.uint8))
    seal = hashlib.sha256(body.getvalue()).hexdigest().encode()
    (tmp_path / "c").write_bytes(b"voxgran checkpoint 1 %s %d\n" % (seal, body.tell()) + body.getvalue())
    with pytest.raises(CheckpointError, match="another program wrote it; start anew"):
        load_checkpoint(tmp_path / "c")


def test_a_seal_is_no_proof_of_who_has_written_a_file(tmp_path):
    texts = '<Array type="String" Name="method" NumberOfTuples="1" format="ascii">{}</Array>'.format("0 " * 10**6)
    body = f'<VTKFile type="PolyData"><PolyData><FieldData>{texts}</FieldData></PolyData></VTKFile>\n'.encode()
    path = tmp_path / "a.vtp"
    path.write_bytes(body + b"<!-- voxgran seal %s -->\n" % hashlib.sha256(body).hexdigest().encode())

    def read():
        with pytest.raises(FileFormatError, match=r"cannot be read|no packing of voxgran"):
            vg.load(path)
        os._exit(0)

    assert Forked(read).wait() == 0
    bed = pair()
    with pytest.raises(InputError, match=r"method is 'a\\x00b': files of VTK hold no NUL; leave it out"):
        vg.save(dataclasses.replace(bed, provenance={"method": "a\0b"}), tmp_path / "b.vtp")
    vg.save(bed, tmp_path / "b.vtp")
    assert vg.load(tmp_path / "b.vtp") == bed


@contextlib.contextmanager
def limited(seconds):
    """Raise an error after so many seconds of computing (context manager): what has no end takes more."""

    def late(*_):
        raise AssertionError("a small file is read without end")

    before = signal.signal(signal.SIGVTALRM, late)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


@pytest.mark.parametrize("head", [b"# " * 40, b"#" * 60, b"a" * 200_000, b" # a\n" * 10_000])
def test_the_beginning_of_a_file_is_looked_at_once(head, tmp_path):
    (tmp_path / "a.off").write_bytes(head + b"\n1\n")
    with limited(10), pytest.raises(FileFormatError, match="does not begin with OFF"):
        vg.load_shape(tmp_path / "a.off")


def test_a_table_of_empty_entries_is_refused(tmp_path):
    names = ",".join(["size", "passing", *(f"c{k}" for k in range(1500))])
    (tmp_path / "a.csv").write_text(names + "\n" + "1,50\n" * 2000)
    with pytest.raises(FileFormatError, match="2000 rows and 1502 columns, and fewer entries than that"):
        vg.sizes.sieve(str(tmp_path / "a.csv"))


CONTROL = "\x1bc\x07\x9bm"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", f"x y z {CONTROL}\n1 2 3 4\n"),
        ("a.xyz", f"1\nProperties={CONTROL}:R:3\n1 2 3 4\n"),
        (f"{CONTROL}.csv", ""),
    ],
)
def test_names_are_no_commands_of_a_terminal(name, text, tmp_path, capsys):
    (tmp_path / name).write_text(text)
    assert main(["verify", str(tmp_path / name)]) == 2
    told = capsys.readouterr().err
    assert "\\x1bc\\x07\\x9bm" in told
    assert told.removesuffix("\n").isprintable()


def test_numbers_of_a_terminal_are_text(capsys):
    show({"a": CONTROL, "b": {"c": [CONTROL]}}, argparse.Namespace(json=False))
    table([{"a": CONTROL, "b": 1.0}])
    assert all(line.isprintable() for line in capsys.readouterr().out.splitlines())


def test_programs_of_python_do_not_look_into_the_present_folder():
    for path in PACKAGE.rglob("*.py"):
        assert not re.search(r'executable, "-(?!P")', path.read_text()), path.name


def test_names_of_numbers_of_a_run_are_no_paths():
    kept = Record(numbers={"a": [1.0, "1", "a"]})
    assert from_text(to_text(kept, {})) == kept
    with pytest.raises(ValueError, match="'a/b' is no name of a number"):
        from_text(to_text(Record(numbers={"a/b": [1.0, "1", "a"]}), {}))


def external(kind, body):
    """Return XML whose entity is another file."""
    head = '<?xml version="1.0"?><!DOCTYPE VTKFile [<!ENTITY a SYSTEM "secret.txt">]>'
    return f'{head}<VTKFile type="{kind}">{body}</VTKFile>'


def test_entities_of_xml_that_name_files_are_not_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret.txt").write_text('<DataSet timestep="7"/>')
    (tmp_path / "a.pvd").write_text(external("Collection", "<Collection>&a;</Collection>"))
    with pytest.raises(FileFormatError, match="undefined entity"):
        listed_times(tmp_path / "a.pvd")
    (tmp_path / "secret.txt").write_text("1 1 1 3 3 3")
    radius = '<DataArray type="Float64" Name="radius" format="ascii">1 1</DataArray>'
    places = '<DataArray type="Float64" NumberOfComponents="3" format="ascii">&a;</DataArray>'
    text = f"<PointData>{radius}</PointData><Points>{places}</Points>"
    body = f'<PolyData><Piece NumberOfPoints="2">{text}</Piece></PolyData>'
    (tmp_path / "a.vtp").write_text(external("PolyData", body))
    with pytest.raises(FileFormatError):
        vg.load(tmp_path / "a.vtp")
    (tmp_path / "a.vtp").write_text(external("PolyData", body).replace("&a;", "1 1 1 3 3 3"))
    assert vg.load(tmp_path / "a.vtp").count == 2


PARTS = {
    "a.vtp": ("PPolyData", '<PPoints><PDataArray type="Float32" NumberOfComponents="3"/></PPoints>'),
    "b.vtu": ("PUnstructuredGrid", '<PPoints><PDataArray type="Float32" NumberOfComponents="3"/></PPoints>'),
    "c.vti": ("PImageData", '<PCellData><PDataArray type="Int64" Name="labels"/></PCellData>'),
    "d.vtp": ("vtkMultiBlockDataSet", ""),
}


@pytest.mark.parametrize("name", PARTS)
def test_files_that_lead_to_others_are_refused(name, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    if name == "c.vti":
        grid = pyvista.ImageData(dimensions=(3, 3, 3))
        grid.cell_data["labels"] = np.arange(8)
    else:
        grid = pyvista.PolyData(np.eye(3))
        grid.point_data["radius"] = np.full(3, 0.5)
        grid = grid.cast_to_unstructured_grid() if name == "b.vtu" else grid
    secret = tmp_path / f"secret{name[-4:]}"
    grid.save(secret)
    read = vg.load_image if name == "c.vti" else vg.load
    read(secret)
    kind, declared = PARTS[name]
    extent = 'WholeExtent="0 2 0 2 0 2" Extent="0 2 0 2 0 2" Origin="0 0 0" Spacing="1 1 1" GhostLevel="0"'
    part = (
        f'<DataSet index="0" file="../{secret.name}"/>'
        if "Multi" in kind
        else f'<Piece {extent} Source="../{secret.name}"/>'
    )
    (tmp_path / "in").mkdir()
    decoy = '<!-- <VTKFile type="PolyData" version="1.0"> -->'
    (tmp_path / "in" / name).write_text(
        f'<?xml version="1.0"?>{decoy}<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian">'
        f"<{kind} {extent}>{declared}{part}</{kind}></VTKFile>"
    )
    for way in (read, vg.load_shape):
        with pytest.raises(FileFormatError, match=r"only names other files|has the suffix '.vti'"):
            way(tmp_path / "in" / name)


def test_images_whose_data_stand_elsewhere_are_refused(tmp_path):
    pytest.importorskip("nrrd")
    (tmp_path / "secret.raw").write_bytes(bytes(8))
    head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: ../secret.raw\n"
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "a.nrrd").write_text(head)
    with pytest.raises(FileFormatError, match="only names other files"):
        vg.load_image(tmp_path / "in" / "a.nrrd")


def test_scenes_for_paraview_name_their_own_parts_only(tmp_path):
    name = """a"b'<c>&"""
    vg.save_scene(pair(), tmp_path / f"{name}.vtm")
    files = [entry.attrib["file"] for entry in ET.parse(tmp_path / f"{name}.vtm").getroot().iter("DataSet")]
    assert files == [f"{name}/grains.vtp", f"{name}/container.vtp"]


def test_entities_of_xml_that_grow_are_refused(tmp_path):
    rows = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 12))
    head = f'<?xml version="1.0"?><!DOCTYPE VTKFile [<!ENTITY a0 "0 0 0 ">{rows}]>'
    (tmp_path / "laughs.vtp").write_text(f'{head}<VTKFile type="PolyData">&a11;</VTKFile>')
    for read in (vg.load, vg.load_shape):
        with pytest.raises(VoxgranError):
            read(tmp_path / "laughs.vtp")
    for name, kind in (("laughs.vtu", "UnstructuredGrid"), ("laughs.vti", "ImageData"), ("laughs.pvd", "Collection")):
        (tmp_path / name).write_text(f'{head}<VTKFile type="{kind}">&a11;</VTKFile>')
        read = {"laughs.vti": vg.load_image, "laughs.pvd": listed_times}.get(name, vg.load)
        with pytest.raises(VoxgranError):
            read(tmp_path / name)


#: a name that would be markup, a command of a shell, of Python and of C++, a formula and a template, on several lines
EVIL = """<script>alert(1)</script><img src=x onerror=alert(1)>"; rm -rf x; '\n; import os; os.system("rm -rf x") #
\"\"\"\r\x0b\x85\u2028*/ system("rm -rf x"); // $\\frac{ {{ 7*7 }} \\"""
#: short enough for legends, and without characters that no font has
MARKUP = '<script>alert(1)</script>"; rm -rf x {{ 7*7 }} $'
#: beginnings of lines that engines skip
COMMENTS = ("#", "//", ";", "*", "{")


def pair(name="sphere"):
    grain = dataclasses.replace(vg.shapes.sphere(), name=name)
    return vg.Packing.of([grain], vg.Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)], unit="mm")


def refuse_markup(path):
    text = path.read_text()
    assert "<script>alert" not in text
    assert "rm -rf x" in html.unescape(text)
    assert "{{ 7*7 }}" in html.unescape(text)


def test_names_are_no_markup_of_comparisons_and_reports(tmp_path):
    pytest.importorskip("matplotlib")
    more = pair(MARKUP), dataclasses.replace(pair(MARKUP), position=np.array([[1.0, 1, 1], [3, 3, 2]]))
    vg.save_comparison(
        {MARKUP: more[0], "other": more[1]}, tmp_path / "c.html", which=["gradation"], pictures=False, title=MARKUP
    )
    refuse_markup(tmp_path / "c.html")
    assert json.loads((tmp_path / "c.json").read_text())["groups"][0]["name"] == MARKUP
    vg.save_report(pair(MARKUP), tmp_path / "r.html", pictures=False, title=MARKUP)
    refuse_markup(tmp_path / "r.html")


@pytest.mark.slow
def test_names_are_no_markup_of_studies_and_no_files(tmp_path):
    shapes = [{"family": "sphere", "label": MARKUP}, {"family": "box", "label": "box"}]
    base = {"container": {"kind": "box", "lengths": [4, 4, 4]}, "packing": {"method": "rsa", "count": 3}}
    measured = {MARKUP: {"low": 0.1, "high": 0.2, "source": MARKUP}}
    made = vg.Study(base=base, axes={"shape": shapes}, seeds=1, experiments=measured)
    made.run(tmp_path / "out", workers=1).write_page(tmp_path / "page")
    assert all(re.fullmatch(r"[\w./-]+", path.relative_to(tmp_path).as_posix()) for path in tmp_path.rglob("*"))
    refuse_markup(tmp_path / "page" / "study.html")


@pytest.mark.parametrize(
    ("engine", "kind"),
    [*((engine, "sphere") for engine in vg.engines()), ("lammps", "box"), ("yade", "box"), ("blocks", "box")]
    + [slow(engine, "box") for engine in vg.engines() if engine not in ("lammps", "yade", "blocks")],
)
def test_names_are_no_commands_of_engines(engine, kind, tmp_path):
    solid = vg.shapes.sphere() if kind == "sphere" else vg.shapes.box(lengths=(1, 1, 1))
    named = dataclasses.replace(solid, name=EVIL)
    bed = vg.Packing.of([named], vg.Box((6, 6, 6)), position=[(1, 1, 1), (4, 4, 4)], unit="mm")
    vg.write_deck(bed, tmp_path / "deck", engine)
    for path in (tmp_path / "deck").rglob("*"):
        assert re.fullmatch(r"[\w.-]+", path.name)
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".json":
            json.loads(text)
            continue
        if path.suffix == ".py":
            assert "rm -rf" not in ast.unparse(ast.parse(text))
        # what some reader takes for the end of a line counts as one
        for line in text.splitlines():
            assert "rm -rf" not in line or line.startswith(COMMENTS), f"{path.name}: {line}"
            assert not (line.startswith("//") and line.endswith("\\")), f"{path.name}: {line}"
        # LAMMPS takes all up to the next three for one line
        assert '"""' not in text or path.suffix not in (".in", ".data"), path.name
