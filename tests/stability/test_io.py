"""Files under attack: cut off, bits turned over, no space left; nothing is lost and one sentence says what happened."""

import errno
import subprocess
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from voxgran._base.errors import FileFormatError, OutputError, VoxgranError
from voxgran._base.seeds import stream
from voxgran.containers.box import Box
from voxgran.io.files import load, save
from voxgran.io.image import save_image
from voxgran.io.netcdf import save_statistics
from voxgran.io.vtk_files import save_scene
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.tessellate import sphere


def packing_of(count):
    vertices, faces, _ = sphere(2)
    shapes = [Shape.of(Primitive("sphere", (0.5,)), name="sphere"), Shape.from_mesh(vertices, faces)]
    generator = stream(1, "positions")
    shape_id = np.arange(count) % 2
    return Packing.of(shapes, Box((9, 9, 9)), position=9 * generator.random((count, 3)), shape_id=shape_id)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "p.vtp"
    save(packing_of(20), path)
    return path.read_bytes()


def assert_refused(path, content, capfd):
    path.write_bytes(content)
    with pytest.raises(FileFormatError) as caught:
        load(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_file_cut_off_anywhere_is_refused(whole, tmp_path, capfd):
    # without its seal, and with nothing else missing, it is a file that another program wrote
    end = whole.index(b"</VTKFile>") + len(b"</VTKFile>")
    places = {0, 1, 50, *range(0, len(whole), 97), *range(len(whole) - 90, len(whole))} - {end, end + 1}
    for place in places:
        assert_refused(tmp_path / "p.vtp", whole[:place], capfd)


def test_a_bit_turned_over_anywhere_is_refused(whole, tmp_path, capfd):
    for place in stream(0, "bits").integers(0, 8 * len(whole), 300):
        damaged = bytearray(whole)
        damaged[place // 8] ^= 1 << (place % 8)
        assert_refused(tmp_path / "p.vtp", bytes(damaged), capfd)


def test_bytes_too_many_are_refused(whole, tmp_path, capfd):
    assert_refused(tmp_path / "p.vtp", whole + b"\n", capfd)
    assert_refused(tmp_path / "p.vtp", b"\n" + whole, capfd)
    assert_refused(tmp_path / "p.vtp", whole + whole, capfd)


@pytest.fixture
def small_disk(tmp_path):
    """Return a folder on a file system of 64 kB."""
    folder = tmp_path / "small"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    try:
        mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("a small disk can only be mounted by root")
    yield folder
    # lazily, because a failed writer may be kept open by the traceback
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def writers():
    """Return what writes more than 64 kB of a large packing, by suffix."""
    xarray = pytest.importorskip("xarray")
    noise = stream(2, "noise").random(60_000)
    return {
        "p.vtp": partial(save, overwrite=True),
        "p.txt": partial(save, overwrite=True),
        "s.vtm": partial(save_scene, overwrite=True),
        "i.vti": lambda p, path: save_image(noise.reshape(60, 100, 10), path, voxel_size=1.0, overwrite=True),
        "s.nc": lambda p, path: save_statistics(
            xarray.DataTree(xarray.Dataset({"x": ("n", noise)})), path, overwrite=True
        ),
    }


@pytest.mark.parametrize("name", ["p.vtp", "p.txt", "s.vtm", "i.vti", "s.nc"])
def test_a_full_disk_leaves_what_was_there(name, small_disk, capfd):
    path = small_disk / name
    path.write_bytes(b"before")
    large = packing_of(4000)
    large = Packing.of(large.shapes[:1], large.container, position=large.position)
    with pytest.raises(OutputError, match="free space or choose another place") as caught:
        writers()[name](large, path)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == b"before"
    assert [found.name for found in small_disk.iterdir()] == [name]
    assert capfd.readouterr().err == ""


def test_a_write_that_fails_leaves_what_was_there(tmp_path, monkeypatch):
    packing, path = packing_of(4), tmp_path / "p.txt"
    save(Packing.of(packing.shapes[:1], packing.container, position=packing.position), path)
    before = path.read_bytes()

    def full(self, *arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(OutputError, match="No space left on device"):
        save(Packing.of(packing.shapes[:1], packing.container, position=[]), path, overwrite=True)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert [found.name for found in tmp_path.iterdir()] == ["p.txt"]


def test_a_folder_that_is_a_file_is_named(tmp_path):
    (tmp_path / "a").write_text("")
    packing = packing_of(1)
    for name in ("p.vtp", "p.csv"):
        with pytest.raises(VoxgranError, match="cannot be written"):
            save(packing, tmp_path / "a" / name)
