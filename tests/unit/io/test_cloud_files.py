"""Files of point clouds, and packings as point clouds."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, MissingFileError, MissingLibraryError, OutputExistsError
from voxgran._base.rotation import random_rotations
from voxgran._base.seeds import stream
from voxgran.cli.main import main
from voxgran.points.cloud import Cloud

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
    path.write_text("# of a laser\nx,y,z\n1,2,3\n4, 5, 6\n\n")
    assert vg.load_cloud(path).points.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.xyz", "1 2 3\n4 5\n", "no table of numbers"),
        ("a.xyz", "1 2 3\n4 5 x\n", "no table of numbers"),
        ("a.xyz", "1 2\n3 4\n", "2 columns"),
        ("a.xyz", "1 2 nan\n3 4 5\n", "finite"),
        ("a.xyz", "", "holds no points"),
        ("a.ply", "ply\nformat ascii 1.0\nelement vert", "holds no points|cannot be read"),
        ("a.pcd", "", "holds no points|cannot be read"),
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
        vg.save_cloud(Cloud.of(POINTS), path, overwrite=False)
    with pytest.raises(InputError, match=r"ends in '\.vtp'"):
        vg.save_cloud(Cloud.of(POINTS), tmp_path / "scan.vtp")
    with pytest.raises(InputError, match="for packings"):
        vg.save_cloud(Cloud.of(POINTS), path, spacing=1.0)
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
    assert main(["cloud", str(scan), "-o", str(out), "--largest-hole", "0.1"]) == 2
    assert "too sparse to close" in capsys.readouterr().err
