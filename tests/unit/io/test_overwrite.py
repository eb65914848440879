"""What is there is not replaced unasked, whoever writes."""

import inspect

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, OutputExistsError

pytestmark = pytest.mark.usefixtures("jagged_pictures")

BALL = vg.make_shape("sphere")
PACKING = vg.Packing.of([BALL], vg.Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)])
SAVERS = {
    "packing.vtp": lambda path, **how: vg.save(PACKING, path, **how),
    "packing.txt": lambda path, **how: vg.save(PACKING, path, **how),
    "packing.csv": lambda path, **how: vg.save(PACKING, path, **how),
    "points.ply": lambda path, **how: vg.save_cloud(PACKING, path, spacing=0.5, **how),
    "soft.vtp": lambda path, **how: vg.save_deformed(vg.deform(PACKING, spacing=0.3), path, **how),
    "image.vti": lambda path, **how: vg.save_image(np.zeros((2, 2, 2)), path, voxel_size=1.0, **how),
    "scene.vtm": lambda path, **how: vg.save_scene(PACKING, path, **how),
    "grain.stl": lambda path, **how: vg.save_shape(BALL, path, **how),
    "numbers.nc": lambda path, **how: vg.save_statistics(vg.measure(PACKING, which=["gradation"]), path, **how),
    "turn.gif": lambda path, **how: vg.save_turntable(PACKING, path, frames=1, window=(60, 60), **how),
    "page.html": lambda path, **how: vg.save_report(PACKING, path, pictures=False, **how),
    "both.html": lambda path, **how: vg.save_comparison(
        {"a": PACKING, "b": PACKING}, path, which=["gradation"], pictures=False, **how
    ),
    "series.pvd": lambda path, **how: vg.Series(path, **how).record(PACKING, 1000),
    "mask.npy": lambda path, **how: vg.voxelize(BALL, voxel_size=0.5, out=path, **how),
}


@pytest.mark.parametrize("name", SAVERS)
def test_what_is_there_stays_until_told(name, tmp_path):
    path, save = tmp_path / name, SAVERS[name]
    path.write_text("before")
    with pytest.raises(OutputExistsError, match="give overwrite=True, at the prompt --overwrite"):
        save(path)
    assert path.read_text() == "before"
    assert [one.name for one in tmp_path.iterdir()] == [name]
    save(path, overwrite=True)
    assert path.read_bytes() != b"before"


@pytest.mark.parametrize("name", SAVERS)
def test_what_a_suffix_says_is_what_the_file_holds(name, tmp_path):
    with pytest.raises(InputError, match=r"page\.pdf"):
        SAVERS[name](tmp_path / "page.pdf")
    assert not list(tmp_path.iterdir())


def test_every_saver_takes_the_wish():
    savers = [name for name in vg.__all__ if name.startswith(("save", "write_"))]
    assert len(savers) >= 9
    for name in [*savers, "Series", "voxelize"]:
        assert inspect.signature(getattr(vg, name)).parameters["overwrite"].default is False, name


def test_the_parts_of_a_scene_stay(tmp_path):
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene" / "mine").write_text("mine")
    with pytest.raises(OutputExistsError, match="scene is there already"):
        vg.save_scene(PACKING, tmp_path / "scene.vtm")
    assert (tmp_path / "scene" / "mine").read_text() == "mine"
