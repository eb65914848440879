"""`periodic` means the same wherever it is given."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.axes import as_periodic, axis_names
from voxgran._base.errors import InputError

MASK = np.zeros((4, 4, 4), dtype=np.int32)
MASK[0, 1, 1] = MASK[3, 1, 1] = 1
MASK[1, 3, 2] = MASK[1, 0, 2] = 2

GOOD = [
    ("xz", "xz"),
    ("zx", "xz"),
    (["x", "z"], "xz"),
    ({"x"}, "x"),
    (np.array(["y"]), "y"),
    ("none", ""),
    ("", ""),
    ([], ""),
    (False, ""),
    (True, "xyz"),
    (np.True_, "xyz"),
    ((True, False, True), "xz"),
    ([False, np.True_, False], "y"),
    (np.array([True, False, True]), "xz"),
]
BAD = [
    "off",
    "xx",
    ["x", "x"],
    "w",
    ["xy"],
    "X Y",
    2.0,
    np.array(2.0),
    np.array(True),
    3,
    (1, 0, 0),
    (True, False),
    (True,) * 4,
    ["x", True, False],
    {"x": False},
    b"xy",
    np.eye(3, dtype=bool),
    10**400,
    10**5000,
    [10**5000] * 3,
]


@pytest.mark.parametrize(("given", "names"), GOOD)
def test_what_names_axes(given, names):
    assert axis_names(as_periodic(given)) == names


def test_two_dimensions_have_two_axes():
    assert as_periodic(True, 2) == (True, True, False)
    assert as_periodic((False, True), 2) == (False, True, False)
    for given in ("xz", (True, True, False)):
        with pytest.raises(InputError, match="out of x, y,"):
            as_periodic(given, 2)


@pytest.mark.parametrize("given", [*BAD, None], ids=lambda value: str(type(value)))
def test_what_names_none_is_refused_in_one_sentence(given):
    with pytest.raises(InputError, match="'none', True, False or a list of 3 flags") as refused:
        as_periodic(given)
    assert len(str(refused.value)) < 300


def loaded(path, periodic):
    """The packing of a file of spheres."""
    file = path / "spheres.txt"
    file.write_text("1 1 1 1\n3 3 3 1\n")
    return vg.load(file, periodic=periodic).container.periodic


USES = {
    "Box": lambda periodic, _: vg.Box((1, 1, 1), periodic).periodic,
    "make_container": lambda periodic, _: (
        vg.make_container({"kind": "box", "lengths": (1, 1, 1), "periodic": periodic}).periodic
    ),
    "connected_components": lambda periodic, _: vg.connected_components(MASK > 0, periodic=periodic)[1],
    "distance_transform": lambda periodic, _: vg.distance_transform(MASK > 0, periodic=periodic).tobytes(),
    "local_thickness": lambda periodic, _: vg.local_thickness(MASK == 0, periodic=periodic).tobytes(),
    "dilation": lambda periodic, _: vg.dilation(MASK > 0, 1.0, periodic=periodic).tobytes(),
    "closing": lambda periodic, _: vg.closing(MASK > 0, 1.0, periodic=periodic).tobytes(),
    "load_labels": lambda periodic, _: len(vg.load_labels(MASK, voxel_size=1.0, periodic=periodic, border="keep")),
    "packing_of_labels": lambda periodic, _: (
        vg.packing_of_labels(MASK, voxel_size=1.0, periodic=periodic, border="keep").container.periodic
    ),
    "load": lambda periodic, path: loaded(path, periodic),
}


@pytest.mark.filterwarnings(
    "ignore:.*several pieces", "ignore:.*labels have fewer than", "ignore:.*cut by the border", "ignore:.*leave"
)
@pytest.mark.parametrize("use", USES)
def test_all_that_take_axes_take_the_same(use, tmp_path):
    call = USES[use]
    first = call((True, False, True), tmp_path)
    for given, names in GOOD:
        if names == "xz":
            assert call(given, tmp_path) == first
    assert call(True, tmp_path) == call("xyz", tmp_path)
    assert call(False, tmp_path) == call("none", tmp_path)
    for given in BAD:
        with pytest.raises(InputError, match="each once"):
            call(given, tmp_path)


def test_periodic_axes_join_what_meets_there():
    assert [vg.connected_components(MASK > 0, periodic=axes)[1] for axes in ("none", "x", "xy")] == [4, 3, 2]


def test_a_scene_takes_names_and_flags():
    scene = {"shape": [{"family": "sphere"}], "packing": {"method": "rsa", "count": 1}}
    made = [
        vg.Scene.from_mapping({**scene, "container": {"kind": "box", "lengths": [4, 4, 4], "periodic": given}})
        for given in ("xyz", True, ["x", "y", "z"])
    ]
    assert {one.container.periodic for one in made} == {(True, True, True)}
