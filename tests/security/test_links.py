"""Links in folders that come from others: nothing is read or written where they lead."""

import ctypes
import os
import signal
import sys

import numpy as np
import pytest
from kit import Forked, dicom_slice

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, OutputError
from voxgran._base.files import refuse_links, remove_drafts_in, write_files, written_whole
from voxgran.cli import main
from voxgran.scene.replicates import packings_of_run
from voxgran.shapes.outline import Outline

pytestmark = pytest.mark.usefixtures("forked_readers")

SCENE = {
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 2},
    "measure": {"which": []},
    "output": {"report": False, "vtk": False, "statistics": False},
}
BED = vg.Packing.of([vg.shapes.sphere()], vg.Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)])
DRAFT = ".voxgran-01234567-89abcdef"


@pytest.fixture
def others(tmp_path):
    """Return a folder of files that are not to be changed, or read."""
    write_files({tmp_path / "others" / "thesis.tex": "thesis", tmp_path / "others" / "deep" / "notes.txt": "notes"})
    yield tmp_path / "others"
    assert {path.name: path.read_text() for path in (tmp_path / "others").rglob("*") if path.is_file()} == {
        "thesis.tex": "thesis",
        "notes.txt": "notes",
    }


@pytest.mark.parametrize("name", [DRAFT, f"{DRAFT}.vtp", "packing.vtp", "packing.vtp dangling", ".voxgran.lock", "dem"])
@pytest.mark.parametrize("how", ["overwrite", "resume", None])
def test_a_folder_of_results_keeps_what_its_links_lead_to(name, how, others, tmp_path):
    place = tmp_path / "out"
    place.mkdir()
    ends = {"packing.vtp": others / "thesis.tex", "packing.vtp dangling": others / "none.vtp"}
    ends[".voxgran.lock"] = others / "thesis.tex"
    (place / name.partition(" ")[0]).symlink_to(ends.get(name, others))
    words = "cannot be written" if name == ".voxgran.lock" else "link to another place" if how else "is not empty"
    with pytest.raises(OSError, match=words):
        vg.Scene.from_mapping(SCENE).run(place, **({how: True} if how else {}))
    assert (place / name.partition(" ")[0]).is_symlink()


@pytest.mark.parametrize("name", ["a", "a[1]"])
def test_a_checkpoint_beside_the_output_is_no_link(name, others, tmp_path):
    place = tmp_path / "place"
    place.mkdir()
    vg.save(vg.Packing.of([vg.shapes.sphere()], vg.Box((3, 3, 3)), position=[(1, 1, 1)]), place / "in.vtp")
    for suffix in ("voxgran", "vtp"):
        (place / f"{name}.checkpoint.{suffix}").symlink_to(others / "none")
    for words in (["settle"], ["compress", "--axes", "z"], ["relax", "--engine", "yade"]):
        assert main([words[0], str(place / "in.vtp"), "-o", str(place / f"{name}.vtp"), *words[1:]]) == 1
    assert sorted(path.name for path in place.iterdir()) == [
        f"{name}.checkpoint.voxgran",
        f"{name}.checkpoint.vtp",
        "in.vtp",
    ]


@pytest.mark.parametrize("name", ["run", "run/snapshot_000000000000100.vtp"])
@pytest.mark.parametrize("how", [{}, {"resume": True}, {"overwrite": True}])
def test_snapshots_are_not_written_where_links_lead(name, how, others, tmp_path):
    place = tmp_path / "place"
    (place / name).parent.mkdir(parents=True)
    (place / name).symlink_to(others if name == "run" else others / "thesis.tex")
    with pytest.raises(OutputError, match="a link to another place"):
        vg.Series(place / "run.pvd", **how)


@pytest.mark.parametrize("time", ["0", "-5"])
def test_a_list_of_snapshots_has_times_that_are_possible(time, tmp_path):
    (tmp_path / "run.pvd").write_text(f'<VTKFile><Collection><DataSet timestep="{time}"/></Collection></VTKFile>')
    with pytest.raises(FileFormatError, match="is no list of snapshots"):
        vg.Series(tmp_path / "run.pvd", resume=True)


@pytest.mark.parametrize("name", ["cells", f"cells/{DRAFT}", "study.nc", "checkpoints"])
def test_a_folder_of_a_study_keeps_what_its_links_lead_to(name, others, tmp_path):
    place = tmp_path / "out"
    (place / name).parent.mkdir(parents=True)
    (place / "cells").mkdir(exist_ok=True) if name != "cells" else None
    (place / name).symlink_to(others / "thesis.tex" if name == "study.nc" else others)
    with pytest.raises(OutputError, match=f"holds {name}, a link to another place"):
        vg.Study(base=SCENE, axes={"packing.count": [1]}, seeds=1).run(place, workers=1)


def test_links_within_a_folder_of_results_and_to_it_are_no_harm(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "there")
    (tmp_path / "there" / "latest.vtp").symlink_to("packing.vtp")
    vg.Scene.from_mapping(SCENE).run(tmp_path / "out", overwrite=True)
    assert vg.load(tmp_path / "there" / "latest.vtp").count == 2


def test_a_folder_with_an_environment_may_hold_results(tmp_path):
    """Its links lead to the Python of the system."""
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    (tmp_path / ".venv" / "bin" / "python").symlink_to("/usr/bin/env")
    refuse_links(tmp_path)
    (tmp_path / ".venv").rename(tmp_path / "cells")
    (tmp_path / "cells" / "pyvenv.cfg").write_text("home = /usr/bin\n")
    with pytest.raises(OutputError, match="holds cells/bin/python, a link to another place"):
        refuse_links(tmp_path)


def test_files_beside_the_one_that_is_named_are_no_links(others, tmp_path):
    """A deck, a page with its numbers, many shapes: their names are those that voxgran gives."""
    place = tmp_path / "place"
    place.mkdir()
    bed = vg.Packing.of(vg.shapes.sphere(), vg.Box((3, 3, 3)), position=[(1, 1, 1)])
    for name in ("lammps_run.in", "page.json", "sphere_0.stl"):
        (place / name).symlink_to(others / "thesis.tex")
    with pytest.raises(OutputError, match="link to another place"):
        vg.write_deck(bed, place, "lammps", overwrite=True)
    with pytest.raises(OutputError, match="link to another place"):
        write_files({place / "page.html": "page", place / "page.json": "{}"})
    assert main(["shape", "sphere", "--count", "2", "-o", str(place), "--overwrite"]) == 1


def test_drafts_that_are_links_are_removed_alone(others, tmp_path):
    (tmp_path / DRAFT).symlink_to(others)
    (tmp_path / f"{DRAFT}.tex").symlink_to(others / "thesis.tex")
    remove_drafts_in(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["others"]


def test_a_checkpoint_writes_no_lock_through_a_link(others, tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        made = []
        patch.setattr(os, "open", lambda path, *how, real=os.open: made.append(str(path)) or real(path, *how))
        vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=2, checkpoint=tmp_path / "kept.voxgran")
    (lock,) = {path for path in made if path.endswith(".lock")}
    os.symlink(others / "thesis.tex", lock)
    with pytest.raises(OutputError, match="cannot be written"):
        vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=2, checkpoint=tmp_path / "kept.voxgran")


@pytest.mark.parametrize("kind", ["tif", "png", "dcm"])
def test_slices_of_a_folder_lie_in_it(kind, tmp_path):
    folder, secret = tmp_path / "in", tmp_path / f"secret.{kind}"
    folder.mkdir()
    for k in range(2):
        place = secret if k else folder / f"0.{kind}"
        values = np.full((4, 4), 7 * k, dtype=np.uint16)
        if kind == "dcm":
            place.write_bytes(dicom_slice(values, k, 1.0))
        elif kind == "tif":
            pytest.importorskip("tifffile").imwrite(place, values)
        else:
            pytest.importorskip("PIL.Image").fromarray(values.astype(np.uint8)).save(place)
    (folder / f"1.{kind}").symlink_to(secret)
    for read in (vg.load_image, vg.open_image):
        with pytest.raises(FileFormatError, match=rf"holds '1\.{kind}', a link to another place"):
            read(folder)
    (folder / f"1.{kind}").unlink()
    os.link(secret, folder / f"1.{kind}")
    assert vg.load_image(folder).values.shape == (4, 4, 2)


def test_what_stands_beside_spheres_is_no_link(tmp_path):
    (tmp_path / "in").mkdir()
    np.array([[1.0, 1.0, 1.0, 1.0]]).tofile(tmp_path / "in" / "a.xyzd")
    (tmp_path / "secret").write_text("Packing size: 5 5 5\n")
    (tmp_path / "in" / "generation.conf").symlink_to(tmp_path / "secret")
    with pytest.raises(FileFormatError, match=r"generation\.conf is a link to another place"):
        vg.load(tmp_path / "in" / "a.xyzd")


def test_seeds_of_a_summary_are_numbers(tmp_path):
    (tmp_path / "out" / "seed_1").mkdir(parents=True)
    vg.save(BED, tmp_path / "packing.vtp")
    (tmp_path / "out" / "summary.json").write_text('{"seeds": ["1/../.."]}')
    with pytest.raises(InputError, match="holds no packing"):
        packings_of_run(tmp_path / "out")
    os.replace(tmp_path / "packing.vtp", tmp_path / "out" / "seed_1" / "packing.vtp")
    (tmp_path / "out" / "summary.json").write_text('{"seeds": [1]}')
    assert len(packings_of_run(tmp_path / "out")) == 1


def without_exchange(event, _):
    """Stand in, as an audit hook, for a system that cannot exchange two folders in one step."""
    if event == "ctypes.dlsym/handle" or event == "ctypes.dlsym":
        raise OSError(38, "Function not implemented")


@pytest.mark.parametrize("exchanges", [True, False])
def test_a_folder_that_is_replaced_is_there_at_any_time(exchanges, tmp_path):
    """SIGKILL at each call that renames: the earlier folder is at its place, or beside it under a name that stays."""
    for kill_at in range(1, 4):
        place = tmp_path / str(kill_at) / "scene"
        place.mkdir(parents=True)
        (place / "a.vtp").write_text("old")

        def replace(place=place, kill_at=kill_at):
            renamed = []

            def watch(event, arguments):
                if not exchanges:
                    without_exchange(event, arguments)
                if event == "os.rename":
                    renamed.append(event)
                    if len(renamed) == kill_at:
                        os.kill(os.getpid(), signal.SIGKILL)

            with written_whole(place, is_own=bool) as draft:
                draft.mkdir()
                (draft / "a.vtp").write_text("new")
                sys.addaudithook(watch)
            os._exit(0)

        Forked(replace).wait()
        remove_drafts_in(place.parent)
        kept = [path.read_text() for path in place.parent.rglob("a.vtp")]
        assert kept
        assert set(kept) <= {"old", "new"}
        assert exchanges <= (place / "a.vtp").is_file()


def test_a_folder_that_cannot_be_replaced_stays(tmp_path, monkeypatch):
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene" / "a.vtp").write_text("old")
    moved = []

    def full(source, target, real=os.replace):
        moved.append(target)
        if len(moved) == 2:
            raise OSError(28, "No space left on device")
        real(source, target)

    monkeypatch.setattr(os, "replace", full)
    monkeypatch.setattr(ctypes, "CDLL", lambda name: None)
    with pytest.raises(OutputError, match="No space left"), written_whole(tmp_path / "scene", is_own=bool) as draft:
        draft.mkdir()
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]
    assert (tmp_path / "scene" / "a.vtp").read_text() == "old"


def test_a_disk_has_its_center_somewhere():
    """A file with another one read outside of arrays when near grains were sought."""
    for center in ((np.nan, 0.0), (0.0, np.inf)):
        with pytest.raises(InputError, match="center"):
            Outline("disk", radius=0.5, center=center)
