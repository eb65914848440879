"""Files under attack: cut off, bits turned over, no space left; nothing is lost and one sentence says what happened."""

import contextlib
import errno
import gc
import os
import resource
import subprocess
import tempfile
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.checkpoint import save_checkpoint
from voxgran._base.errors import FileFormatError, OutputError, VoxgranError
from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.decks.relax import save_history
from voxgran.io.files import load, save
from voxgran.io.image import save_image
from voxgran.io.netcdf import save_statistics
from voxgran.io.vtk_files import save_scene
from voxgran.packing.model import Packing
from voxgran.shapes.formats.mesh_files import WRITERS as MESHES
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import sphere
from voxgran.study.page import write_study_page
from voxgran.study.result import save_results

pytestmark = pytest.mark.usefixtures("jagged_pictures")

CLOUDS = (".ply", ".pcd", ".xyz")


def packing_of(count):
    vertices, faces, _ = sphere(2)
    shapes = [Shape.of(Primitive("sphere", (0.5,)), name="sphere"), Shape.from_mesh(vertices, faces)]
    generator = stream(1, "positions")
    shape_id = np.arange(count) % 2
    return Packing.of(shapes, Box((9, 9, 9)), position=9 * generator.random((count, 3)), shape_id=shape_id)


@pytest.fixture(scope="module", autouse=True)
def frozen():
    """Let `gc.collect` look at what these tests make, and at nothing that was there before, which takes a second."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


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


@pytest.fixture(scope="module")
def small_disk(tmp_path_factory):
    """Return a folder on a file system of 4 MB."""
    folder = tmp_path_factory.mktemp("small")
    command = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(folder)]
    try:
        mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("a small disk can only be mounted by root")
    yield folder
    # lazily, because a failed writer may be kept open by the traceback
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


@contextlib.contextmanager
def filled(disk, left):
    """Leave so many bytes on a disk (context manager)."""
    with (disk / "filler").open("wb") as file:
        about = os.statvfs(disk)
        os.posix_fallocate(file.fileno(), 0, about.f_bavail * about.f_bsize - left)
    try:
        yield
    finally:
        (disk / "filler").unlink()


@contextlib.contextmanager
def short_files(most):
    """Let no file grow beyond so many bytes (context manager)."""
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))


BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
BALLS = Packing.of([BALL], Box((9, 9, 9)), position=9 * stream(1, "positions").random((500, 3)))
FEW = packing_of(8)
NOISE = stream(2, "noise").random(30_000)
ROCK = packing_of(2).shapes[1]


def dataset():
    """Return a dataset of noise."""
    return pytest.importorskip("xarray").Dataset({"x": ("n", NOISE)})


WRITERS = {
    "p.vtp": partial(save, BALLS, overwrite=True),
    "p.txt": partial(save, BALLS, overwrite=True),
    "p.csv": partial(save, BALLS, overwrite=True),
    "s.vtm": partial(save_scene, FEW, overwrite=True),
    "i.vti": partial(save_image, NOISE.reshape(30, 100, 10), voxel_size=1.0, overwrite=True),
    "i.tif": partial(save_image, NOISE.reshape(30, 100, 10), voxel_size=1.0, overwrite=True),
    "s.nc": lambda path: save_statistics(vg.measure(BALLS, which=["coordination"]), path, overwrite=True),
    "h.nc": lambda path: save_history(dataset(), path, overwrite=True),
    **{f"c{suffix}": partial(vg.save_cloud, vg.Cloud(NOISE.reshape(-1, 3)), overwrite=True) for suffix in CLOUDS},
    **{f"grain{suffix}": partial(vg.save_shape, ROCK, overwrite=True) for suffix in MESHES},
    "clump.csv": partial(vg.save_shape, Shape(Spheres(NOISE[:900].reshape(-1, 3), NOISE[900:1200])), overwrite=True),
    "soft.vtp": lambda path: vg.save_deformed(vg.deform(FEW, spacing=0.3), path, overwrite=True),
    "mask.npy": lambda path: vg.voxelize(BALL, voxel_size=0.02, out=path, overwrite=True),
    "check.voxgran": lambda path: save_checkpoint(path, {"done": 1}, {"x": NOISE}),
    "page.html": partial(vg.save_report, FEW, pictures=False, overwrite=True),
    "both.html": lambda path: vg.save_comparison(
        {"a": FEW, "b": FEW}, path, which=["gradation"], pictures=False, overwrite=True
    ),
    "turn.gif": partial(vg.save_turntable, FEW, frames=2, window=(60, 60), overwrite=True),
    "picture.png": partial(vg.save_picture, FEW, window=(60, 60), overwrite=True),
    "deck": partial(vg.write_deck, BALLS, engine="lammps", material=vg.Material(density=2500), overwrite=True),
    "study": lambda path: save_results(dataset(), [{"x": 1.0}] * 1000, path, zarr=False),
    "study_page": lambda path: write_study_page(study_data(), path, overwrite=True),
}


def study_data():
    """Return the dataset of a study."""
    numbers = {"solid_fraction": (("method", "seed"), [[0.5, 0.52, 0.54], [0.6, 0.61, 0.62]])}
    return pytest.importorskip("xarray").Dataset(numbers, {"method": ["rsa", "jam"]})


def contents(folder):
    """Return the bytes of all files of a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@cache
def written(name):
    """Return what a writer writes where there is room: the bytes of all files."""
    with tempfile.TemporaryDirectory() as folder:
        WRITERS[name](Path(folder) / name)
        return contents(Path(folder))


@pytest.mark.parametrize("new", [False, True])
@pytest.mark.parametrize("full", ["disk", "limit"])
@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.filterwarnings("ignore")
def test_a_full_disk_leaves_what_was_there(name, full, new, request, tmp_path, capfd):
    place, files = tmp_path / "place", written(name)
    if full == "disk":
        place = Path(tempfile.mkdtemp(dir=request.getfixturevalue("small_disk"))) / "inner"
    for file in () if new else files:
        (place / file).parent.mkdir(parents=True, exist_ok=True)
        # what is cut is still known as what voxgran wrote
        (place / file).write_bytes(files[file][:200])
    before = contents(place)
    # half of what is written, in pages
    half = sum(-(-len(content) // 4096) for content in files.values()) // 2 * 4096
    capfd.readouterr()
    # a writer that has failed before may hold its draft open
    gc.collect()
    too_small = short_files(max(map(len, files.values())) // 2) if full == "limit" else filled(place.parents[1], half)
    room = os.statvfs(place.parents[1]).f_bfree
    with too_small, pytest.raises(OutputError, match="free space or choose another place") as caught:
        WRITERS[name](place / name)
    assert full == "limit" or os.statvfs(place.parents[1]).f_bfree == room
    assert "\n" not in str(caught.value)
    assert contents(place) == before
    assert place.exists() is not new
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("left", [0, 4096])
def test_a_study_on_a_full_disk_leaves_no_empty_folder(left, small_disk):
    """The disk has no room for its lock, for the mark of its checkpoints, or for the first run."""
    place = Path(tempfile.mkdtemp(dir=small_disk)) / "study"
    scene = {
        "shape": [{"family": "sphere"}],
        "container": {"kind": "box", "lengths": [4, 4, 4]},
        "packing": {"method": "rsa", "count": 2},
    }
    with filled(small_disk, left), pytest.raises(OutputError, match="No space left on device"):
        vg.Study(base=scene, axes={"packing.count": [1, 2]}, seeds=1).run(place)
    assert list(place.rglob("*")) == []
    assert place.exists() is (left > 0)


def test_a_full_disk_leaves_the_snapshots_before(tmp_path):
    series = vg.Series(tmp_path / "run.pvd", max_snapshots=2, every=10)
    series.record(BALLS, 10)
    before, times = contents(tmp_path), series.times
    for most in (1000, 10_000):
        with short_files(most), pytest.raises(OutputError):
            series.record(BALLS, 20)
        assert contents(tmp_path) == before
        assert (series.times, series.every) == (times, 10)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vg.Series, "_list", refuse)
        for done in (10, 20):
            with pytest.raises(OutputError):
                series.record(BALLS, done)
            assert contents(tmp_path) == before


def refuse(self):
    """Write nothing."""
    raise OutputError("the disk is full")


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
