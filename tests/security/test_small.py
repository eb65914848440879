"""Small faults of input and of the system, each of which is one sentence."""

import errno
import os
import resource
import subprocess
import sys

import numpy as np
import pytest
from scipy import ndimage

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, OutputError, PackingWarning
from voxgran._base.files import written_whole

BED = vg.Packing.of([vg.shapes.sphere()], vg.Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)])


@pytest.mark.parametrize(
    ("function", "options"),
    [
        (type, {}),
        (int, {}),
        (np.ndarray.reshape, {}),
        (ndimage.median_filter, {"sizes": 3}),
        (ndimage.median_filter, {}),
    ],
)
def test_functions_that_are_no_filters_are_refused(function, options):
    with pytest.raises(InputError, match=r"function (is|returns) .*; give one|: a filter returns as many; give one"):
        vg.filter_image(np.zeros((5, 5, 5)), function, **options)


@pytest.mark.parametrize("name", ["link.vtp", "folder/deeper/bed.vtp"])
def test_no_folder_is_made_at_the_end_of_a_link(name, tmp_path):
    path = tmp_path / name
    link = path if name == "link.vtp" else tmp_path / "folder"
    link.symlink_to(tmp_path / "none" / "there" / "bed.vtp")
    with pytest.raises(OutputError, match=r"is a link to .*, which is not there: make its folder"):
        vg.save(BED, path)
    assert [found.name for found in tmp_path.iterdir()] == [link.name]


def test_a_file_is_made_at_the_end_of_a_link(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link.vtp").symlink_to(tmp_path / "there" / "bed.vtp")
    vg.save(BED, tmp_path / "link.vtp")
    assert vg.load(tmp_path / "there" / "bed.vtp").count == 2
    assert (tmp_path / "link.vtp").is_symlink()
    with written_whole(tmp_path / "new" / "a.txt") as draft:
        draft.write_text("a")
    assert (tmp_path / "new" / "a.txt").exists()


def test_a_full_disk_is_said_of_netcdf(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    rocks = vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=12))
    statistics = vg.measure(BED, which="coordination")
    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    for save in (rocks.save, lambda path: vg.save_statistics(statistics, path)):
        with pytest.raises(OutputError, match=r"a\.nc cannot be written \(No space left on device\)"):
            save(tmp_path / "a.nc")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["passing (%)", "percent passing"])
def test_shares_in_a_column_of_percent_are_said(name):
    table = {"opening": [1.0, 2.0, 4.0], name: [0.0, 0.4, 1.0]}
    with pytest.warns(PackingWarning, match=r"up to 1: these are taken as shares and not as percent"):
        shares = vg.sizes.sieve(table)
    assert shares.passing == (0.0, 0.4, 1.0)
    assert vg.sizes.sieve({**table, name: [0.0, 40.0, 100.0]}).passing == pytest.approx((0.0, 0.4, 1.0))


@pytest.mark.parametrize("far", [1e5, 1e21, 1e59])
def test_a_clump_of_spheres_that_are_far_from_each_other_is_refused(far, tmp_path):
    (tmp_path / "a.csv").write_text(f"x,y,z,r\n0,0,0,1\n{far},0,0,1\n")
    with pytest.raises(
        FileFormatError, match=r"apart and the largest radius is 1: a union is at most 10000 radii long"
    ):
        vg.load_shape(tmp_path / "a.csv")


SCENE = """
[[shape]]
family = "sphere"
[container]
kind = "box"
lengths = [4, 4, 4]
[packing]
method = "rsa"
count = 3
"""


@pytest.mark.parametrize("megabytes", [160, 200, 240])
def test_too_little_memory_is_one_sentence(megabytes, tmp_path):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (megabytes * 2**20,) * 2)

    (tmp_path / "scene.toml").write_text(SCENE)
    once = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    words = [sys.executable, "-m", "voxgran", "plan", str(tmp_path / "scene.toml")]
    done = subprocess.run(
        words, preexec_fn=limit, env={**os.environ, **once}, capture_output=True, text=True, check=False
    )
    assert "Traceback" not in done.stderr
    # versions of libraries differ in what they need
    assert done.returncode == 0 or "memory" in done.stderr.splitlines()[-1].lower()
