"""The section [grains] of a scene: a list of grains, each placed once."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import GrainTooLargeError, InputError, MissingFileError, UnknownNameError
from voxgran.study.files import FileHashes, files_of, numbers_hash, with_files

LIST = "shape,diameter [um],count\nrock,900,2\nsphere,500,3\nconvex_polyhedron,700,4\n"

pytestmark = [pytest.mark.filterwarnings("ignore:the bulk holds"), pytest.mark.usefixtures("jagged_pictures")]


@pytest.fixture
def scene(tmp_path):
    """Return a function that makes the mapping of a scene with a list, and the folder of its files."""

    def making(text=LIST, **more):
        vg.save_shape(vg.make_shape("box", lengths=(1.2, 1, 0.8)), tmp_path / "rock.stl", overwrite=True)
        (tmp_path / "list.csv").write_text(text, encoding="utf-8")
        return {
            "scene": {"unit": "mm"},
            "shape": [
                {"file": "rock.stl", "clump": {"max_spheres": 4}},
                {"family": "sphere"},
                {"family": "convex_polyhedron", "count": 2},
            ],
            "grains": {"file": "list.csv"},
            "container": {"kind": "box", "lengths": [4, 4, 4]},
            "packing": {"method": "rsa"},
            "measure": {"which": ["gradation"]},
            "output": {"vtk": True, "report": False},
        } | more

    return making


def test_a_scene_places_each_row_once_and_its_plan_says_so(scene, tmp_path):
    made = vg.Scene.from_mapping(scene(), folder=tmp_path)
    plan = made.plan()
    assert plan.grains == 9
    assert plan.amount_asked
    assert plan.sizes.held == plan.sizes.asked
    assert plan.sizes.distance == pytest.approx(0.0, abs=1e-9)
    assert not any("keeps its own" in step for step in plan.skipped)
    result = made.run(tmp_path / "out")
    packing = result.packing
    assert np.bincount(packing.grain_id).tolist() == [2, 3, 4]
    assert packing.diameters == pytest.approx(np.array([0.9, 0.5, 0.7])[packing.grain_id])
    # both of the polyhedra, in turn
    assert np.bincount(packing.shape_id).tolist() == [2, 3, 2, 2]
    assert packing.solid_fraction == pytest.approx(plan.solid_fraction)
    # a list is a part of the scene
    again = vg.Scene.from_mapping(made.to_mapping(), folder="/")
    assert again.run(tmp_path / "out", resume=True).packing.grain_id.tolist() == packing.grain_id.tolist()
    surfaces = pytest.importorskip("pyvista").read(tmp_path / "out" / "scene.vtm")["grains"]
    assert np.array_equal(surfaces["grain_id"], packing.grain_id[surfaces["grain"]])


def test_a_bed_of_a_list_has_an_expected_depth(scene, tmp_path):
    flat = scene("diameter\n0.9\n0.8\n", shape=[{"family": "sphere"}], packing={"method": "gravity"})
    assert 0.0 < vg.Scene.from_mapping(flat, folder=tmp_path).plan().depth < 1.0


def test_a_list_needs_no_shape(scene, tmp_path):
    """Rows are then spheres, and the scene remains itself as a mapping."""
    bare = {key: value for key, value in scene("diameter\n0.9\n0.8\n").items() if key != "shape"}
    made = vg.Scene.from_mapping(bare, folder=tmp_path)
    assert made.plan().grains == 2
    again = vg.Scene.from_mapping(made.to_mapping(), folder="/")
    assert [shape.name for shape in again.run(tmp_path / "out").packing.shapes] == ["sphere"]
    with pytest.raises(InputError, match=r"\[\[shape\]\] is missing"):
        vg.Scene.from_mapping({key: value for key, value in bare.items() if key != "grains"}, folder=tmp_path)


@pytest.mark.parametrize(
    ("text", "more", "error", "words"),
    [
        (LIST, {"grains": {"path": "list.csv"}}, UnknownNameError, r"\[grains\] key 'path' is unknown"),
        (LIST, {"grains": {"file": "none.csv"}}, MissingFileError, r"none.csv"),
        (LIST, {"packing": {"method": "rsa", "count": 4}}, InputError, r"count is 4"),
        (LIST, {"sizes": {"kind": "fixed"}}, InputError, r"sizes is Fixed"),
        (LIST, {"packing": {"method": "jam"}}, InputError, r"method 'jam' makes the sizes .* gravity"),
        (LIST, {"scene": {}}, InputError, r"diameters in um: give unit, .* \[scene\]"),
        (LIST.replace("rock", "rok"), {}, UnknownNameError, r"row 0: shape 'rok' is unknown: did you mean 'rock'"),
        (LIST.replace("900", "9000"), {}, GrainTooLargeError, r"^row 0 of grains"),
    ],
)
def test_what_is_wrong_with_a_list_is_told_before_anything_is_packed(scene, tmp_path, text, more, error, words):
    with pytest.raises(error, match=words):
        vg.Scene.from_mapping(scene(text, **more), folder=tmp_path).plan()


def test_a_study_knows_a_list_by_its_content(scene, tmp_path):
    masses = "mass,shape\n0.5,1\n"
    made = vg.Scene.from_mapping(scene(masses, scene={"density": 2.0}), folder=tmp_path)
    name = str(tmp_path / "list.csv")
    assert name in files_of(made.to_mapping())
    assert with_files(made.to_mapping(), str.upper)["grains"]["file"] == name.upper()
    first = numbers_hash(made, FileHashes())
    # masses are sizes by the density
    denser = vg.Scene.from_mapping(scene(masses, scene={"density": 3.0}), folder=tmp_path)
    assert numbers_hash(denser, FileHashes()) != first
    (tmp_path / "list.csv").write_text(masses.replace("0.5", "0.4"), encoding="utf-8")
    assert numbers_hash(made, FileHashes()) != first
