"""Files that come with the package, in Python and at the prompt."""

import pytest

import voxgran as vg
from voxgran.cli import main
from voxgran.io.data_files import DATA_FILES, installed_data_files


@pytest.mark.parametrize("name", DATA_FILES)
def test_each_file_is_there(name):
    assert vg.data_file(name).is_file()


def test_the_list_is_complete():
    folder = vg.data_file("eros.obj").parent
    assert {path.name for path in folder.iterdir()} == {*DATA_FILES, "SOURCES.md"}


def test_a_wrong_name_gives_the_nearest():
    with pytest.raises(vg.VoxgranError, match=r"did you mean 'eros.obj'\? known are bennu_lp.obj"):
        vg.data_file("eros")


def test_a_file_that_is_not_installed_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr("voxgran.io.data_files.__file__", str(tmp_path / "voxgran" / "io" / "data_files.py"))
    with pytest.raises(vg.VoxgranError, match=r"eros\.obj is not in the installed package.*: it comes with a checkout"):
        vg.data_file("eros.obj")


def test_the_prompt_copies_a_file_and_replaces_nothing_unasked(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["data", "itokawa_lp.obj", "-o", "rock.obj"]) == 0
    assert (tmp_path / "rock.obj").read_bytes() == vg.data_file("itokawa_lp.obj").read_bytes()
    assert "rock.obj" in capsys.readouterr().out
    assert main(["data", "itokawa_lp.obj", "-o", "rock.obj"]) == 2
    assert main(["data", "itokawa_lp.obj", "-o", "rock.obj", "--overwrite"]) == 0
    assert main(["data", "eros"]) == 2
    assert "did you mean 'eros.obj'" in capsys.readouterr().err


def test_the_prompt_lists_the_files(capsys):
    assert main(["data"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in DATA_FILES)
    assert "Eros, 14,744 triangles; NASA" in text
    assert len(vg.load_shape(vg.data_file("eros.obj")).faces) == 14744
    assert len(vg.load_shape(vg.data_file("itokawa_lp.obj")).faces) == 1622
    assert main(["data", "-o", "rock.obj"]) == 2
    assert "without a name" in capsys.readouterr().err


def test_only_files_that_are_there_are_listed(monkeypatch, tmp_path):
    assert installed_data_files() == DATA_FILES
    (tmp_path / "voxgran" / "data").mkdir(parents=True)
    (tmp_path / "voxgran" / "data" / "eros.obj").write_text("")
    monkeypatch.setattr("voxgran.io.data_files.__file__", str(tmp_path / "voxgran" / "io" / "data_files.py"))
    assert list(installed_data_files()) == ["eros.obj"]
    with pytest.raises(vg.VoxgranError, match=r"bunny_dirty\.ply .* here are eros\.obj"):
        vg.data_file("bunny_dirty.ply")
