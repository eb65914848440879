"""Files are whole or not there, and checkpoints prove themselves."""

import errno
import os
import stat
import threading
from pathlib import Path

import numpy as np
import pytest

from voxgran._base.checkpoint import load_checkpoint, remove_checkpoint, save_checkpoint
from voxgran._base.errors import CheckpointError, InputError, MissingFileError, OutputError, OutputExistsError
from voxgran._base.files import as_path, existing_file, remove_drafts, write_text, written_whole


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
    (target / "inner").mkdir(parents=True)
    (target / "inner" / "old").write_text("old")
    with written_whole(target, is_own=lambda path: path.read_text() == "old") as draft:
        draft.mkdir()
        (draft / "new").write_text("new")
    assert [path.name for path in target.iterdir()] == ["new"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("is_own", [None, lambda path: path.read_text() == "old"])
@pytest.mark.parametrize("make", [lambda path: path.write_text("thesis"), lambda path: path.symlink_to("old")])
def test_folders_with_files_of_others_are_not_replaced(tmp_path, is_own, make):
    target = tmp_path / "out"
    (target / "inner").mkdir(parents=True)
    (target / "old").write_text("old")
    make(target / "inner" / "other")
    with pytest.raises(OutputExistsError, match="voxgran did not write"):  # noqa: SIM117
        with written_whole(target, is_own=is_own) as draft:
            draft.mkdir()
    assert (target / "inner" / "other").exists() or (target / "inner" / "other").is_symlink()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_link_is_followed_and_stays(tmp_path):
    (tmp_path / "place").mkdir()
    for name, target in (("link", "place/file"), ("twice", "link"), ("new", "place/there")):
        (tmp_path / name).symlink_to(target)
    write_text(tmp_path / "twice", "first")
    write_text(tmp_path / "new", "second")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "twice").is_symlink()
    assert (tmp_path / "place" / "file").read_text() == "first"
    assert (tmp_path / "place" / "there").read_text() == "second"
    with pytest.raises(OutputExistsError, match="give overwrite=True"):
        write_text(tmp_path / "twice", "third", overwrite=False)
    assert sorted(path.name for path in (tmp_path / "place").iterdir()) == ["file", "there"]


def test_a_folder_behind_a_link_is_replaced_where_it_is(tmp_path):
    (tmp_path / "place").mkdir()
    (tmp_path / "link").symlink_to("place")
    with written_whole(tmp_path / "link") as draft:
        draft.mkdir()
        (draft / "new").write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert [path.name for path in (tmp_path / "place").iterdir()] == ["new"]


def test_a_file_does_not_take_the_place_of_a_folder(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "kept").write_text("kept")
    with pytest.raises(OutputError, match="Is a directory"):
        write_text(tmp_path / "folder", "text")
    assert (tmp_path / "folder" / "kept").read_text() == "kept"
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_devices_are_written_to_and_stay():
    write_text("/dev/null", "text", overwrite=False)
    save_checkpoint("/dev/null", {"done": 3}, {"a": np.arange(3)})
    remove_checkpoint("/dev/null")
    with pytest.raises(OutputError, match="No space left"):
        save_checkpoint("/dev/full", {"done": 3}, {"a": np.arange(3)})
    assert all(stat.S_ISCHR(Path(name).stat().st_mode) for name in ("/dev/null", "/dev/full"))
    with pytest.raises(MissingFileError, match="is no regular file"):
        existing_file("/dev/null")


def test_a_pipe_is_written_to_where_somebody_reads(tmp_path):
    pipe, heard = tmp_path / "pipe", []
    os.mkfifo(pipe)
    with pytest.raises(OutputError, match="No such device"):
        write_text(pipe, "text")
    reader = threading.Thread(target=lambda: heard.append(pipe.read_text()))
    reader.start()
    # more than a pipe holds at a time, and a while may pass until the reader is there
    text = "line\n" * 50_000
    for _ in range(1000):
        try:
            write_text(pipe, text)
            break
        except OutputError:
            threading.Event().wait(0.01)
    reader.join(60)
    assert heard == [text]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_other_special_files_are_refused(tmp_path, monkeypatch):
    import socket

    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket")
        with pytest.raises(OutputError, match="neither a file nor a stream"):
            write_text("socket", "text")
        assert stat.S_ISSOCK(Path("socket").stat().st_mode)


@pytest.mark.parametrize("name", ["n" * 255, "n" * 251 + ".vtp", "a." + "s" * 253])
def test_the_longest_names_are_written(tmp_path, name):
    write_text(tmp_path / name, "text")
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", ["n" * 256, "a\0b", "\ud800", "n/" * 3000])
def test_names_of_no_file_are_refused(name):
    with pytest.raises(InputError, match="path is ") as refused:
        as_path(name)
    assert len(str(refused.value)) < 300


def test_links_in_a_circle_are_refused(tmp_path):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(OutputError, match="cannot be reached"):
        write_text(tmp_path / "a", "text")


def test_drafts_of_the_dead_are_removed(tmp_path):
    left = []
    for name in ("a.txt", "b.txt"):
        writer = written_whole(tmp_path / name)
        left.append(writer.__enter__())
        left[-1].write_text("half")
    assert all(draft.suffix == ".txt" for draft in left)
    remove_drafts(tmp_path / "a.txt")
    assert [draft.exists() for draft in left] == [False, True]


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
