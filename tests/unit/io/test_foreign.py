"""Packings that other programs wrote: as YADE, LAMMPS, ParaView and a spreadsheet write them, and damaged."""

import dataclasses
import io

import numpy as np
import pytest
import pyvista
from hypothesis import given
from hypothesis import strategies as st

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, MissingFileError
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations
from voxgran.io.spheres import owned_spheres
from voxgran.shapes.spheres import Spheres

pytestmark = [
    pytest.mark.filterwarnings("ignore:the bulk holds"),
    pytest.mark.usefixtures("jagged_pictures", "forked_readers"),
]

DATA = """LAMMPS data file via write_data, version 29 Aug 2024, timestep = 1000

3 atoms
1 atom types

0 4 xlo xhi
-1 3 ylo yhi
0.0e+00 2.0 zlo zhi

Atoms # sphere

3 1 0.5 2500 3.25 0 1 0 0 0
1 1 1.0 2500 1 0 1 0 0 0
2 1 0.5 2500 1.75 0 1 0 0 0

Velocities

1 0 0 0 0 0 0
2 0 0 0 0 0 0
3 0 0 0 0 0 0
"""
DUMP = """ITEM: UNITS
si
ITEM: TIMESTEP
0
ITEM: NUMBER OF ATOMS
1
ITEM: BOX BOUNDS pp pp ff
0 2
0 2
0 2
ITEM: ATOMS id type xs ys zs diameter
1 1 0.5 0.5 0.5 1
ITEM: TIMESTEP
100
ITEM: NUMBER OF ATOMS
2
ITEM: BOX BOUNDS pp pp ff
0 4
0 4
0 2
ITEM: ATOMS id type x y z vx radius
2 rock 3.75 2 1 0 0.5
1 rock 0.5 2 1 0 0.5
"""


def read(tmp_path, text, name="p.dat", **options):
    (tmp_path / name).write_text(text)
    return vg.load(tmp_path / name, **options)


def diameters(packing):
    return packing.diameters.tolist()


def test_a_data_file_of_lammps(tmp_path):
    packing = read(tmp_path, DATA)
    assert packing.position.tolist() == [[1, 0, 1], [1.75, 0, 1], [3.25, 0, 1]]
    assert diameters(packing) == pytest.approx([1.0, 0.5, 0.5])
    assert packing.container == vg.Box((4, 4, 2), origin=(0, -1, 0))
    assert packing.density == 2500
    assert "a data file does not say" in packing.provenance["assumed"]["periodic"]
    assert vg.verify(packing).ok
    wrapped = read(tmp_path, DATA, periodic="x", unit="mm")
    assert wrapped.container.periodic == (True, False, False)
    assert "assumed" not in wrapped.provenance
    plain = read(tmp_path, DATA.replace("Atoms # sphere", "Atoms"))
    assert plain.position.tobytes() == packing.position.tobytes()
    assert "number of values" in plain.provenance["assumed"]["atom style"]


def test_the_last_frame_of_a_dump_file_counts(tmp_path):
    packing = read(tmp_path, DUMP, "dump.lammpstrj")
    assert packing.position.tolist() == [[0.5, 2, 1], [3.75, 2, 1]]
    assert packing.container == vg.Box((4, 4, 2), "xy")
    assert packing.provenance["assumed"]["frame"] == "time step 100, one of 2"
    proof = vg.verify(packing)
    # the second touches the first one across the periodic face
    assert [(pair.i, pair.j, pair.image) for pair in proof.pairs] == [(0, 1, (-1, 0, 0))]
    assert proof.deepest == pytest.approx(0.25)
    first = read(tmp_path, DUMP, frame=0)
    assert first.position.tolist() == [[1, 1, 1]]
    assert first.unit == "m"
    with pytest.raises(FileFormatError, match="2 frames: there is no frame 2"):
        read(tmp_path, DUMP, frame=2)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("3 atoms\n", "4 atoms\n", "3 lines of atoms where its head says 4"),
        ("Atoms # sphere", "Atoms # ellipsoid", "the atom style is ellipsoid"),
        ("Atoms # sphere", "Bonds", "no section Atoms"),
        ("0 4 xlo xhi", "0 nan xlo xhi", "no box"),
        ("0 4 xlo xhi", "4 0 xlo xhi", "above 0"),
        ("0 4 xlo xhi", "4 1 0 avec", "line 6: the edges of the box are .*the first must be along x"),
        ("2 1 0.5 2500", "2 1 -0.5 2500", "atom 1: .*r above 0"),
        ("2 1 0.5 2500", "2 1 0.5 nan", None),
        ("2 1 0.5 2500", "3 1 0.5 2500", "line 14: the sphere has the id 3, as that of line 12"),
        ("1.75 0 1 0 0 0", "1.75 0 1 0 0", r"line 14: .* is not 10 numbers"),
        ("1.75 0 1", "1.75 none 1", r"line 14: .* is not 10 numbers"),
    ],
)
def test_bad_data_files_are_refused(old, new, words, tmp_path):
    assert old in DATA
    if words is None:
        assert read(tmp_path, DATA.replace(old, new)).density == 1.0
        return
    with pytest.raises(FileFormatError, match=words) as caught:
        read(tmp_path, DATA.replace(old, new))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("1 rock 0.5 2 1 0 0.5\n", "", "1 lines of atoms in the frame of line 13, which says 2"),
        ("ITEM: ATOMS id type x y z vx radius\n2 rock 3.75 2 1 0 0.5\n1 rock 0.5 2 1 0 0.5\n", "", "cut off"),
        ("vx radius", "vx vy", "radius or diameter are needed"),
        ("x y z vx radius", "x y q vx radius", "x y z and radius"),
        ("pp pp ff\n0 4\n0 4\n0 2", "xy xz yz pp pp ff\n0 4 1\n0 4 1\n0 2 0", "tilt xz is 1: .*periodic along x and z"),
        ("pp pp ff\n0 4\n0 4\n0 2", "abc origin pp pp ff\n4 1 0 0\n0 4 0 0\n0 0 2 0", "line 17: the edges of the box"),
        ("pp pp ff\n0 4\n0 4\n0 2", "xy xz yz pp pp ff\n0 4\n0 4\n0 2", "line 18: '0 4' is not 3 numbers"),
        ("2 rock 3.75", "1 rock 3.75", "line 23: the sphere has the id 1, as that of line 22"),
        ("y z vx radius", "y z x radius", "2 columns x: which one holds"),
        ("y z vx radius", "y z diameter radius", "row 0: the radius is 0.5 and the diameter 0"),
        ("3.75 2 1", "inf 2 1", "must be finite"),
        ("3.75 2 1", "3.75 two 1", "line 22: .* is not 7 numbers"),
    ],
)
def test_bad_dump_files_are_refused(old, new, words, tmp_path):
    assert old in DUMP
    with pytest.raises(FileFormatError, match=words) as caught:
        read(tmp_path, DUMP.replace(old, new))
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def clumps():
    """Spheres and turned clumps of one shape, and one of another."""
    generator = stream(3, "clumps")
    two = vg.Shape.of(
        Spheres(np.array([[0, 0, 0], [0.5, 0, 0], [0.2, 0.4, 0.1]]), np.array([0.3, 0.25, 0.2])), name="two"
    )
    one = vg.Shape.of(Spheres(np.array([[0, 0, 0], [0.7, 0, 0]]), np.array([0.4, 0.3])), name="one")
    return vg.Packing.of(
        [vg.make_shape("sphere"), two, one],
        vg.Box((9, 9, 9)),
        position=generator.uniform(1, 8, (12, 3)),
        shape_id=[0, 1, 1, 1, 0, 1, 1, 2, 1, 1, 0, 1],
        scale=[0.5, 1, 1, 1, 0.7, 1, 1, 1, 1, 1, 1, 1],
        orientation=random_rotations(generator, 12),
    )


def test_clumps_of_yade_come_back_as_clumps(clumps, tmp_path):
    vg.save(clumps, tmp_path / "clumps.txt")
    text = (tmp_path / "clumps.txt").read_text()
    assert text.startswith("# x y z r clumpId")
    again = vg.load(tmp_path / "clumps.txt")
    assert again.count == clumps.count
    assert len(again.shapes) == 3
    np.testing.assert_allclose(again.volumes, clumps.volumes, rtol=1e-9)
    np.testing.assert_allclose(again.position, clumps.position, atol=1e-9)
    np.testing.assert_allclose(
        np.column_stack(owned_spheres(again)[:2]), np.column_stack(owned_spheres(clumps)[:2]), atol=1e-9
    )
    rounded = "#x_coord\ty_coord\tz_coord\tradius\tclumpId\n" + "\n".join(
        "\t".join(f"{float(word):.8g}" for word in line.split()) for line in text.splitlines() if line[0] != "#"
    )
    shuffled = rounded.splitlines()
    shuffled[1:] = shuffled[:0:-1]
    for name, body in (("yade.txt", rounded), ("mixed.txt", "\n".join(shuffled))):
        foreign = read(tmp_path, body, name)
        assert foreign.count == clumps.count
        assert sorted(foreign.volumes) == pytest.approx(sorted(clumps.volumes), rel=1e-6)
    bare = read(tmp_path, "0 0 0 1 4\n1 0 0 1 4\n5 5 5 1 -1\n")
    assert bare.count == 2
    assert "clump of each sphere" in bare.provenance["assumed"]["clumps"]


@pytest.mark.parametrize("row", ["{x} {y} {z} {r}", "{x}\t{y}\t{z}\t{r}\t-1", "{k} Sphere {x} {y} {z} {r}"])
def test_the_periodic_cell_of_yade_and_woo_is_read(row, tmp_path):
    spheres = vg.pack(vg.make_shape("sphere"), vg.Box((4, 3, 2), "xyz"), "rsa", count=9)
    rows = zip(*spheres.position.T.tolist(), (spheres.diameters / 2).tolist(), strict=True)
    text = "##PERIODIC:: 4 3 2\n##USER-DATA:: any\n" + "\n".join(
        row.format(k=k, x=x, y=y, z=z, r=r) for k, (x, y, z, r) in enumerate(rows)
    )
    again = read(tmp_path, text)
    assert again.container == spheres.container
    np.testing.assert_array_equal(again.position, spheres.position)
    np.testing.assert_array_equal(again.diameters, spheres.diameters)
    assert not {"container", "periodic"} & again.provenance["assumed"].keys()


def test_rows_of_one_number_are_a_clump_in_a_shape_pack(tmp_path):
    pack = read(tmp_path, "0 Sphere 0 0 0 1\n0 Sphere 1 0 0 1 # joined\n1u Sphere 5 0 0 1\n1u Sphere 9 0 0 1\n")
    assert pack.count == 3
    assert pack.volumes.tolist() == pytest.approx([2.25 * np.pi, 4 / 3 * np.pi, 4 / 3 * np.pi])


def rounded(tmp_path, more=1.7e-8):
    """Return the file of spheres that touch along a periodic cell, whose radii are larger by a share."""
    lattice = vg.Packing.of(
        vg.make_shape("sphere"), vg.Box((2, 3, 4), "xyz"), position=np.argwhere(np.ones((2, 3, 4))) + 0.125
    )
    rows = [f"{x} {y} {z} {0.5 * (1 + more)!r}\n" for x, y, z in lattice.position.tolist()]
    (tmp_path / "published.txt").write_text("##PERIODIC:: 2 3 4\n" + "".join(rows))
    return tmp_path / "published.txt"


def test_verify_says_how_much_smaller_the_spheres_of_a_jammed_packing_are_without_overlaps(tmp_path):
    path = rounded(tmp_path)
    found = vg.load(path).verify()
    assert found.overlapping_pairs == 3 * 24
    assert 1 - found.touching_at == pytest.approx(1.7e-8, rel=1e-6)
    assert "touching at 1 - 1.7e-08" in str(found)
    mended = vg.load(path, shrink=True)
    proof = mended.verify()
    assert proof.ok
    assert proof.touching_at == 1
    assert mended.diameters == pytest.approx(np.ones(24), rel=1e-9)
    assert mended.provenance["assumed"]["shrinking"].startswith("all sizes are multiplied by 1 - 1.7e-08")
    # what does not overlap is left as it is
    assert vg.load(rounded(tmp_path, more=-1e-12), shrink=True) == vg.load(tmp_path / "published.txt")


def test_clumps_and_spheres_beyond_walls_are_shrunk(tmp_path):
    text = "0 0 0 1 1\n1 0 0 1 1\n2.9 0.4 0 1 2\n3.9 0.4 0 1 2\n1 4.99 0 1 -1\n"
    (tmp_path / "p.txt").write_text(text)
    box = vg.Box((6, 8, 4), origin=(-0.999, -2, -2))
    loose = vg.load(tmp_path / "p.txt", container=box)
    assert 0.9 < loose.verify().touching_at < 1
    assert loose.verify().escaped == 1
    mended = vg.load(tmp_path / "p.txt", container=box, shrink=True)
    assert mended.verify().ok
    # not more than is needed
    wider = dataclasses.replace(mended, scale=mended.scale * 1.001)
    assert not wider.verify().ok


def test_deep_overlaps_and_files_of_voxgran_are_not_shrunk(tmp_path):
    with pytest.raises(InputError, match=r"published.txt, whose grains overlap still at 0\.8"):
        vg.load(rounded(tmp_path, more=0.2), shrink=True)
    with pytest.raises(InputError, match="shrink is 1: it must be True or False"):
        vg.load(rounded(tmp_path), shrink=1)
    vg.save(vg.load(rounded(tmp_path)), tmp_path / "own.vtp")
    with pytest.raises(InputError, match=r"shrink is given for .*own.vtp, which voxgran wrote: leave it out"):
        vg.load(tmp_path / "own.vtp", shrink=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("##PERIODIC:: 1 2\n0 0 0 1\n", r"line 1: '1 2' is not 3 numbers"),
        ("##PERIODIC:: 1 2 0\n0 0 0 1\n", r"a box of \[1.0, 2.0, 0.0\]"),
        ("0 Sphere 0 0 0 1\n1 Capsule 0 0 0 1 2 0 0\n", r"line 2: '1 Capsule .* only spheres and clumps"),
        ("0 Sphere 0 0 0 1\n1 Sphere 0 0 0 -1\n", r"sphere 1: x y z r is 0 0 0 -1"),
        ("0 Sphere 0 0 0 1\n1 Sphere 0 0 zero 1\n", r"line 2: '0 0 zero 1' is not 4 numbers"),
    ],
)
def test_packs_of_yade_and_woo_that_are_wrong(text, message, tmp_path):
    with pytest.raises(FileFormatError, match=message):
        read(tmp_path, text)


def cloud(n=50, seed=1):
    generator = stream(seed, "cloud")
    return generator.uniform(0, 10, (n, 3)), generator.uniform(0.1, 0.4, n)


@pytest.mark.parametrize("suffix", [".vtp", ".vtu"])
@pytest.mark.parametrize(("name", "factor"), [("radius", 1.0), ("Radii", 1.0), ("Diameter", 2.0)])
def test_points_with_sizes_of_any_program(suffix, name, factor, tmp_path):
    points, radii = cloud()
    data = pyvista.PolyData(points)
    data[name] = factor * radii
    if suffix == ".vtu":
        data = data.cast_to_unstructured_grid()
    data.save(tmp_path / f"p{suffix}")
    packing = vg.load(tmp_path / f"p{suffix}", unit="mm")
    np.testing.assert_allclose(packing.position, points, atol=1e-6)
    np.testing.assert_allclose(packing.diameters, 2 * radii, rtol=1e-6)
    assert name in packing.provenance["assumed"]["sizes"]
    assert vg.verify(packing).escaped == 0
    assert "count" in vg.measure(packing)


def test_points_without_sizes_and_files_that_are_cut_are_refused(tmp_path):
    points, radii = cloud()
    data = pyvista.PolyData(points)
    data["speed"] = radii
    data.save(tmp_path / "p.vtp")
    with pytest.raises(FileFormatError, match=r"points with speed: spheres need an array radius or diameter"):
        vg.load(tmp_path / "p.vtp")
    data["radius"] = np.where(radii == radii[7], -1.0, radii)
    data.save(tmp_path / "p.vtp")
    with pytest.raises(FileFormatError, match=r"point 7: .*r above 0"):
        vg.load(tmp_path / "p.vtp")
    whole = (tmp_path / "p.vtp").read_bytes()
    for share in (0.2, 0.6, 0.95):
        (tmp_path / "cut.vtu").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(FileFormatError):
            vg.load(tmp_path / "cut.vtu")
        (tmp_path / "cut.vtp").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(FileFormatError):
            vg.load(tmp_path / "cut.vtp")


def test_a_packing_that_paraview_saved_again_keeps_its_shapes(tmp_path):
    rock = vg.make_shape("solid_union", seed=2)
    packing = vg.Packing.of([rock], vg.Box((6, 3, 3)), position=[(1.5, 1.5, 1.5), (4.5, 1.5, 1.5)], unit="mm")
    vg.save(packing, tmp_path / "own.vtp")
    pyvista.read(tmp_path / "own.vtp").save(tmp_path / "again.vtp")
    again = vg.load(tmp_path / "again.vtp")
    assert again.shapes == packing.shapes
    assert again.unit == "mm"
    np.testing.assert_allclose(again.position, packing.position)
    assert "the seal is gone" in again.provenance["assumed"]["poses"]
    assert "assumed" not in vg.load(tmp_path / "own.vtp").provenance
    damaged = (tmp_path / "own.vtp").read_bytes()
    (tmp_path / "bad.vtp").write_bytes(damaged.replace(b"solid_fraction", b"solid_fractiom", 1))
    with pytest.raises(FileFormatError, match="damaged"):
        vg.load(tmp_path / "bad.vtp")
    with pytest.raises(InputError, match=r"unit is given for .* leave it out"):
        vg.load(tmp_path / "own.vtp", unit="cm")


def test_what_is_given_counts_and_what_does_not_fit_is_refused(tmp_path):
    text = "1 1 1 0.5\n2 1 1 0.5\n"
    cylinder = vg.Cylinder(3, 4)
    assert read(tmp_path, text, container=cylinder).container == cylinder
    with pytest.raises(InputError, match="periodic is 'x': a cylinder"):
        read(tmp_path, text, container=cylinder, periodic="x")
    with pytest.raises(InputError, match="periodic"):
        read(tmp_path, text, periodic="w")
    with pytest.raises(MissingFileError):
        vg.load(tmp_path / "none.dump")


def test_a_foreign_packing_is_checked_measured_and_shown(tmp_path):
    generator = stream(5, "foreign")
    lattice = np.array(np.meshgrid(*[np.arange(6) + 0.5] * 3)).reshape(3, -1).T
    rows = np.column_stack([lattice, np.full(len(lattice), 0.5)])[generator.permutation(len(lattice))]
    buffer = io.StringIO()
    np.savetxt(buffer, rows, delimiter=",", header="Points:0,Points:1,Points:2,Radius", comments="")
    packing = read(tmp_path, buffer.getvalue(), "paraview.csv", periodic="xyz")
    assert vg.verify(packing).ok
    tree = vg.measure(packing)
    assert float(tree["solid_fraction"]) == pytest.approx(np.pi / 6, rel=1e-12)
    assert (tree["/grains"].coordination_number == 6).all()
    vg.save_report(packing, tmp_path / "page.html", statistics=tree, verification=vg.verify(packing))
    assert "the box around the spheres" in (tmp_path / "page.html").read_text()


# two spheres at one place may be a clump, which a warning says
@pytest.mark.filterwarnings("ignore:.*spheres as a packing")
@given(
    rows=st.lists(st.lists(st.sampled_from(["1", "2.5", "nan", "-1", "x", "1e3", ";", "#"]), max_size=6), max_size=6)
)
def test_any_text_is_read_or_refused_in_one_line(rows, tmp_path_factory):
    path = tmp_path_factory.mktemp("text") / "p.txt"
    path.write_text("\n".join(" ".join(row) for row in rows))
    try:
        packing = vg.load(path)
    except InputError as error:
        message = str(error)
    else:
        message = ""
        assert packing.count > 0
        assert np.isfinite(packing.position).all()
    assert "\n" not in message
