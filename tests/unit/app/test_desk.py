"""The desk of the app: errors stand at their section, runs are a queue, and give the bits of the prompt."""

import dataclasses
import io
import time
import zipfile

import numpy as np
import pytest
import pyvista as pv

import voxgran as vg
from voxgran._base.errors import InputError, VoxgranError
from voxgran.app.desk import Desk
from voxgran.app.runs import Queue, Watcher, toml_of
from voxgran.cli import main
from voxgran.report.colors import colors_of
from voxgran.report.figures import figures_of
from voxgran.scene.checked_sections import read_toml

pytest.importorskip("tomli_w")

SPHERES = {
    "scene": {"seed": 3},
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 12},
    "measure": {"which": ["coordination"]},
    "output": {"report": False, "vtk": False, "statistics": False},
}


def waited(queue, run, states, seconds=120):
    """Poll until a run is in one of some states."""
    end = time.monotonic() + seconds
    while run.state not in states:
        queue.poll()
        assert time.monotonic() < end, f"run {run.number} is {run.state}: {run.stage} {run.text}"
        time.sleep(0.05)
    return run


def same(one, two):
    """Return whether two packings have the same bits."""
    one, two = vg.load(one), vg.load(two)
    return all(np.array_equal(getattr(one, name), getattr(two, name)) for name in ("position", "orientation", "scale"))


@pytest.fixture
def desk(tmp_path):
    """Return a desk with spheres."""
    made = Desk(SPHERES, tmp_path / "runs", tmp_path)
    yield made
    made.queue.close()
    made.look.stage.close()


def field(desk, section, name):
    """Return a field of the forms."""
    form = next(form for form in desk.forms if form["name"] == section)
    return next(field for field in form["fields"] if field["name"] == name)


def test_the_plan_or_the_sentence_of_an_error_beside_its_section(desk):
    desk.examine()
    assert "12" in desk.plan
    assert not desk.error
    field(desk, "packing", "count")["text"] = "sixty"
    desk.examine()
    assert "[packing]" in desk.error
    assert "count" in desk.error
    (at,) = (k for k, form in enumerate(desk.forms) if form["name"] == "packing")
    assert desk.errors == {str(at): desk.error, f"{at}.count": desk.error}
    assert not desk.plan
    assert field(desk, "packing", "count")["text"] == "sixty"


@pytest.mark.parametrize(
    ("section", "kind", "name", "text"),
    [
        ("packing", "rsa", "solid_fraction", "2"),
        ("container", "box", "lengths", "[4, 4]"),
        ("material", "", "friction", "-1"),
        ("shape", "ellipsoid", "", ""),
    ],
)
def test_each_sentence_stands_beside_what_it_is_about(desk, section, kind, name, text):
    (at,) = (k for k, form in enumerate(desk.forms) if form["name"] == section)
    desk.forms[at]["on"], desk.forms[at]["kind"] = True, kind
    desk.refresh()
    if name:
        field(desk, section, name)["text"] = text
    else:
        field(desk, section, desk.forms[at]["fields"][0]["name"])["text"] = "-1"
    desk.examine()
    assert desk.errors[str(at)] == desk.error
    assert not name or desk.errors[f"{at}.{name}"] == desk.error


def test_a_kind_brings_its_fields_and_keeps_what_they_share(desk):
    next(form for form in desk.forms if form["name"] == "packing")["kind"] = "digital"
    desk.refresh()
    assert field(desk, "packing", "count")["text"] == "12"
    assert field(desk, "packing", "gravity")
    with pytest.raises(InputError, match="only shape"):
        desk.remove(0)
    desk.add_shape()
    desk.remove(1)
    assert desk.mapping["shape"] == [{"family": "sphere"}]


def test_a_twin_is_planned_by_the_file_of_its_sample(desk, tmp_path):
    box = vg.Box((4, 4, 4), periodic="xyz")
    vg.save(vg.pack(vg.shapes.sphere(), box, "expand", count=30, solid_fraction=0.3), tmp_path / "scan.vtp")
    twin = next(form for form in desk.forms if form["name"] == "twin")
    twin["on"], twin["kind"] = True, "expand"
    desk.refresh()
    field(desk, "twin", "sample")["text"], field(desk, "twin", "count")["text"] = "scan.vtp", "8"
    field(desk, "container", "lengths")["text"] = ""
    desk.examine()
    assert not desk.error
    assert "learn the shapes of 30 grains" in desk.details
    assert "shape" not in desk.mapping
    field(desk, "twin", "sample")["text"] = "none.vtp"
    desk.examine()
    assert "none.vtp" in desk.error
    # the sections of the scene are still there
    next(form for form in desk.forms if form["name"] == "twin")["on"] = False
    assert desk.mapping["packing"]["count"] == 12


def test_a_run_has_the_bits_of_the_prompt_with_the_scene_that_is_taken_away(desk, tmp_path):
    run = waited(desk.queue, desk.run(), {"done", "failed"})
    assert run.state == "done", run.error
    desk.look.show(desk.open(run.number))
    (tmp_path / "scene.toml").write_bytes(desk.file("scene.toml"))
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "out"), "--quiet"]) in (0, None)
    assert same(run.packing, tmp_path / "out" / "packing.vtp")
    assert (tmp_path / "out" / "packing.vtp").exists()
    assert desk.file("packing.vtp")
    assert [lamp["ok"] for lamp in desk.lamps] == [True, None]
    # what the run has not left is made of it
    assert b"<html" in desk.file("report.html")
    (tmp_path / "taken.nc").write_bytes(desk.file("statistics.nc"))
    assert "mean_coordination_number" in vg.load_statistics(tmp_path / "taken.nc")
    assert desk.file("picture.png").startswith(b"\x89PNG")
    assert {fact["label"] for fact in desk.results} >= {"grains", "solid fraction", "coordination number"}
    found = figures_of(desk.look.packing, desk.statistics)
    assert [figure["svg"] for figure in desk.figures()] == [figure.svg for figure in found]
    exec(desk.file("scene.py").decode().replace("'out'", repr(str(tmp_path / "python"))), {})
    assert same(run.packing, tmp_path / "python" / "packing.vtp")
    # the view
    for name in colors_of(desk.look.packing):
        desk.look.show(desk.look.packing, color_by=name)
    desk.look.cut((0.5, 1, 1))


def opened(desk, packing):
    """Show a packing as that of a run, which is not computed."""
    run = desk.run()
    run.folder.mkdir()
    vg.save(packing, run.packing)
    desk.open(run.number)
    return run


def test_input_of_an_engine_has_the_material_that_the_forms_have_now(desk, bed):
    opened(desk, bed)

    def taken():
        with zipfile.ZipFile(io.BytesIO(desk.file("lammps.zip"))) as archive:
            return b"".join(archive.read(name) for name in sorted(archive.namelist()) if name.endswith(".in"))

    before = taken()
    next(form for form in desk.forms if form["name"] == "material")["on"] = True
    desk.refresh()
    field(desk, "material", "law")["text"], field(desk, "material", "young_modulus")["text"] = "hertz", "1e9"
    assert b"hertz" not in before
    assert b"hertz" in taken()


def test_a_scene_names_its_files_wherever_it_lies(tmp_path, bed):
    rock = vg.shapes.sphere()
    pv.PolyData.from_regular_faces(rock.vertices, rock.faces).save(tmp_path / "rock.stl")
    desk = Desk({**SPHERES, "shape": [{"file": "rock.stl"}]}, tmp_path / "runs", tmp_path)
    run = opened(desk, bed)
    # a scene in the folder of the runs, and Python in any
    for text in (read_toml(run.folder.with_suffix(".toml")), desk.file("scene.py").decode()):
        assert str((tmp_path / "rock.stl").resolve()) in str(text)
    assert vg.Scene.from_toml(run.folder.with_suffix(".toml")).plan().grains == 12
    desk.look.stage.close()


def test_the_lamp_of_a_specimen_under_a_stress_is_lit(desk, bed):
    for reason, lit in (("compressed", True), ("settled", True), ("steps", False)):
        opened(desk, dataclasses.replace(bed, stop_reason=reason))
        assert [lamp["ok"] for lamp in desk.lamps] == [True, lit]
    assert "rest" in desk.lamps[1]["text"]


def test_rest_is_judged_where_no_forces_are_stored(desk, bed, monkeypatch):
    bare = dataclasses.replace(bed, forces=None)
    for packing, lit, text in (
        (bare, True, "100.0 % of the grains rest"),
        (dataclasses.replace(bare, position=bed.position + np.array([0, 0, 0.05])), False, "% of the grains rest"),
        (dataclasses.replace(bare, gravity=None), None, "without gravity"),
    ):
        opened(desk, packing)
        assert desk.lamps[1]["ok"] is lit, desk.lamps
        assert text in desk.lamps[1]["text"]
    monkeypatch.setattr("voxgran.app.desk.JUDGED", bed.count - 1)
    opened(desk, bare)
    assert desk.lamps[1]["ok"] is None
    assert "voxgran equilibrium" in desk.lamps[1]["text"]


def test_a_shape_that_cannot_be_made_is_said_beside_its_field(desk, monkeypatch):
    form = next(form for form in desk.forms if form["name"] == "shape")
    form["kind"] = "convex_polyhedron"
    desk.refresh()
    field(desk, "shape", "points")["text"] = "2"
    desk.examine()
    assert "points is 2" in desk.error
    assert desk.errors["0.points"] == desk.error
    field(desk, "shape", "points")["text"] = "20"
    field(desk, "shape", "count")["text"] = "900"
    desk.examine()
    assert not desk.error
    made = []
    monkeypatch.setattr("voxgran.scene.entries.ShapeEntry.make", lambda entry: made.append(entry) or [])
    field(desk, "packing", "count")["text"] = "9"
    desk.examine()
    assert not made


@pytest.mark.slow
def test_runs_wait_for_each_other_fail_alone_and_leave_the_forms(desk):
    one, two = desk.run(), desk.run()
    desk.queue.poll()
    assert (one.state, two.state) == ("running", "waiting")
    desk.queue.stop(two)
    assert two.state == "stopped"
    desk.queue.go_on(two)
    with pytest.raises(InputError, match="waiting"):
        desk.queue.go_on(two)
    with pytest.raises(InputError, match="no run 9"):
        desk.run_of(9)
    # the folder of the second cannot be made
    two.folder.write_text("")
    waited(desk.queue, two, {"done", "failed"})
    assert one.state == "done"
    assert two.state == "failed"
    assert "run_2" in two.error
    assert desk.mapping["packing"]["count"] == 12
    with pytest.raises(InputError, match="has ended"):
        desk.queue.stop(one)


@pytest.mark.slow
def test_a_run_that_is_stopped_goes_on_to_the_same_bits(tmp_path):
    scene = {**SPHERES, "packing": {"method": "rsa", "solid_fraction": 0.35}}
    scene["container"] = {"kind": "box", "lengths": [14, 14, 14]}
    queue = Queue(tmp_path / "runs", tmp_path)
    try:
        run = queue.add(scene)
        waited(queue, run, {"running"})
        while run.stage != "packing":
            queue.poll()
            time.sleep(0.02)
        queue.stop(run)
        waited(queue, run, {"stopped", "done"})
        assert run.state == "stopped"
        assert list(run.folder.glob("checkpoint*"))
        queue.go_on(run)
        waited(queue, run, {"done", "failed"})
    finally:
        queue.close()
    assert run.state == "done", run.error
    vg.Scene.from_mapping(scene).run(tmp_path / "out")
    assert same(run.packing, tmp_path / "out" / "packing.vtp")


def test_a_scene_as_a_file_is_the_same_scene(tmp_path):
    (tmp_path / "scene.toml").write_text(toml_of(SPHERES))
    assert read_toml(tmp_path / "scene.toml") == SPHERES


def test_an_uploaded_mesh_is_diagnosed_mended_and_becomes_a_shape(desk, tmp_path):
    rock = vg.shapes.sphere()
    mesh = pv.PolyData.from_regular_faces(rock.vertices, rock.faces[1:])
    mesh.save(tmp_path / "open.stl")
    told = desk.upload("../open.stl", (tmp_path / "open.stl").read_bytes())
    assert "open edges 3" in told
    one, two = desk.mapping["shape"]
    assert one == {"family": "sphere"}
    assert two["repair"]
    desk.examine()
    assert not desk.error
    assert len(desk.preview()) == 2
    with pytest.raises(VoxgranError, match=r"no\.stl"):
        desk.upload("no.stl", b"nothing of this is a mesh")
    assert len(desk.mapping["shape"]) == 2
    assert [path.name for path in (tmp_path / "runs" / "uploads").iterdir()] == ["open.stl"]


def test_a_learned_distribution_becomes_a_shape(desk, tmp_path):
    vg.learn_shapes(vg.make_shapes("convex_polyhedron", count=12)).save(tmp_path / "rocks.nc")
    desk.upload("rocks.nc", (tmp_path / "rocks.nc").read_bytes())
    assert desk.mapping["shape"][1]["count"] == 50
    desk.examine()
    assert not desk.error


def test_the_curve_of_sizes_is_drawn(desk):
    form = next(form for form in desk.forms if form["name"] == "sizes")
    form["on"], form["kind"] = True, "sieve"
    desk.refresh()
    field(desk, "sizes", "openings")["text"] = "0.2\n0.4\n0.8"
    field(desk, "sizes", "passing")["text"] = "0\n0.5\n1"
    desk.examine()
    assert not desk.error
    assert desk.curve.startswith("<svg")
    assert "D50" in desk.held
    assert "grains follow the curve to 0.05" in desk.held


def test_a_watcher_writes_grains_once_in_a_while(tmp_path):
    told = []
    watcher = Watcher(tmp_path / "growing.vtp", lambda: told.append(1))
    with_it = vg.pack(vg.shapes.sphere(), vg.Box((6, 6, 6)), "rsa", count=60, seed=1, recorder=watcher)
    without = vg.pack(vg.shapes.sphere(), vg.Box((6, 6, 6)), "rsa", count=60, seed=1)
    assert np.array_equal(with_it.position, without.position)
    assert told
    assert vg.load(watcher.path).count <= 60
    # the next is due a second later
    assert watcher.due(5) > 1e9
