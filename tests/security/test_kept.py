"""Values that files of grains, studies and scenes keep as JSON or TOML: of their types, in range, and without files."""

import contextlib
import dataclasses
import json

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, TooLargeError, VoxgranError
from voxgran.cli import main
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.study.runs import Record, from_text, to_text

pytestmark = pytest.mark.usefixtures("forked_readers", "jagged_pictures")

BALL = vg.Packing.of([vg.shapes.sphere()], vg.Box((2, 2, 2)), position=[(1, 1, 1)])
DISK = vg.Packing.of([vg.shapes.disk()], vg.Rectangle((3, 3)), position=[(2, 2, 0)])


def rewritten(bed, path, **changes):
    """Save a packing of which another program has changed texts; each change takes the values of one and returns new
    ones.
    """
    pyvista = pytest.importorskip("pyvista")
    vg.save(bed, path, overwrite=True)
    data = pyvista.read(path)
    for name, change in changes.items():
        data.field_data[name] = [json.dumps(change(json.loads(str(data.field_data[name][0]))))]
    data.save(path)
    return path


@pytest.fixture(scope="module")
def secret(tmp_path_factory):
    """Return a folder with a mesh, a picture and a table that no record may name."""
    folder = tmp_path_factory.mktemp("secret")
    vg.save_shape(vg.shapes.box(lengths=(2, 2, 2)), folder / "mesh.stl")
    np.save(folder / "picture.npy", np.pad(np.ones((30, 30)), 5))
    (folder / "table.csv").write_text("size,passing\n1,0\n2,50\n4,100\n")
    return folder


FILES = {
    "mesh": (BALL, "container", {"kind": "mesh", "file": "mesh.stl"}),
    "vessel": (BALL, "container", {"kind": "vessel", "file": "mesh.stl"}),
    "polygon": (DISK, "container", {"kind": "polygon", "file": "picture.npy", "pixel_size": 0.1}),
    "sieve": (BALL, "asked_sizes", {"kind": "sieve", "file": "table.csv"}),
    "mixture": (BALL, "asked_sizes", {"kind": "mixture", "parts": [{"kind": "sieve", "file": "table.csv"}]}),
}


@pytest.mark.parametrize("name", FILES)
def test_packings_name_no_other_files(name, secret, tmp_path):
    """They were read, and the first line of a table that is none was shown."""
    bed, key, told = FILES[name]
    whole = json.loads(json.dumps(told).replace('file": "', f'file": "{secret}/'))
    with pytest.raises(FileFormatError) as raised:
        vg.load(rewritten(bed, tmp_path / "a.vtp", **{key: lambda _: whole}))
    assert "names no other file" in str(raised.value) or (name == "mesh" and "closed-mesh" in str(raised.value))


@pytest.mark.parametrize("name", ["mesh", "vessel", "polygon"])
@pytest.mark.parametrize("suffix", [".csv", ".txt", ".xyzr"])
def test_comments_of_tables_name_no_other_files(name, suffix, secret, tmp_path):
    bed, _, told = FILES[name]
    told = told | {"file": str(secret / told["file"])}
    rows = "0.1 0.1 0.1 0.5\n" if bed is BALL or suffix != ".csv" else "x,y,r\n1,1,0.5\n"
    (tmp_path / f"a{suffix}").write_text(f"# container {json.dumps(told)}\n{rows}")
    with pytest.raises(FileFormatError, match="names no other file"):
        vg.load(tmp_path / f"a{suffix}")


def test_sizes_in_the_provenance_of_earlier_versions_name_no_files(secret, tmp_path):
    """Such files have no gravity, and the distribution in their provenance."""
    pyvista = pytest.importorskip("pyvista")
    told = {"kind": "sieve", "file": str(secret / "table.csv")}
    path = rewritten(BALL, tmp_path / "a.vtp", provenance=lambda held: held | {"sizes": told})
    data = pyvista.read(path)
    del data.field_data["gravity"]
    data.save(path)
    assert vg.load(path).asked_sizes is None


@pytest.mark.parametrize("radius", [1e300, 1e150, 1e-100])
def test_clumps_of_packings_have_radii_in_range(radius, tmp_path):
    """Qhull ended the process at points of 1e300."""
    pair = Spheres(np.array([[-0.25, 0, 0], [0.25, 0, 0]]), np.full(2, 0.5))
    bed = vg.Packing.of([vg.Shape.of(pair, name="c")], vg.Box((6, 6, 6)), position=[(2, 2, 2)])
    (first,) = bed.shapes
    _ = bed.diameters, bed.volumes, bed.solid_fraction
    odd = Spheres(first.geometry.centers, first.geometry.radii)
    object.__setattr__(odd, "radii", np.full(2, radius))
    object.__setattr__(bed, "shapes", (dataclasses.replace(first, geometry=odd),))
    with np.errstate(all="ignore"):
        vg.save(bed, tmp_path / "a.vtp")
    with pytest.raises(FileFormatError, match="must be between 1e-60 and 1e\\+60"):
        vg.load(tmp_path / "a.vtp")


def test_lengths_of_shapes_are_in_range():
    for length in (1e300, 1e-100):
        for make in (vg.shapes.sphere, vg.shapes.disk):
            with pytest.raises(VoxgranError, match="between 1e-60 and 1e\\+60"):
                make(diameter=length)
        with pytest.raises(VoxgranError, match=r"between 1e-60 and 1e\+60"):
            Primitive("cylinder", (1.0, length))


ODD = (None, True, -1, 2**40, 2**200, 1e300, float("nan"), "", "x", "\ud800", "\0", [], {}, [[]], [1], ["x"], {"a": 1})


@pytest.mark.parametrize(
    "key", ["name", "unit", "offset", "key", "geometry", "kind", "dimensions", "rotation", "record"]
)
def test_entries_of_shapes_have_their_types(key, tmp_path):
    """A shape whose name was true, or half of a character, ended its report; others ended the load."""
    for odd in ODD:
        path = rewritten(BALL, tmp_path / "a.vtp", shapes=lambda held, odd=odd: [held[0] | {key: odd}])
        try:
            bed = vg.load(path)
        except FileFormatError:
            continue
        assert key in ("name", "unit", "record", "offset"), (key, odd)
        assert isinstance(bed.shapes[0].name, str)
        bed.shapes[0].name.encode()
        assert "\0" not in bed.shapes[0].name


@pytest.mark.parametrize("key", ["assumed", "asked", "compression", "settling", "tiled"])
def test_the_provenance_of_packings_has_its_types(key, tmp_path):
    for odd in (5, "x", [1], True):
        path = rewritten(BALL, tmp_path / "a.vtp", provenance=lambda held, odd=odd: held | {key: odd})
        with pytest.raises(FileFormatError, match="of another type"):
            vg.load(path)


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_names_that_no_file_can_hold_are_written_as_in_python(tmp_path):
    bed = vg.Packing.of(
        [dataclasses.replace(vg.shapes.sphere(), name="a\ud800\0")], vg.Box((2, 2, 2)), position=[(1, 1, 1)]
    )
    assert bed.shapes[0].name == "a\\ud800\\x00"
    vg.save_report(bed, tmp_path / "a.html")
    vg.write_deck(bed, tmp_path / "deck", "lammps")
    with pytest.raises(VoxgranError, match="name is True: it must be a text"):
        dataclasses.replace(vg.shapes.sphere(), name=True)


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_files_with_names_of_any_bytes_are_reported_and_compared(tmp_path, capfd):
    paths = [tmp_path / f"a\udcff{k}.vtp" for k in range(2)]
    for path in paths:
        vg.save(vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10), path)
    # the page has the name of a table
    vg.save(vg.load(paths[0]), paths[0].with_suffix(".csv"))
    assert main(["report", str(paths[0].with_suffix(".csv")), "-o", str(tmp_path / "r.html")]) == 0
    assert main(["compare", *map(str, paths), "-o", str(tmp_path / "c.html")]) == 0
    assert "\\udcff" in (tmp_path / "c.html").read_text(encoding="utf-8")


def test_records_of_runs_have_their_types():
    whole = json.loads(to_text(Record(numbers={"a": [1.0, "m", "length"]}, warnings=["w"]), {}))
    made = from_text(json.dumps(whole))
    assert made.numbers == {"a": [1.0, "m", "length"]}
    assert made.warnings == ["w"]

    def tried(record):
        try:
            made = from_text(json.dumps(whole | {"record": record}))
        except (ValueError, KeyError, TypeError):
            return
        for text in (made.failure, made.stop_reason, *made.warnings, *made.numbers):
            text.encode()
        assert all(isinstance(value, float | int) for value in (made.seconds, made.memory, made.grains, made.elapsed))
        for name, (value, unit, meaning) in made.numbers.items():
            assert isinstance(value, float), name
            assert {type(unit), type(meaning)} == {str}, name

    for odd in ODD:
        tried(odd)
        for key in whole["record"]:
            tried(whole["record"] | {key: odd})
        for numbers in ({"a": odd}, {"a": [odd, "m", "x"]}, {"a": ["1", odd, "x"]}, {"a": ["1", "m", "x", odd]}):
            tried(whole["record"] | {"numbers": numbers})


@pytest.mark.parametrize("part", ['"="', '"\u2028"', "'.='", '"\\"="', '"\u0085"', '"#"', "'\"'"])
def test_quotes_do_not_hide_parts_of_names(part, tmp_path):
    """An equals sign or a separator of lines in quotes hid the rest of a name."""
    (tmp_path / "a.toml").write_text(".".join([part, *["a"] * 20] * 1000) + " = 1", encoding="utf-8")
    with pytest.raises(FileFormatError, match="more than 32 parts at line 1"):
        vg.Scene.from_toml(tmp_path / "a.toml")


@pytest.mark.parametrize(
    "text", ['"""\n' + "a." * 99 + '"""', "'''" + "a." * 99 + "'''", '"' + "a." * 99 + '\\""', "1 # " + "a." * 99]
)
def test_dots_in_texts_and_comments_are_no_parts_of_names(text, tmp_path):
    (tmp_path / "a.toml").write_text(f"zzz = {text}\n")
    with pytest.raises(VoxgranError) as told:
        vg.Scene.from_toml(tmp_path / "a.toml")
    assert "parts" not in str(told.value)


@pytest.mark.parametrize("value", ["0x" + "f" * 5000, "[0x" + "f" * 5000 + ", 4, 4]", '"a\\u0000b"'])
@pytest.mark.parametrize(
    "key", ["container.lengths", "packing.count", "packing.start", "shape.file", "measure.which", "sizes.file"]
)
def test_whole_numbers_of_scenes_have_an_end(key, value, tmp_path, capsys):
    """Python writes no number of more than 4300 digits, of which messages ended in an error."""
    rows = {"container.kind": "'box'", "packing.method": "'rsa'", key: value}
    text = "".join(f"{name} = {one}\n" for name, one in rows.items() if not name.startswith("shape."))
    (tmp_path / "a.toml").write_text(
        f"{text}[[shape]]\n" + (f"file = {value}\n" if key == "shape.file" else "family = 'sphere'\n")
    )
    assert main(["plan", str(tmp_path / "a.toml")]) == 2
    assert "Traceback" not in capsys.readouterr().err


def pcd(sizes, *, counts="1 1 1", kinds="F F F", many=1, data="ascii"):
    """Return the bytes of a header of PCD."""
    return (
        f"VERSION 0.7\nFIELDS x y z\nSIZE {sizes}\nTYPE {kinds}\nCOUNT {counts}\nWIDTH {many}\nHEIGHT 1\n"
        f"POINTS {many}\nDATA {data}\n"
    ).encode()


@pytest.mark.parametrize(
    "head",
    [pcd("4,f4 4 4"), pcd("4,(200000)f8 4 4"), pcd("4,O 4 4"), pcd("4,O 4 4", data="binary"), pcd("3 4 4"),
     pcd("2 4 4"), pcd("4 4 4", kinds="f F F"), pcd("4 4 4", counts="-1 1 1"), pcd("4 4 4", counts="1_0 1 1"),
     pcd("4 4 4", many="1_0"), pcd("4 4 4", many="9" * 5000), pcd("4 4 4", counts="1 1 99999999999")],
)  # fmt: skip
def test_headers_of_pcd_hold_numbers_of_a_list(head, tmp_path):
    """Their sizes became types of NumPy: objects, structures and arrays that filled the memory."""
    (tmp_path / "a.pcd").write_bytes(head + b"1 2 3\n" * 10)
    with pytest.raises(FileFormatError, match="cannot be read as PCD"):
        vg.load_cloud(tmp_path / "a.pcd")


def test_headers_of_pcd_have_an_end(tmp_path):
    """The time grew with the square of the number of lines: 8 MiB took half an hour."""
    (tmp_path / "a.pcd").write_bytes(b"\n" * 2**23)
    with pytest.raises(FileFormatError, match="does not end within 65536 bytes"):
        vg.load_cloud(tmp_path / "a.pcd")


def test_statistics_of_bytes_do_not_grow_to_gigabytes(tmp_path):
    """With a scale each byte becomes a number of eight."""
    netcdf = pytest.importorskip("netCDF4")
    with netcdf.Dataset(tmp_path / "a.nc", "w") as file:
        file.createDimension("g", 5 * 10**8)
        values = file.createVariable("a", "i1", ("g",), zlib=True, chunksizes=(2**24,))
        values.scale_factor = 0.5
        values[0] = 1
    with pytest.raises(TooLargeError, match="does not fit in memory"):
        vg.load_statistics(tmp_path / "a.nc")


@pytest.mark.parametrize(
    "container",
    [vg.Cylinder(radius=1e9, height=6), vg.Cylinder(radius=4, height=1e9), vg.Funnel(radius=3, outlet=1e9, height=6),
     vg.Hopper(radius=1e9, outlet=3)],
)  # fmt: skip
def test_measures_of_flat_and_slender_containers_have_few_points(container):
    """The points for their volume were as many as their ratio of lengths, or its square."""
    fragment = vg.make_shape("voronoi_fragment", seed=1)
    bed = vg.Packing.of([fragment], container, position=[(0, 0, 2), (0, 0, 4)], gravity=(0, 0, -1))
    with pytest.warns(vg.PackingWarning):
        tree = vg.measure(bed)
    assert tree["/grains"].sizes["grain"] == 2


KINDS = {
    "hopper": {"radius": 3.0, "outlet": 1.0, "length": 4.0, "bin_height": 2.0},
    "funnel": {"radius": 3.0, "outlet": 1.0, "height": 4.0},
    "cylinder": {"radius": 3.0, "height": 4.0},
    "drum": {"radius": 3.0, "length": 4.0},
    "sphere": {"radius": 3.0},
    "box": {"lengths": [6.0, 6.0, 6.0]},
}


@pytest.mark.parametrize("kind", KINDS)
def test_containers_of_packings_have_lengths_in_range(kind, tmp_path):
    """Lengths of 2**70 beside some of 1 ended measures and decks in divisions by 0, and in petabytes."""
    odd = [{name: value} for name in KINDS[kind] if kind not in ("box", "sphere") for value in (2.0**70, 1e18, 1e-30)]
    for change in (*odd, {"origin": [2.0**70, 0, 0]}, {"origin": [0, 1e14, 0]}):
        told = {"kind": kind, "origin": [0, 0, 0]} | KINDS[kind] | change
        path = rewritten(BALL, tmp_path / "a.vtp", container=lambda _, told=told: told)
        with pytest.raises(FileFormatError, match="holds no packing of voxgran"):
            vg.load(path)


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.parametrize("kind", ["hopper", "funnel"])
def test_containers_far_wider_than_grains_are_written_for_engines_or_refused(kind, tmp_path):
    told = {"kind": kind} | {name: 1e20 * value for name, value in KINDS[kind].items()}
    bed = vg.Packing.of([vg.shapes.sphere()], vg.make_container(told), position=[(0, 0, 1e20)], gravity=(0, 0, -1))
    with contextlib.suppress(VoxgranError):
        vg.write_deck(bed, tmp_path / "deck", "lammps")


@pytest.mark.parametrize("rows", [0, 1, 4])
def test_packings_have_as_many_orientations_as_grains(rows):
    """Other numbers of rows were taken, and read beyond their ends."""
    with pytest.raises(VoxgranError, match=rf"orientation has {rows} rows: there are 2 grains"):
        vg.Packing.of([vg.shapes.sphere()], vg.Box((6, 6, 6)), position=[(1, 1, 1), (3, 3, 3)],
                      orientation=np.tile([1.0, 0, 0, 0], (rows, 1)))  # fmt: skip
