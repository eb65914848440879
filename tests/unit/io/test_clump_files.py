"""Clumps in files: round trips to the last bit, forms of other programs, what is refused."""

import math

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, OutputExistsError, PackingWarning
from voxgran.clumps.model import Clump, ClumpErrors
from voxgran.shapes.formats.sphere_files import SUFFIXES

NAMES = ("iou", "iou_uncertainty", "volume", "centroid", "inertia", "surface_mean", "surface_max")
ROWS = "-0.5,0,0,1\n0.5,0,0,1\n"
LENS = math.pi * 5 / 12
MOLECULE = """# by hand

2 atoms
3.0 mass
0.25 0.0 0.0 com
0.3 0.8 0.8 0 0 0 inertia

Coords

2 0.5 0.0 0.0
1 -0.5 0.0 0.0

Types

1 1
2 1

Diameters

1 2.0 # first
2 2.0
"""


@pytest.fixture(scope="module")
def clump():
    generator = np.random.Generator(np.random.Philox(1))
    shape = vg.make_shape("ellipsoid", semi_axes=(1.0, 0.8, 0.6)).to_unit("mm").rotated([0.5, 0.5, 0.5, 0.5])
    skewed = shape.rotated(np.array([2, 1, 0, 1]) / math.sqrt(6))
    centers, radii = generator.normal(size=(7, 3)) / 3, generator.uniform(0.2, 0.5, 7)
    return Clump(centers, radii, skewed, ClumpErrors(**dict.fromkeys(NAMES, 0.0)))


def written(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("of", ["true", "spheres"])
def test_a_clump_reads_back_to_the_same_bits(clump, tmp_path, suffix, of):
    path = tmp_path / f"rock{suffix}"
    clump.save(path, mass_properties=of)
    shape = clump.to_shape(mass_properties=of)
    again = vg.load_shape(path)
    assert again == shape
    assert (again.name, again.unit) == ("rock", "mm")
    assert vg.load_shape(path, unit="cm").unit == "cm"
    assert (again.volume, again.inertia.tolist()) == (shape.volume, shape.inertia.tolist())
    with pytest.raises(OutputExistsError):
        clump.save(path)
    # a shape of spheres is written by the same door
    vg.save_shape(shape, path, overwrite=True)
    assert vg.load_shape(path) == shape


def test_molecules_have_masses_of_the_material(clump, tmp_path):
    clump.save(tmp_path / "rock.mol", density=2500.0)
    lines = (tmp_path / "rock.mol").read_text().splitlines()
    mass = float(next(line for line in lines if line.endswith(" mass")).split()[0])
    assert mass == pytest.approx(2500 * clump.shape.volume)
    start = lines.index("Masses") + 2
    assert sum(float(line.split()[1]) for line in lines[start:]) == pytest.approx(mass)
    moments = [float(word) for word in next(line for line in lines if line.endswith(" inertia")).split()[:6]]
    tensor = 2500 * clump.shape.inertia
    assert moments == pytest.approx([*tensor.diagonal(), tensor[0, 1], tensor[0, 2], tensor[1, 2]])
    assert vg.load_shape(tmp_path / "rock.mol") == clump.to_shape()
    with pytest.raises(InputError, match=r"density is 2500 .*only \.mol"):
        clump.save(tmp_path / "rock.csv", density=2500.0)
    with pytest.raises(FileFormatError, match=r"suffix '\.dat'"):
        clump.save(tmp_path / "rock.dat")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", "x,y,z,r\n" + ROWS),
        ("a.csv", ROWS),
        ("a.csv", "X [mm];Y [mm];Z [mm];Diameter;colour\n-0.5;0;0;2;1\n0.5;0;0;2;2\n"),
        ("a.csv", "-0,5;0;0;1\n0,5;0;0;1\n"),
        ("a.csv", "# of CLUMP\n" + ROWS.replace("\n", "e0\r\n")),
        ("a.csv", "x,y,z,r\n" + ROWS + "# volume = 5.5886717\n# Ixx, yy, zz = 1.8327927, 2.1580013, 0.77010059\n"),
        ("a.txt", ROWS.replace(",", " ")),
        ("a.txt", "#format x_y_z_r_clumpId\n-0.5 0 0 1 3\n0.5\t0 0 1 3\n"),
        ("a.xyzr", "\ufeff-0.5 0 0 1\n\n0.5 0 0 1 # the second\n"),
    ],
)
def test_files_of_other_programs_are_the_union_of_their_spheres(tmp_path, name, text):
    shape = vg.load_shape(written(tmp_path / name, text))
    assert shape.volume == pytest.approx(8 / 3 * math.pi - LENS)
    assert shape.geometry.centers.tolist() == [[-0.5, 0, 0], [0.5, 0, 0]]
    assert shape.geometry.mass is None


def test_a_shape_has_its_origin_at_the_centroid(tmp_path):
    shape = vg.load_shape(written(tmp_path / "a.csv", "1,2,3,1\n2,2,3,1\n"))
    assert shape.offset == pytest.approx((1.5, 2, 3))
    assert shape.geometry.centers == pytest.approx(np.array([[-0.5, 0, 0], [0.5, 0, 0]]))


def test_a_molecule_of_another_program_has_its_center_of_mass_and_its_inertia_over_mass(tmp_path):
    shape = vg.load_shape(written(tmp_path / "a.mol", MOLECULE))
    volume = 8 / 3 * math.pi - LENS
    assert shape.volume == pytest.approx(volume)
    assert shape.geometry.centers[:, 0].tolist() == [-0.75, 0.25]
    assert shape.inertia == pytest.approx(np.diag([0.1, 0.8 / 3, 0.8 / 3]) * volume)
    bare = "\n".join(line for line in MOLECULE.splitlines() if not line.endswith(("mass", "com", "inertia")))
    assert vg.load_shape(written(tmp_path / "b.txt", bare)).geometry.mass is None


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "", "holds no sphere"),
        ("a.csv", "x,y,z,r\n", "holds no sphere"),
        ("a.csv", "x,y,r\n1,1,1\n", "line 1: .* does not name the columns x, y, z and r"),
        ("a.csv", "x,y,z,r,d\n1,1,1,1,1\n", "does not name the columns"),
        ("a.csv", ROWS + "1,2,3\n", "line 3: .* has 3 values, the first line 4"),
        ("a.csv", "1,2,3,4,5,6\n", "line 1: .* has 6 values"),
        ("a.csv", '"\n', "does not name the columns"),
        ("a.csv", ROWS + "1,2,a,1\n", "line 3: .* is no x y z r"),
        ("a.csv", ROWS + "1,2,nan,1\n", "line 3: .* all finite"),
        ("a.csv", ROWS + "1,2,0,-1\n", "line 3: .* radii from 1e-60"),
        ("a.csv", ROWS + "# volume = much\n", "line 3: 'much' is no volume of 1 numbers"),
        ("a.csv", ROWS + "# volume = 1 2\n", "no volume of 1 numbers"),
        ("a.csv", ROWS + "# volume = 1\n# centroid = 0 0 0\n# inertia = 1 1 9 0 0 0\n", "sum of the other two"),
        ("a.txt", "0 0 0 1 0\n1 0 0 1 0\n5 0 0 1 7\n6 0 0 1 7\n", r"holds 2 clumps \(0, 7\).*vg.load"),
        ("a.txt", '# container {"kind": "box"}\n0 0 0 1\n', "line 1: .* a packing: read it with vg.load"),
        ("a.txt", "0 0 0 1\n" * 20_001, "more than 20000 spheres"),
        ("a.mol", MOLECULE.replace("2 atoms", "3 atoms"), "2 lines in the section Coords for 3 atoms"),
        ("a.mol", MOLECULE.replace("Diameters", "Radii"), "0 lines in the section Diameters"),
        ("a.mol", MOLECULE.replace("2 2.0", "3 2.0"), "Diameters of different atoms"),
        ("a.mol", MOLECULE.replace("2 0.5 0.0 0.0", "2.5 0.5 0 0"), "number of an atom"),
        ("a.mol", MOLECULE.replace("0.25 0.0 0.0 com", "0.25 0.0 com"), "no 3 numbers of com"),
        ("a.mol", MOLECULE.replace("3.0 mass", "0.0 mass"), "mass is 0"),
    ],
)
def test_damaged_files_are_refused(tmp_path, name, text, message):
    with pytest.raises(FileFormatError, match=message):
        vg.load_shape(written(tmp_path / name, text))


def test_what_is_no_clump_is_refused(tmp_path):
    path = written(tmp_path / "a.csv", ROWS)
    with pytest.raises(InputError, match=r"repair is true .*holds spheres"):
        vg.load_shape(path, repair=True)
    with pytest.raises(InputError, match="surface is true"):
        vg.load_shape(path, surface=True)
    with pytest.raises(InputError, match=r"'box' is a box: clump files hold spheres.*fit_clump"):
        vg.save_shape(vg.shapes.box(), tmp_path / "b.csv")
    (tmp_path / "c.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="is no text"):
        vg.load_shape(tmp_path / "c.csv")


def test_a_packing_of_spheres_that_are_a_clump_is_warned_of(clump, tmp_path):
    clump.save(tmp_path / "rock.csv")
    with pytest.warns(PackingWarning, match=r"7 spheres as a packing, of which \d overlap others .*load_shape"):
        assert vg.load(tmp_path / "rock.csv").count == 7
    clump.save(tmp_path / "rock.mol")
    with pytest.raises(FileFormatError, match="is a molecule and no packing"):
        vg.load(tmp_path / "rock.mol")
    # lines of YADE say that they are a clump: a packing of one grain
    clump.save(tmp_path / "rock.txt")
    assert vg.load(tmp_path / "rock.txt").count == 1


def test_spheres_are_written_as_a_clump(tmp_path):
    vg.save_shape(vg.shapes.sphere(radius=2.0), tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text() == "x,y,z,r\n0.0,0.0,0.0,2.0\n"
    assert vg.load_shape(tmp_path / "a.csv").is_sphere
