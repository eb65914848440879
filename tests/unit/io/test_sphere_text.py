"""Spheres as text: exact round trips, every form that people write, and the number of the line that is wrong."""

import numpy as np
import pytest

from voxgran._base.errors import FileFormatError, InputError
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.io.files import load
from voxgran.io.spheres import owned_spheres, save_spheres
from voxgran.io.tables import read_table
from voxgran.packing.model import Packing
from voxgran.shapes.family import make_shape
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.spheres import Spheres


def read(tmp_path, text, **options):
    (tmp_path / "p.txt").write_text(text)
    return load(tmp_path / "p.txt", **options)


def radii(packing):
    return packing.scale * packing.shapes[0].bounding_radius


@pytest.mark.parametrize("suffix", ["txt", "csv"])
def test_a_round_trip_is_exact(spheres, suffix, tmp_path):
    save_spheres(spheres, tmp_path / f"p.{suffix}")
    # a table that pandas reads has no room for these
    given = {"container": spheres.container, "unit": "mm"} if suffix == "csv" else {}
    again = load(tmp_path / f"p.{suffix}", **given)
    assert again.position.tobytes() == spheres.position.tobytes()
    assert again.scale.tobytes() == spheres.scale.tobytes()
    assert again.container == spheres.container
    if suffix != "csv":
        assert (again.gravity, again.contact_gap) == (spheres.gravity, spheres.contact_gap)
    assert again.unit == "mm"
    assert "assumed" not in again.provenance
    assert again.solid_fraction == pytest.approx(spheres.solid_fraction, rel=1e-15)


def test_pandas_reads_the_table_as_it_is(spheres, tmp_path):
    pandas = pytest.importorskip("pandas")
    save_spheres(spheres, tmp_path / "p.csv")
    table = pandas.read_csv(tmp_path / "p.csv")
    assert list(table) == ["x", "y", "z", "r"]
    np.testing.assert_allclose(table[["x", "y", "z"]], spheres.position, rtol=1e-15)
    np.testing.assert_allclose(table["r"], radii(spheres), rtol=1e-15)
    table.to_csv(tmp_path / "again.csv", index=False)
    np.testing.assert_allclose(load(tmp_path / "again.csv").position, spheres.position, rtol=1e-15)


def test_the_older_layout_of_tables_is_read(spheres, tmp_path):
    head = '# x y z r\n# unit mm\n# container {"kind": "box", "lengths": [4, 4, 4], "periodic": [true, false, true]}\n'
    (tmp_path / "p.csv").write_text(f"{head}1.0,2.0,3.0,0.5\n3.0,2.0,1.0,0.25\n")
    packing = load(tmp_path / "p.csv")
    assert packing.container == Box((4, 4, 4), periodic="xz")
    assert packing.unit == "mm"
    assert packing.position.tolist() == [[1, 2, 3], [3, 2, 1]]


@pytest.mark.parametrize("suffix", ["txt", "xyzr", "csv"])
def test_disks_are_rows_of_x_y_r(suffix, tmp_path):
    room = Rectangle((4, 3), periodic="x")
    disk = Shape.of(Outline("disk", radius=0.5), name="disk")
    disks = Packing.of([disk], room, position=[(1, 1, 0), (3, 2, 0)], scale=[1.0, 1.5], unit="mm")
    save_spheres(disks, tmp_path / f"p.{suffix}")
    again = load(tmp_path / f"p.{suffix}", **({"container": room, "unit": "mm"} if suffix == "csv" else {}))
    assert (again.dimension, again.container, again.unit) == (2, room, "mm")
    assert again.position.tobytes() == disks.position.tobytes()
    assert again.solid_fraction == disks.solid_fraction
    assert again.shapes[0].geometry.kind == "disk"
    assert "assumed" not in again.provenance
    first = (tmp_path / f"p.{suffix}").read_text().splitlines()[0]
    assert first == ("x,y,r" if suffix == "csv" else "# x y r")


def test_disks_without_a_container_lie_in_the_rectangle_around_them(tmp_path):
    packing = read(tmp_path, "x,y,diameter\n1,2,2\n4,2,1\n", periodic="x")
    assert packing.container == Rectangle((4.5, 2.0), periodic="x", origin=(0.0, 1.0))
    assert packing.provenance["assumed"]["dimension"] == "two: there is no column of z"
    with pytest.raises(FileFormatError, match="leave out clumpId"):
        read(tmp_path, "x,y,r,clumpId\n1,2,2,0\n")


@pytest.mark.parametrize(
    ("family", "words"), [("ellipsoid", "is an ellipsoid: text"), ("polygon", "is a polygon"), ("box", "is a box")]
)
def test_nouns_have_their_article(family, words, tmp_path):
    shape = make_shape(family)
    container = Box((4, 4, 4)) if shape.dimension == 3 else Rectangle((4, 4))
    packing = Packing.of([shape], container, position=[(2, 2, 0)])
    with pytest.raises(InputError, match=f"grain 0 {words}"):
        save_spheres(packing, tmp_path / "p.csv")


def test_no_disks_make_a_round_trip(tmp_path):
    save_spheres(Packing.of([make_shape("disk")], Rectangle((4, 3)), position=[]), tmp_path / "p.txt")
    assert (load(tmp_path / "p.txt").count, load(tmp_path / "p.txt").dimension) == (0, 2)


def test_an_empty_packing_makes_a_round_trip(spheres, tmp_path):
    save_spheres(Packing.of(spheres.shapes, spheres.container, position=[]), tmp_path / "p.txt")
    assert load(tmp_path / "p.txt").count == 0


@pytest.mark.parametrize(
    "text",
    [
        "1 2 3 0.5\n4 5 6 0.25\n",
        "1,2,3,0.5\n4, 5 ,6,0.25",
        "x,y,z,r\n1,2,3,0.5\n4,5,6,0.25\n",
        "# a comment\n\nX Y Z radius\n1\t2\t3\t0.5\n   \n4 5 6 0.25  # the second\n",
        "1,2,3,0.5\n4 5 6 0.25\n",
        "1 2 3 0.5 17.5 text\r\n4 5 6 2.5e-1 1 more\r\n",
        "x [mm];y [mm];z [mm];D [mm]\n1,0;2,0;3,0;1,0\n4;5;6;0,5\n",
        'id,radius,z,y,x,name\n1,0.5,3,2,1,a b\n2,0.25,6,5,4,"c"\n',
        "#x_coord y_coord z_coord radius clumpId\n1 2 3 0.5 -1\n4 5 6 0.25 -1\n",
        "#format x_y_z_r_matId\n1 2 3 0.5 7\n4 5 6 0.25 7\n",
    ],
)
def test_every_common_form_is_read(text, tmp_path):
    packing = read(tmp_path, text)
    np.testing.assert_array_equal(packing.position, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(radii(packing), [0.5, 0.25])


def test_without_a_container_it_is_the_box_around_the_spheres(tmp_path):
    packing = read(tmp_path, "0 0 0 1\n3 0 0 0.5\n", unit="cm")
    np.testing.assert_allclose(packing.container.bounds, [[-1, -1, -1], [3.5, 1, 1]])
    assert packing.provenance["assumed"] == {"container": "the box around the spheres", "periodic": "nowhere"}
    assert packing.unit == "cm"


def test_a_given_container_counts(spheres, tmp_path):
    save_spheres(spheres, tmp_path / "p.txt")
    box = Box((9, 9, 9))
    assert load(tmp_path / "p.txt", container=box).container == box


@pytest.mark.parametrize(
    ("text", "number", "reason"),
    [
        ("1 2 3 4\n1 2 3\n", 2, "has 3 values, the first line 4"),
        ("1 2 3 4\n1 2 3 4 5\n", 2, "has 5 values, the first line 4"),
        ("1 2 3 4\n1 2 3 -4\n", 2, "r above 0"),
        ("# c\n\n1 2 three 4\n", 3, "'1 2 three 4' is not x y z r"),
        ("1 2 3 4\n1 2 nan 4\n", 2, "must be finite"),
        ("1 2 3 0\n", 1, "r above 0"),
        ("x y z s\n1 2 3 4\n", 1, "the columns are x y z s; there is no r or diameter"),
        ("1 2 3 4\n1;2;3;4\n", 2, "has 1 values"),
        ("x,y,z\n1,2,3\n", 1, "the columns are x y z;"),
        ("1,2,3,4\n1,2,,4\n", 2, "'1,2,,4' is not x y z r"),
        ('# container {"kind": "sack"}\n1 2 3 4\n', 1, "the container cannot be read"),
    ],
)
def test_a_bad_line_is_named_by_its_number(text, number, reason, tmp_path):
    with pytest.raises(FileFormatError, match=rf"p\.txt, line {number}: .*{reason}") as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_what_is_no_text_is_refused(tmp_path):
    (tmp_path / "p.txt").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(FileFormatError, match="is no text"):
        read_table(tmp_path / "p.txt")


def test_no_sphere_and_no_container_is_refused(tmp_path):
    with pytest.raises(InputError, match="names no container: give the container"):
        read(tmp_path, "# nothing\n")
    assert read(tmp_path, "x y z r\n", container=Box((1, 1, 1))).count == 0


def test_a_clump_is_written_as_its_spheres(tmp_path):
    clump = Shape(Spheres(np.array([[-0.5, 0, 0], [0.5, 0, 0]]), np.array([0.5, 0.25])), "clump")
    turned = [np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)]
    packing = Packing.of([clump], Box((9, 9, 9)), position=[[3, 3, 3]], scale=[2.0], orientation=[turned])
    centers, sizes = owned_spheres(packing)[:2]
    np.testing.assert_allclose(centers, [[3, 2, 3], [3, 4, 3]], atol=1e-15)
    np.testing.assert_allclose(sizes, [1.0, 0.5])
    save_spheres(packing, tmp_path / "p.xyzr")
    again = load(tmp_path / "p.xyzr")
    assert again.count == 1
    back_centers, back_sizes = owned_spheres(again)[:2]
    np.testing.assert_allclose(back_centers, centers, atol=1e-14)
    np.testing.assert_allclose(back_sizes, sizes)
    assert again.solid_fraction == pytest.approx(packing.solid_fraction, rel=1e-12)


def test_other_grains_are_refused_with_a_remedy(mixed, tmp_path):
    with pytest.raises(InputError, match=r"grain 0 is a mesh: .* save as .vtp"):
        save_spheres(mixed, tmp_path / "p.txt")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("gravity", [None, (0.6, 0.0, -0.8)])
def test_gravity_and_contact_gap_are_kept(gravity, tmp_path):
    box = Box((3, 3, 3))
    made = Packing.of([make_shape("sphere")], box, position=[[1, 1, 1]], gravity=gravity, contact_gap=0.25)
    save_spheres(made, tmp_path / "p.txt")
    again = load(tmp_path / "p.txt")
    assert (again.gravity, again.contact_gap) == (gravity, 0.25)
    # in another container the direction may not be allowed
    assert load(tmp_path / "p.txt", container=Box((3, 3, 3), periodic="xyz")).gravity is None
    (tmp_path / "p.txt").write_text((tmp_path / "p.txt").read_text().replace("# contact_gap 0.25", "# contact_gap a"))
    with pytest.raises(FileFormatError, match="line 5: contact_gap is no JSON"):
        load(tmp_path / "p.txt")
