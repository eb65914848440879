"""The key count of a [[shape]] and ranges in place of numbers."""

import re

import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.scene.description import SceneDescription

pytestmark = pytest.mark.usefixtures("jagged_pictures")


def scene(**shape):
    return {
        "shape": [{"family": "convex_polyhedron", "share": 3.0, **shape}, {"family": "sphere"}],
        "container": {"kind": "box", "lengths": [5, 5, 5]},
        "packing": {"method": "rsa", "count": 20},
        "measure": {"which": ["grains"]},
        "output": {"report": False, "statistics": False, "vtk": False},
    }


def test_one_entry_stands_for_many_shapes(tmp_path):
    given = scene(count=6, points=[8, 20], aspect=[1, 1, [1, 2]], seed=4)
    made = SceneDescription.from_mapping(given)
    assert made.asked()["weights"] == [0.5] * 6 + [1.0]
    assert SceneDescription.from_mapping(made.to_mapping()) == made
    assert made.to_mapping()["shape"][0] == given["shape"][0]
    result = vg.Scene.from_mapping(given).run(tmp_path / "out")
    shapes = vg.make_shapes("convex_polyhedron", count=6, points=[8, 20], aspect=[1, 1, [1, 2]], seed=4)
    assert list(result.packing.shapes) == [*shapes, vg.make_shape("sphere")]
    assert vg.Scene.from_mapping(given).plan().grains == 20


def test_each_of_many_shapes_gets_a_clump():
    made = SceneDescription.from_mapping(scene(count=3, clump=5)).shapes[0]
    clumps = [shape for shape, record in made.grains() if record]
    assert len({shape.key for shape in clumps}) == 3
    assert all(len(shape.geometry.radii) <= 5 for shape in clumps)


def test_siblings_of_a_scan_are_named_by_its_file(tmp_path):
    vg.save_shape(vg.make_shape("ellipsoid", aspect=(1, 1, 2)), tmp_path / "scan.ply")
    given = scene(count=2) | {"shape": [{"family": "spherical_harmonics", "like": "scan.ply", "count": 2}]}
    one, two = SceneDescription.from_mapping(given, folder=tmp_path).shapes[0].make()
    assert one.record["powers"] == pytest.approx(two.record["powers"])
    assert one != two


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ({"count": 0}, "[[shape]] count is 0: it must be a whole number, at least 1"),
        ({"points": [20, 8]}, "[[shape]] convex_polyhedron points is [20, 8]: a range goes from"),
        ({"family": "box", "aspect": [1, 1, 2], "count": 5}, "its shapes would all be equal; say in [packing]"),
        ({"family": None, "file": "a.stl", "count": 5}, "[[shape]] has a file and count: a file is one shape"),
    ],
)
def test_wrong_counts_are_refused(shape, message):
    given = scene(**shape)
    given["shape"][0] = {key: value for key, value in given["shape"][0].items() if value is not None}
    with pytest.raises(InputError, match=re.escape(message)):
        SceneDescription.from_mapping(given)
