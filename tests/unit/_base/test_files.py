"""Files are whole or not there, and checkpoints prove themselves."""

import errno

import numpy as np
import pytest

from voxgran._base.checkpoint import load_checkpoint, save_checkpoint
from voxgran._base.errors import CheckpointError, MissingFileError, OutputError, OutputExistsError
from voxgran._base.files import existing_file, write_text, written_whole


def test_what_was_there_stays_when_writing_fails(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("before")
    with pytest.raises(OutputError, match="No space left"), written_whole(target) as draft:  # noqa: PT012
        draft.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert target.read_text() == "before"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_nothing_is_replaced_unasked(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("before")
    with pytest.raises(OutputExistsError, match="is there already"):
        write_text(target, "after", overwrite=False)
    assert target.read_text() == "before"
    write_text(target, "after")
    assert target.read_text() == "after"


def test_folders_are_replaced_whole(tmp_path):
    target = tmp_path / "out"
    target.mkdir()
    (target / "old").write_text("old")
    with written_whole(target) as draft:
        draft.mkdir()
        (draft / "new").write_text("new")
    assert [path.name for path in target.iterdir()] == ["new"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match="is not there"):
        existing_file(tmp_path / "none.stl")
    with pytest.raises(FileNotFoundError, match="is a folder"):
        existing_file(tmp_path)


def test_checkpoint_round_trip(tmp_path):
    arrays = {"a": np.arange(6).reshape(2, 3), "b": np.array([np.nan, 1e-300, -0.0]), "file": np.zeros((0, 3))}
    save_checkpoint(tmp_path / "c", {"done": 3, "name": "x"}, arrays)
    header, back = load_checkpoint(tmp_path / "c")
    assert header == {"done": 3, "name": "x"}
    assert list(back) == list(arrays)
    for name, array in arrays.items():
        assert back[name].dtype == array.dtype
        assert back[name].tobytes() == array.tobytes()


def test_damaged_checkpoints_are_refused(tmp_path):
    path = tmp_path / "c"
    save_checkpoint(path, {"done": 3}, {"a": np.arange(100)})
    good = path.read_bytes()
    for cut in (0, 5, 30, 100, len(good) // 2, len(good) - 1):
        path.write_bytes(good[:cut])
        with pytest.raises(CheckpointError):
            load_checkpoint(path)
    for at in (40, 120, len(good) // 2, len(good) - 3):
        path.write_bytes(good[:at] + bytes([good[at] ^ 1]) + good[at + 1 :])
        with pytest.raises(CheckpointError):
            load_checkpoint(path)
