"""Calls that do not fit a signature, and names that are meant: one sentence with what is right."""

import pytest

import voxgran as vg
from voxgran._base.calls import explained, renamed
from voxgran._base.errors import CallError, UnknownNameError
from voxgran._base.registry import nearest

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
        (lambda: vg.pack(SPHERE, BOX, method="rsa", porosity=0.4), "solid_fraction"),
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


def test_what_belongs_to_pack_is_suggested_and_not_listed():
    with pytest.raises(UnknownNameError, match=r"known are (?!.*checkpoint)"):
        vg.pack(SPHERE, BOX, method="rsa", n=4)


def test_former_names_of_arguments_are_accepted_with_a_warning():
    @renamed(most="max_factor")
    def grow(*, max_factor=2.0):
        return max_factor

    assert grow(max_factor=3.0) == 3.0
    with pytest.warns(DeprecationWarning, match="argument most of .*grow is now max_factor"):
        assert grow(most=4.0) == 4.0
    with pytest.raises(CallError, match="max_factor twice, also by its former name most"):
        grow(most=4.0, max_factor=3.0)
