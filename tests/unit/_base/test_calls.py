"""Calls that do not fit a signature, and names that are meant: one sentence with what is right."""

import contextlib
import inspect
import pickle
import pydoc

import pytest

import voxgran as vg
from voxgran._base.calls import explained
from voxgran._base.errors import CallError, InputError, UnknownNameError, nearest

SPHERE, BOX = vg.make_shape("sphere"), vg.Box((4, 4, 4))
BED = vg.Packing.of([SPHERE], BOX, position=[(2, 2, 2)])


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            lambda: vg.Box(4, 4, 6),
            r"Box takes 2 arguments by position \(lengths, periodic\) and was given 3; write Box\(",
        ),
        (lambda: vg.Cylinder(diameter=2), "argument of Cylinder 'diameter' is unknown: did you mean 'radius'"),
        (lambda: vg.Cylinder(2), "Cylinder needs height; write"),
        (lambda: vg.Sphere(), "Sphere needs radius"),
        (lambda: vg.Rectangle((4, 6), length=(4, 6)), "did you mean 'lengths'"),
        (lambda: vg.Box((4, 4, 6), lengths=(4, 4, 6)), "Box was given lengths twice"),
        (lambda: vg.sizes.lognormal(), "lognormal needs median and sigma"),
        (lambda: vg.sizes.lognormal(sigma=0.2), "lognormal needs median;"),
        (lambda: vg.sizes.lognormal(1.0, std=0.2), "did you mean 'sigma'"),
        (lambda: vg.pack(SPHERE, BOX), "pack needs method"),
        (lambda: vg.plot(SPHERE, colour="height"), "argument of plot 'colour' is unknown: did you mean 'color_by'"),
        (lambda: BED.plot(colour="height"), r"Packing.plot 'colour' .* 'color_by'.*write help\(Packing.plot\) to see"),
        (lambda: BED.measure(bins=10), "argument of Packing.measure 'bins' is unknown: known are which;"),
        (lambda: BED.save("a.vtp", True), r"Packing.save takes 1 argument by position \(path\) and was given 2"),
        (lambda: vg.Shape.from_mesh([(0, 0, 0)]), "Shape.from_mesh needs faces"),
        (lambda: vg.measure(BED, bins=10), r"known are packing, threads, which; write measure\(packing, "),
    ],
)
def test_calls_that_do_not_fit_are_explained(call, sentence):
    with pytest.raises(CallError, match=sentence) as found:
        call()
    assert isinstance(found.value, TypeError)
    assert isinstance(found.value, ValueError)


def test_a_type_error_of_the_function_itself_is_left_alone():
    @explained(hint="add(1, 2)")
    def add(a, b):
        return a + b

    assert add(1, b=2) == 3
    with pytest.raises(TypeError, match="unsupported operand"):
        add(1, "2")
    with pytest.raises(CallError, match=r"add needs b; write add\(1, 2\)"):
        add(1)


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("RSA", ("digital", "rsa"), "rsa"),
        ("rsa", ("RSA",), "RSA"),
        ("cube", ("cone", "box"), "box"),
        ("porosity", ("count", "solid_fraction"), "solid_fraction"),
        ("porosity", ("count", "density"), "density"),
        ("n", ("count", "tries"), "count"),
        ("famly", ("file", "family"), "family"),
        ("xyz", ("count",), None),
        (3, ("count",), None),
    ],
)
def test_the_name_that_was_meant(name, known, meant):
    assert nearest(name, known) == meant


@pytest.mark.parametrize(
    ("call", "meant"),
    [
        (lambda: vg.pack(SPHERE, BOX, method="rsa", n=4), "count"),
        (lambda: vg.pack(SPHERE, BOX, method="RSA", count=4), "rsa"),
        (lambda: vg.pack(SPHERE, BOX, method="digital", voxelsize=0.1), "voxel_size"),
        (lambda: vg.make_shape("cube"), "box"),
        (lambda: vg.make_shape("sphere", sed=1), "seed"),
        (lambda: vg.make_container({"kind": "cube"}), "box"),
        (lambda: vg.measure(vg.Packing.of([SPHERE], BOX, position=[(2, 2, 2)]), which=["porosity"]), "density"),
    ],
)
def test_every_door_suggests_what_was_meant(call, meant):
    with pytest.raises(UnknownNameError, match=f"did you mean '{meant}'"):
        call()


def test_what_belongs_to_the_function_is_suggested_and_listed_after_the_parameters():
    with pytest.raises(UnknownNameError, match=r"'count'\? known are aligned, .*, and beside them .*count, density"):
        vg.pack(SPHERE, BOX, method="rsa", n=4)
    with pytest.raises(UnknownNameError, match=r"'max_spheres'\? known are .*, and beside them max_spheres"):
        vg.fit_clump(vg.shapes.box(), n=20)


@pytest.mark.parametrize(
    ("given", "other"),
    [
        # most letters are shared, and the word is another
        ("max_size", "min_size"),
        ("version", "erosion"),
        ("open_packing", "opening"),
        ("values", "volumes"),
        ("resize", "sizes"),
        ("axis", "radius"),
        ("split", "plot"),
        ("sigma", "image"),
        ("steps", "on_step"),
        ("progress", "rest"),
        ("edem", "yade"),
        ("method", "threshold"),
        ("scale", "surface"),
        ("count", "container"),
        ("nosuch.obj", "eros.obj"),
        ("to_file", "to_unit"),
        ("rotate", "contacts"),
    ],
)
def test_names_that_are_not_truly_alike_are_not_suggested(given, other):
    assert nearest(given, [other]) is None


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("lenght", "length"),
        ("rfd", "rdf"),
        ("settling", "settle"),
        ("segmentation", "segment"),
        ("voxelsize", "voxel_size"),
        ("max_sphere", "max_spheres"),
        ("period", "periodic"),
        ("wall_friction", "friction"),
        ("friction_coefficient", "friction"),
        ("poresizes", "voids"),
        ("mu", "friction"),
        ("E", "young_modulus"),
    ],
)
def test_slips_parts_and_words_of_other_programs_are_suggested(given, meant):
    assert nearest(given, ["count", "other", meant]) == meant


def test_a_function_without_arguments_says_so():
    with pytest.raises(CallError, match=r"^shape_families takes no arguments; write shape_families\(\)$"):
        vg.shape_families("sphere")


@pytest.mark.parametrize(("typed", "meant"), [("repeats", "seeds"), ("replicates", "seeds"), ("scene", "base")])
def test_the_arguments_of_a_study_are_explained(typed, meant):
    with pytest.raises(CallError, match=f"argument of Study '{typed}' is unknown: did you mean '{meant}'.*write Study"):
        vg.Study(base={}, axes={}, **{typed: 2})


@pytest.mark.parametrize("made", [vg.Shaking(acceleration=2.0), vg.Lid(), vg.methods.Rsa(tries=7)])
def test_help_of_a_parameter_class_shows_no_comments_of_python(made):
    shown = pydoc.render_doc(type(made), renderer=pydoc.plaintext)
    assert "Return the values of the fields." in shown
    assert "pickling" not in shown
    assert pickle.loads(pickle.dumps(made)) == made


def flags():
    """Return the public functions and methods that take flags, with these."""
    found = set()
    for top in [getattr(vg, name) for name in vg.__all__]:
        names = getattr(top, "__all__", dir(top))
        beside = [getattr(top, key) for key in names if not key.startswith("_")]
        for one in [top, *beside] if inspect.isclass(top) or inspect.ismodule(top) else [top]:
            if inspect.isabstract(one):
                continue
            if inspect.isfunction(one) or (inspect.isclass(one) and "voxgran" in one.__module__):
                with contextlib.suppress(ValueError):
                    entries = inspect.signature(one).parameters.values()
                    found |= {(one, entry) for entry in entries if entry.annotation is bool}
    return found


@pytest.mark.parametrize("value", ["no", "False", 1.0, 0, None])
def test_a_flag_is_true_or_false(value):
    assert len(flags()) > 50
    for function, flag in flags():
        assert flag.kind is flag.KEYWORD_ONLY, function
        with pytest.raises(InputError, match=f"{flag.name} is .* it must be (True or False|true or false)"):
            function(**{flag.name: value})


def test_a_bad_flag_costs_no_file(tmp_path):
    BED.save(tmp_path / "bed.vtp")
    before = (tmp_path / "bed.vtp").read_bytes()
    with pytest.raises(InputError, match="overwrite is 'no'"):
        BED.save(tmp_path / "bed.vtp", overwrite="no")
    assert (tmp_path / "bed.vtp").read_bytes() == before
