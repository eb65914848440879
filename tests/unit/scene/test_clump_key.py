"""Scenes whose grains are clumps, from files or fitted."""

import pytest

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError

pytestmark = pytest.mark.usefixtures("jagged_pictures")

CSV = "x,y,z,r\n-0.2,0,0,0.5\n0.2,0,0,0.5\n"
REST = {
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 5},
    "measure": {"which": ["grains"]},
    "output": {"vtk": False, "statistics": False, "report": False},
}


def scene(*shapes, folder="."):
    return vg.Scene.from_mapping({"shape": list(shapes), **REST}, folder=folder)


def test_a_clump_from_a_file_is_packed(tmp_path):
    (tmp_path / "rock.csv").write_text(CSV)
    one = scene({"file": "rock.csv"}, folder=tmp_path)
    assert one.plan().grains == 5
    packing = one.run(tmp_path / "out").packing
    assert packing.shapes == (vg.load_shape(tmp_path / "rock.csv"),)
    assert packing.verify().ok


@pytest.mark.parametrize("clump", [6, {"max_spheres": 6, "method": "inscribed"}])
def test_a_fitted_clump_is_packed_in_place_of_the_shape(tmp_path, clump):
    if clump == 6:
        clump = {"max_spheres": 6, "method": "inscribed", "resolution": 32}
    one = scene({"family": "box", "lengths": [1, 1, 0.8], "clump": clump})
    plan = one.plan()
    assert plan.computed[0] == "fit clumps of up to 6 spheres to 1 of the shapes"
    assert plan.solid_fraction == pytest.approx(5 * 0.8 / 64)
    packing = one.run(tmp_path / "out").packing
    assert packing.solid_fraction == pytest.approx(5 * 0.8 / 64)
    assert len(packing.shapes[0].geometry.radii) == 6
    assert packing.provenance["clumps"][0]["spheres"] == 6
    assert packing.provenance["scene"]["shape"][0]["clump"] == clump
    again = vg.Scene.from_mapping(packing.provenance["scene"])
    assert again.shapes == one.shapes
    # nothing is packed again
    assert one.run(tmp_path / "out", resume=True).packing == packing


def test_a_number_is_that_of_the_spheres():
    assert scene({"family": "box", "clump": 30}).shapes[0].clump == {"max_spheres": 30}
    assert scene({"family": "box"}).shapes[0].clump is None


@pytest.mark.parametrize(
    ("clump", "kind", "message"),
    [
        ({"max_sphere": 5}, UnknownNameError, "max_spheres"),
        ({"method": "inscribd"}, UnknownNameError, "inscribed"),
        ({"method": "inscribed", "min_radus": 5}, UnknownNameError, "min_radius"),
        (0, InputError, "clump is 0"),
        ("many", InputError, "clump is 'many'"),
        ({"target": "iou"}, InputError, "clump has no value"),
        ({"target": "mass", "value": 0.9}, InputError, "clump target is 'mass'"),
        ({"target": "iou", "value": 2}, InputError, "clump value is 2"),
        ({"seed": -1}, InputError, "clump seed is -1"),
    ],
)
def test_wrong_clumps_are_refused(clump, kind, message):
    with pytest.raises(kind, match=message):
        scene({"family": "box", "clump": clump})


def test_what_has_no_clump_is_refused(tmp_path):
    with pytest.raises(UnknownNameError, match="'clump'"):
        scene({"family": "box", "clmp": 5})
    (tmp_path / "a.stl").write_text("solid\nendsolid\n")
    with pytest.raises(UnknownNameError, match="'clump'"):
        scene({"file": "a.stl", "clmp": 5}, folder=tmp_path)
    with pytest.raises(InputError, match="surface = true and clump"):
        scene({"file": "a.stl", "surface": True, "clump": 5}, folder=tmp_path)
    flat = {"container": {"kind": "rectangle", "lengths": [5, 5]}}
    tile = {"family": "polygon", "vertices": [[0, 0], [1, 0], [0, 1]], "clump": 4}
    one = vg.Scene.from_mapping({"shape": [tile], **REST, **flat})
    with pytest.raises(InputError, match="flat and has a clump"):
        one.plan()
