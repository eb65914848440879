"""Messages for names that are not there: of modules, packings and shapes, arguments and flags."""

import copy
import inspect
import pickle
import re
import subprocess
import sys

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import CallError, InputError, UnknownNameError
from voxgran._base.registry import ExplainedAttributes, nearest, nearest_word
from voxgran._base.units import as_unit
from voxgran.shapes.images.image_files import Image


@pytest.fixture(scope="module")
def packing() -> vg.Packing:
    return vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)])


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("info", "describe"),
        ("shake", "settle"),
        ("make_shap", "make_shape"),
        ("shape", "make_shape"),
        ("decimate", "simplify"),
        ("watershed", "segment"),
        ("read_mesh", "load_shape"),
        ("Image", "load_image"),
    ],
)
def test_a_name_that_is_not_there_names_the_one_that_was_meant(typed: str, meant: str) -> None:
    with pytest.raises(AttributeError, match=f"has no attribute '{typed}': did you mean '{meant}'"):
        getattr(vg, typed)


@pytest.mark.parametrize(
    ("typed", "written"),
    [
        ("ellipsoid", "vg.shapes.ellipsoid()"),
        ("box", "vg.shapes.box() for the shape, vg.Box(...) for the container"),
        ("rsa", "vg.pack(shapes, container, 'rsa', ...)"),
        ("Lognormal", "vg.sizes.lognormal(...)"),
        ("optimal", "vg.fit_clump(shape, method='optimal')"),
        ("lammps", "vg.write_deck(packing, folder, 'lammps')"),
        ("rdf", "vg.measure(packing, 'rdf')"),
        ("pore_sizes", "vg.measure(packing, 'voids')"),
        ("pore_size_distribution", "vg.measure(packing, 'voids')"),
        ("porosity", "vg.measure(packing, 'density')"),
    ],
)
def test_what_is_made_by_a_call_names_the_call(typed: str, written: str) -> None:
    with pytest.raises(AttributeError, match=re.escape(f"has no attribute '{typed}': write {written}") + "$"):
        getattr(vg, typed)


def test_python_adds_no_second_suggestion() -> None:
    done = subprocess.run([sys.executable, "-c", "import voxgran; voxgran.shape"], capture_output=True, text=True)
    assert done.stderr.rstrip().endswith("did you mean 'make_shape'?")


def test_a_name_like_none_says_where_names_are() -> None:
    with pytest.raises(AttributeError, match=r"no attribute 'qqq': dir\(voxgran\) lists its names"):
        _ = vg.qqq  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="did you mean 'sphere'"):
        vg.shapes.spere()


def test_a_word_of_a_name_is_enough() -> None:
    assert nearest("stack_image_of_tomography", ["load_image", "pack"]) is None
    assert nearest_word("stack_image_of_tomography", ["load_image", "pack"]) == "load_image"
    assert nearest_word("zzz", ["load_image", "pack"]) is None


@pytest.mark.parametrize(
    ("typed", "remedy"),
    [
        ("equilibrium", r"write vg\.equilibrium\(packing, \.\.\.\)"),
        ("report", r"write vg\.save_report\(packing, \.\.\.\)"),
        ("positions", "did you mean 'position'"),
        ("to_csv", "did you mean 'to_dataframe'"),
        ("radii", "did you mean 'diameters'"),
        ("sizes", "did you mean 'diameters'"),
        ("qqq", r"dir\(Packing\) lists its attributes"),
    ],
)
def test_an_attribute_of_a_packing_that_is_not_there_names_what_to_write(
    packing: vg.Packing, typed: str, remedy: str
) -> None:
    with pytest.raises(AttributeError, match=f"Packing has no attribute '{typed}': {remedy}"):
        getattr(packing, typed)
    assert not hasattr(packing, typed)


def test_shapes_answer_too_and_are_copied_and_pickled_as_before(packing: vg.Packing) -> None:
    with pytest.raises(AttributeError, match="Shape has no attribute 'volum': did you mean 'volume'"):
        _ = packing.shapes[0].volum  # type: ignore[attr-defined]
    assert copy.copy(packing.shapes[0]) == packing.shapes[0] == pickle.loads(pickle.dumps(packing.shapes[0]))
    assert copy.deepcopy(packing).count == pickle.loads(pickle.dumps(packing)).count == 2
    assert not hasattr(packing, "__array_interface__")


def test_objects_that_functions_return_answer_too(packing: vg.Packing) -> None:
    clump = vg.fit_clump(packing.shapes[0], method="inscribed", max_spheres=1)
    for owner, typed, remedy in (
        (clump, "n_spheres", "did you mean 'count'"),
        (clump, "centres", "did you mean 'centers'"),
        (packing.shapes[0], "decimate", r"write vg\.simplify\(shape, \.\.\.\)"),
        (packing.verify(), "passed", "did you mean 'ok'"),
        (packing.contacts(), "gaps", "did you mean 'gap'"),
        (vg.Cylinder(radius=1, height=2), "length", "did you mean 'height'"),
        (packing.measure("gradation").voxgran, "summary", "did you mean 'numbers'"),
    ):
        with pytest.raises(AttributeError, match=f"{type(owner).__name__} has no attribute '{typed}': {remedy}"):
            getattr(owner, typed)
    image = Image(np.zeros((2, 2, 2)))
    with pytest.raises(AttributeError, match="Image has no attribute 'data': did you mean 'values'"):
        _ = image.data  # type: ignore[attr-defined]


def test_every_public_function_explains_calls_that_do_not_fit() -> None:
    functions = [entry for name in vg.__all__ if inspect.isfunction(entry := getattr(vg, name))]
    assert len(functions) > 60
    for function in functions:
        with pytest.raises(CallError, match=f"{function.__name__} .*; write "):
            function(*[0] * 20)
    with pytest.raises(CallError, match=r"'voxel_size' is unknown.*sizes are in voxels"):
        vg.segment(np.zeros((4, 4, 4)), voxel_size=0.1)  # type: ignore[call-arg]


def test_statistics_are_shown_with_their_units(packing: vg.Packing) -> None:
    assert "number of grains: 2" in repr(packing.measure("gradation").voxgran)


def test_an_error_within_a_property_is_that_error() -> None:
    class Broken(ExplainedAttributes):
        @property
        def volume(self) -> float:
            return self.inner.volume  # type: ignore[no-any-return, attr-defined]

    with pytest.raises(AttributeError, match="'inner'"):
        _ = Broken().volume


def test_a_call_without_method_names_the_slip_beside_it() -> None:
    with pytest.raises(CallError, match="pack needs method, and 'n' may stand for 'count'; write pack"):
        vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), n=3)  # type: ignore[call-overload]


def test_arguments_by_position_that_are_by_name_only() -> None:
    with pytest.raises(CallError, match="Material takes no arguments by position but by name: law, density"):
        vg.Material(2650)  # type: ignore[call-arg, misc]
    with pytest.raises(CallError, match=r"sphere takes its parameters by name only and was given 0\.3; write shapes"):
        vg.shapes.sphere(0.3)  # type: ignore[call-arg, misc]


def test_arguments_that_belong_elsewhere(packing: vg.Packing, tmp_path: "object") -> None:
    with pytest.raises(CallError, match=r"'density' is unknown.*material=Material\(density=2650\)"):
        vg.write_deck(packing, f"{tmp_path}/deck", density=2650)  # type: ignore[call-arg]
    with pytest.raises(CallError, match=r"'density' is unknown.*load_shape\(\"rock.stl\", unit=\"mm\"\)"):
        vg.load_shape("rock.stl", density=2650)  # type: ignore[call-arg]
    with pytest.raises(InputError, match=r"such as .*, or Shaking\(acceleration=\.\.\.\)"):
        vg.settle(packing, shaking=0.2, gravity="-z")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="a number of spheres is max_spheres=20"):
        packing.with_clumps(20)  # type: ignore[arg-type]


def test_a_clump_in_place_of_a_shape_says_how_to_get_one() -> None:
    clump = vg.fit_clump(vg.shapes.box(lengths=(1, 1, 1)), method="inscribed", max_spheres=1)
    with pytest.raises(InputError, match=r"must be a Shape or a list of them; a clump has one, clump\.to_shape\(\)"):
        vg.pack(clump, vg.Box((4, 4, 4)), method="digital", count=1)  # type: ignore[call-overload]
    with pytest.raises(InputError, match="make_shape makes one"):
        vg.pack("rock", vg.Box((4, 4, 4)), method="digital", count=1)  # type: ignore[call-overload]


@pytest.mark.parametrize(
    ("told", "unit"), [("millimetres", "mm"), ("Meter", "m"), ("microns", "um"), ("inches", "inch")]
)
def test_names_of_units_in_full_are_suggested(told: str, unit: str) -> None:
    with pytest.raises(UnknownNameError, match=f"did you mean '{unit}'"):
        as_unit(told)


def test_a_container_without_kind_names_the_key_in_its_place() -> None:
    with pytest.raises(InputError, match="kind is missing, and 'type' may stand for it: it must be one of box"):
        vg.make_container({"type": "box", "lengths": [1, 1, 1]})
    with pytest.raises(InputError, match="kind is missing: it must be one of box"):
        vg.make_container({"lengths": [1, 1, 1]})


def test_more_densities_than_shapes_are_refused_by_that_rule() -> None:
    with pytest.raises(InputError, match=r"density is \[2650, 7800\]: it must be one number, or 1, one for each shape"):
        vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), method="rsa", count=2, density=[2650, 7800])
