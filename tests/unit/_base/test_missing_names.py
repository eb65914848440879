"""Messages for names that are not there: of modules, packings and shapes, arguments and flags."""

import copy
import importlib
import inspect
import pickle
import re
import subprocess
import sys
import traceback
import types
from dataclasses import is_dataclass
from typing import Any

import numpy as np
import pytest

import voxgran as vg
from voxgran._base import ExplainedAttributes
from voxgran._base.errors import CallError, InputError, UnknownNameError, VoxgranError, nearest, nearest_word
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
        ("friction", "settle"),
        ("make_shap", "make_shape"),
        ("shape", "make_shape"),
        ("decimate", "simplify"),
        ("watershed", "segment"),
        ("read_mesh", "load_shape"),
        ("Image", "load_image"),
        ("material", "Material"),
        ("load_packing", "load"),
        ("plot_packing", "plot"),
        ("picture", "save_picture"),
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
        ("make_sphere", "vg.shapes.sphere() for the shape, vg.Sphere(...) for the container"),
        ("voronoi", "vg.measure(packing, 'local_density')"),
        ("coordination_number", "vg.measure(packing, 'coordination')"),
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
        ("bounds", "did you mean 'container'"),
        ("centroids", "did you mean 'position'"),
        ("neighbors", "did you mean 'contacts'"),
        ("mesh", "did you mean 'to_pyvista'"),
        ("shape", "did you mean 'shapes'"),
        ("to_file", "did you mean 'save'"),
        ("quaternions", "did you mean 'orientation'"),
        ("coordination_number", r"write vg\.measure\(packing, 'coordination'\)"),
        ("sphericity", r"write vg\.describe\(packing\)\['sphericity'\]"),
        ("surface_area", "did you mean 'surface_areas'"),
        ("remove", r"did you mean vg\.remove_grains\(packing, \.\.\.\)"),
        ("radius", r"write packing\.diameter / 2$"),
        ("filter", r"write packing\[packing\.diameter > 1\.0\]"),
        ("voxelize", r"write vg\.to_image\(packing, voxel_size\)"),
        ("local_thickness", r"write vg\.local_thickness\(vg\.to_image\(packing, voxel_size, labels=False\), "),
        # vg.simplify takes a shape, vg.resample an image of any kind
        ("simplify", r"dir\(Packing\) lists its attributes"),
        ("rotate", r"dir\(Packing\) lists its attributes"),
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
        (clump, "show", r"write clump\.to_shape\(\)\.plot\(\.\.\.\)"),
        (packing[0], "volume", r"write grain\.shape\.volume \* grain\.scale\*\*3"),
        (packing[0], "mesh", "did you mean 'shape'"),
        (packing.shapes[0], "save", r"write vg\.save_shape\(shape, \.\.\.\)"),
        (packing.shapes[0], "export", r"write vg\.save_shape\(shape, \.\.\.\)"),
        (packing.shapes[0], "report", r"dir\(Shape\) lists its attributes"),
        (packing.shapes[0], "sphericity", r"write vg\.describe\(shape\)\['sphericity'\]"),
        (packing.container, "rough_walls", r"write vg\.rough_walls\(box, \.\.\.\)"),
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


def test_asking_for_an_attribute_loads_no_module_and_compares_no_names() -> None:
    code = """
import difflib, sys
import voxgran as vg
difflib.SequenceMatcher = None
before = set(sys.modules)
assert not hasattr(vg, "Foo")
assert set(sys.modules) == before, set(sys.modules) - before
packing = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 4, 4)), position=[(1, 1, 1)])
objects = packing, packing[0], packing.container, vg.sizes, vg.methods, vg.Packing, vg.Box
before = set(sys.modules)
for one in objects:
    assert not hasattr(one, "foo") and getattr(one, "contact_gaps", None) is None
assert set(sys.modules) == before, set(sys.modules) - before
calls = []
sys.setprofile(lambda frame, event, argument: calls.append(frame.f_code.co_qualname) if event == "call" else None)
hasattr(packing, "foo")
sys.setprofile(None)
assert len(calls) <= 3, calls
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_message_is_composed_when_it_is_shown(packing: vg.Packing, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(AttributeError) as found:
        _ = packing.positions  # type: ignore[attr-defined]
    error = pickle.loads(pickle.dumps(found.value))
    assert type(error) is AttributeError
    for shown in (str(error), repr(error), "".join(traceback.format_exception(error))):
        assert "Packing has no attribute 'positions': did you mean 'position'?" in shown
    monkeypatch.setattr("voxgran._base.remedies.remedy_of_object", lambda *_: "write nothing")
    assert str(found.value) == "Packing has no attribute 'positions': write nothing"


def test_classes_and_modules_are_those_of_python() -> None:
    packages = [vg, vg.methods, vg.containers, vg.shapes, importlib.import_module("voxgran.contacts")]
    assert {type(package) for package in packages} == {types.ModuleType}
    assert type(vg.Packing) is type(vg.Box) is type(vg.Shape) is type


@pytest.mark.parametrize(
    ("typed", "remedy"),
    [
        ("normal", "did you mean 'lognormal'"),
        ("log_normal", "did you mean 'lognormal'"),
        ("monodisperse", "did you mean 'fixed'"),
        ("psd", "did you mean 'sieve'"),
        ("weibull", r"dir\(voxgran\.shapes\.sizes\) lists"),
    ],
)
def test_modules_without_public_names_on_first_use_answer_too(typed: str, remedy: str) -> None:
    with pytest.raises(AttributeError, match=f"module 'voxgran.shapes.sizes' has no attribute '{typed}': {remedy}"):
        getattr(vg.sizes, typed)
    with pytest.raises(AttributeError, match=r"module 'voxgran\.io' has no attribute 'load': write vg\.load$"):
        _ = importlib.import_module("voxgran.io").load


def test_errors_and_other_names_that_are_not_public_say_what_is() -> None:
    with pytest.raises(AttributeError, match=r"write ValueError, of which it is a kind, or vg\.VoxgranError for all"):
        _ = vg.InputError  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match=r"write UserWarning, of which it is a kind$"):
        _ = vg.DirtyMeshWarning  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="did you mean '__version__'"):
        _ = vg.version  # type: ignore[attr-defined]


def test_every_public_function_refuses_other_objects_in_one_sentence(packing: vg.Packing) -> None:
    voxels = vg.voxelize(vg.shapes.box(lengths=(1, 1, 1)), voxel_size=0.5)
    rest = {"verify": (), "window_solid_fraction": ((0, 0, 0), (1, 1, 1)), "to_image": (0.1,)}
    for name in (*rest, *(name for name in vg.__all__ if name.startswith("save"))):
        function: Any = getattr(vg, name)
        for other in ("rock", [packing, packing], 3, None, voxels):
            with pytest.raises(VoxgranError):
                function(other, *rest.get(name, ("folder",)))
    with pytest.raises(InputError, match=r"^packing is Shape\(.*it must be a Packing"):
        vg.to_image(packing.shapes[0], 0.1)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r'a mapping of names to packings, such as \{"loose": bed'):
        vg.save_comparison([packing, packing], "c.html")  # type: ignore[arg-type]


def test_every_public_function_explains_calls_that_do_not_fit() -> None:
    functions = [entry for name in vg.__all__ if inspect.isfunction(entry := getattr(vg, name))]
    assert len(functions) > 60
    for function in functions:
        with pytest.raises(CallError, match=f"{function.__name__} .*; write "):
            function(*[0] * 20)
    with pytest.raises(CallError, match=r"'max_size' is unknown.*min_size is in voxels"):
        vg.segment(np.zeros((4, 4, 4)), max_size=9)  # type: ignore[call-arg]


def test_every_public_class_with_fields_explains_calls_that_do_not_fit() -> None:
    spaces: list[Any] = [vg, vg.methods, vg.families, vg.clumps, vg.containers]
    found = {entry for space in spaces for name in space.__all__ if is_dataclass(entry := getattr(space, name))}
    assert len(found) > 60
    for cls in found:
        with pytest.raises(CallError, match=f"^argument of {cls.__name__} 'no_such_name' is unknown: .*; write "):
            cls(no_such_name=1)


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
    with pytest.raises(InputError, match=r"must be a Shape or a list of them; .*write \.to_shape\(\)"):
        vg.pack(clump, vg.Box((4, 4, 4)), method="digital", count=1)  # type: ignore[call-overload]
    with pytest.raises(InputError, match="make_shape and load_shape make one"):
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


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: vg.make_shape(None), "shape family None is unknown: known are"),  # type: ignore[arg-type]
        (lambda: vg.equilibrium(vg.shapes.sphere()), "it must be a Packing; load or pack one"),  # type: ignore[arg-type]
        (lambda: vg.spherize(3, radius=1.0), "it must be a Shape; make_shape and load_shape make one"),  # type: ignore[arg-type]
        (lambda: vg.Vessel(vg.Box((1, 1, 1))), "a Shape or the file of a mesh; make_shape and load_shape make one"),
        (lambda: vg.save_deformed(vg.shapes.sphere(), "grain.vtp"), "what deform(packing) returns; call deform"),  # type: ignore[arg-type]
    ],
)
def test_an_object_of_another_kind_is_refused_with_a_remedy(call: Any, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        call()
