"""Files of point clouds, and packings as point clouds."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, MissingFileError, MissingLibraryError, OutputExistsError
from voxgran._base.seeds import stream
from voxgran.cli import main
from voxgran.geometry.rotation import random_rotations
from voxgran.points.cloud import Cloud

PLY = (
    "ply\nformat ascii 1.0\nelement vertex {1}\nproperty {0} x\nproperty double y\nproperty double z\nend_header\n"
    "1 2 3\n4 5 6\n"
)
PCD = (
    "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {0}\nHEIGHT 1\nPOINTS {0}\nDATA ascii\n"
    "1 2 3\n4 5 6\n"
)
POINTS = stream(1, "points").normal(size=(60, 3)) * 1e3


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".xyz"])
@pytest.mark.parametrize("whole", [False, True])
def test_what_is_written_comes_back_to_the_bit(tmp_path, suffix, whole):
    cloud = Cloud.of(POINTS, POINTS, np.arange(60) // 7) if whole else Cloud.of(POINTS)
    path = tmp_path / f"scan{suffix}"
    vg.save_cloud(cloud, path)
    found = vg.load_cloud(path, unit="mm")
    assert found.points.tobytes() == cloud.points.tobytes()
    assert (found.name, found.unit) == ("scan", "mm")
    if whole:
        assert found.normals == pytest.approx(cloud.normals, abs=1e-15)
        assert found.grain.tolist() == cloud.grain.tolist()
    else:
        assert found.normals is None
        assert found.grain is None


def test_tables_with_a_head_and_commas_are_read(tmp_path):
    path = tmp_path / "scan.csv"
    path.write_text("# of a laser\nX,Y,Z\n1,2,3\n4, 5, 6\n\n")
    assert vg.load_cloud(path).points.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("text", "points", "grain"),
    [
        ("\ufeff1,2,3\n4,5,6\n", [[1, 2, 3], [4, 5, 6]], None),
        ("z;y;x\n3;2;1\n", [[1, 2, 3]], None),
        ("x;y;z\n1,5;2,0;3\n", [[1.5, 2, 3]], None),
        ("1,5\t2\t3\n", [[1.5, 2, 3]], None),
        ('"id","x","y","z"\n"7","1","2","3"\n', [[1, 2, 3]], None),
        ("x\ty\tz\tintensity\tlabel\r\n1\t2\t3\t0.5\t8\r\n", [[1, 2, 3]], [8]),
        ("1 2 3 8\n4 5 6 9\n", [[1, 2, 3], [4, 5, 6]], [8, 9]),
    ],
)
def test_columns_are_those_that_are_named(tmp_path, text, points, grain):
    path = tmp_path / "scan.csv"
    path.write_bytes(text.encode())
    found = vg.load_cloud(path)
    assert found.points.tolist() == points
    assert found.normals is None
    assert (found.grain is None) if grain is None else (found.grain.tolist() == grain)


def test_mixed_types_are_read(tmp_path):
    path = tmp_path / "scan.PLY"
    path.write_text(PLY.format("float", 2))
    assert vg.load_cloud(path).points.tolist() == [[1, 2, 3], [4, 5, 6]]
    path = tmp_path / "scan.pcd"
    path.write_text(PCD.format(2))
    assert vg.load_cloud(path).points.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_a_cut_file_is_refused(tmp_path, capfd, suffix):
    path = tmp_path / f"scan{suffix}"
    vg.save_cloud(Cloud.of(POINTS), path)
    path.write_bytes(path.read_bytes()[:900])
    with pytest.raises(FileFormatError, match="cut or damaged"):
        vg.load_cloud(path)
    assert capfd.readouterr() == ("", "")


def test_rays_that_met_nothing_are_left_out_of_pcd_files(tmp_path, caplog):
    path = tmp_path / "scan.pcd"
    path.write_text(PCD.format(3).replace("1 2 3\n", "nan nan nan\n1 2 3\n"), encoding="ascii")
    assert np.array_equal(vg.load_cloud(path).points, [[1, 2, 3], [4, 5, 6]])
    assert "1 of 3 points are NaN" in caplog.text


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.xyz", "1 2 3\n4 5\n", "no table of numbers"),
        ("a.xyz", "1 2 3\n4 5 x\n", "no table of numbers"),
        ("a.xyz", "1 2\n3 4\n", "2 columns without names"),
        ("a.xyz", "1 2 nan\n3 4 5\n", "finite"),
        ("a.xyz", "", "holds no points"),
        ("a.xyz", "0,5 1,5 2,5\n", "no table of numbers"),
        ("a.csv", "1,,2,3\n", "no table of numbers"),
        ("a.csv", "O.5,1,2\n0,1,2\n", "no table of numbers: row 1"),
        ("a.xyz", "0 0 1 0.53\n0 1 0 0.2\n", "4 columns without names"),
        ("a.xyz", "0 0 1 255 0 0\n0 1 0 0 255 0\n", "6 columns without names"),
        ("a.csv", "id,x,y\n1,2,3\n", "no table of numbers: row 1"),
        ("a.ply", "ply\nformat ascii 1.0\nelement vert", "cannot be read as PLY"),
        ("a.ply", "ply\nformat ascii 1.0\nelement face 0\nend_header\n", "cannot be read as PLY"),
        ("a.ply", PLY.format("float", 4), "cannot be read as PLY"),
        ("a.ply", PLY.format("float", 400_000_000), "cannot be read as PLY"),
        ("a.pcd", "", "cannot be read as PCD"),
        ("a.pcd", PCD.format(3), r"holds 2 of 3 points"),
        ("a.pcd", PCD.format(2).replace("ascii", "binary_compressed"), "compressed; write it as binary"),
        ("a.pcd", PCD.format(2).replace("x y z", "u v w"), "x, y and z are needed"),
        ("a.stl", "solid", "ends in '.stl'"),
    ],
)
def test_damaged_files_are_refused(tmp_path, capfd, name, text, words):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(FileFormatError, match=words):
        vg.load_cloud(path)
    assert capfd.readouterr().out == ""


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(MissingFileError):
        vg.load_cloud(tmp_path / "none.ply")


def test_laser_files_need_laspy(tmp_path):
    pytest.importorskip("open3d")
    path = tmp_path / "scan.las"
    path.write_bytes(b"LASF")
    with pytest.raises((MissingLibraryError, FileFormatError), match=r"laspy|cannot be read"):
        vg.load_cloud(path)


def test_a_file_that_was_there_stays(tmp_path):
    path = tmp_path / "scan.ply"
    path.write_text("mine")
    with pytest.raises(OutputExistsError):
        vg.save_cloud(Cloud.of(POINTS), path)
    with pytest.raises(InputError, match=r"ends in '\.vtp'"):
        vg.save_cloud(Cloud.of(POINTS), tmp_path / "scan.vtp")
    with pytest.raises(InputError, match="for packings"):
        vg.save_cloud(Cloud.of(POINTS), path, spacing=1.0)
    with pytest.raises(InputError, match="has no points"):
        vg.save_cloud(Cloud.of(np.zeros((0, 3))), path)
    with pytest.raises(InputError, match="grain is 1099511627776"):
        vg.save_cloud(Cloud.of(POINTS, grain=np.full(60, 2**40)), path)
    assert path.read_text() == "mine"


def test_a_packing_becomes_points_that_know_their_grain(tmp_path):
    shapes = [vg.make_shape("sphere"), vg.make_shape("box", lengths=(1.0, 0.8, 0.6))]
    packing = vg.Packing.of(
        shapes, vg.Box((9, 9, 9)), position=[[2, 2, 2], [5, 5, 5], [2, 6, 2]], scale=[1.0, 1.5, 0.5],
        shape_id=[0, 1, 0], orientation=random_rotations(stream(2, "turns"), 3),
    )  # fmt: skip
    path = tmp_path / "packing.ply"
    vg.save_cloud(packing, path, spacing=0.2)
    cloud = vg.load_cloud(path)
    assert np.unique(cloud.grain).tolist() == [0, 1, 2]
    for grain, radius in ((0, 0.5), (2, 0.25)):
        far = np.linalg.norm(cloud.points[cloud.grain == grain] - packing.position[grain], axis=1)
        assert far == pytest.approx(radius, rel=1e-9)
    # and back: each grain has its volume again
    box = vg.shape_of_cloud(cloud.chosen(cloud.grain == 1), method="alpha")
    assert box.shape.volume == pytest.approx(1.5**3 * 0.48, rel=0.1)
    assert [len(body) for body in cloud.clusters()] == sorted(np.bincount(cloud.grain).tolist(), reverse=True)


def test_the_command_makes_a_surface(tmp_path, capsys):
    points = stream(3, "sphere").normal(size=(3000, 3))
    scan, out = tmp_path / "scan.xyz", tmp_path / "rock.stl"
    vg.save_cloud(Cloud.of(points / np.linalg.norm(points, axis=1)[:, None]), scan)
    assert main(["cloud", str(scan), "-o", str(out), "--outliers", "4"]) == 0
    assert "mean residual" in capsys.readouterr().out
    assert vg.load_shape(out).volume == pytest.approx(4 / 3 * np.pi, rel=0.01)
    assert main(["cloud", str(scan), "-o", str(out), "--max-gap", "0.1", "--overwrite"]) == 2
    assert "too sparse to close" in capsys.readouterr().err
