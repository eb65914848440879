"""Gravity, contact gap and asked sizes in files, and what older files say of them in their provenance."""

import dataclasses
import json

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError
from voxgran.io.files import check_savable
from voxgran.io.record import from_record, to_record
from voxgran.measures.registered.provenance import content_hash

BALL = vg.make_shape("sphere")


def some(container=None, **more):
    return vg.Packing.of([BALL], container or vg.Box((4, 4, 4)), position=[(1, 1, 1), (3, 3, 3)], **more)


@pytest.mark.parametrize("gravity", [None, "-y", (1.0, 2.0, -3.0), (0, 0, -1)])
def test_fields_come_back_to_the_bit(gravity, tmp_path):
    sizes = vg.sizes.sieve([0.1, 0.3, 1.7], [0.0, 0.25, 1.0])
    packing = some(gravity=gravity, contact_gap=0.1 + 0.2, asked_sizes=sizes, unit="um")
    vg.save(packing, tmp_path / "p.vtp")
    again = vg.load(tmp_path / "p.vtp")
    assert again.gravity == packing.gravity
    assert again.contact_gap == packing.contact_gap
    assert again.asked_sizes == sizes
    assert again.unit == "um"
    assert content_hash(again) == content_hash(packing)
    series = vg.Series(tmp_path / "s.pvd")
    series.record(packing, 1000)
    assert vg.load(next((tmp_path / "s").iterdir())).gravity == packing.gravity


def test_the_hash_knows_gravity_and_gap():
    assert len({content_hash(some(**more)) for more in ({}, {"gravity": None}, {"contact_gap": 0.1})}) == 3


def test_statistics_say_where_gravity_acts(tmp_path):
    tree = vg.measure(some(gravity=(3, 0, -4), contact_gap=0.25), which=["grains"])
    assert tree.attrs == {"unit": "1", "gravity": (0.6, 0.0, -0.8), "contact_gap": 0.25}
    vg.save_statistics(tree, tmp_path / "s.nc")
    again = vg.load_statistics(tmp_path / "s.nc")
    assert np.array_equal(again.attrs["gravity"], [0.6, 0.0, -0.8])
    assert again.attrs["contact_gap"] == 0.25
    assert vg.measure(some(gravity=None), which=["grains"]).attrs["gravity"] == "none"


def older(packing, **changes):
    """Return a packing read from a record of before the fields were there."""
    record = to_record(packing)
    for name in ("gravity", "contact_gap"):
        del record.arrays[name]
    del record.texts["asked_sizes"]
    record.texts.update(changes)
    return from_record(record)


@pytest.mark.parametrize(
    ("parameters", "gravity", "gap"),
    [
        ({"gravity": "+x", "voxel_size": 0.05}, (1.0, 0.0, 0.0), 0.05),
        ({"gravity": [0.0, 3.0, -4.0], "spacing": 0.1}, (0.0, 0.6, -0.8), 0.1),
        ({"gravity": None, "spacing": 0.1, "voxel_size": None}, (0.0, 0.0, -1.0), 0.1),
        ({"gravity": "none"}, None, 0.0),
        ({"gravity": "nonsense", "voxel_size": [1, 2]}, None, 0.0),
        ({}, (0.0, 0.0, -1.0), 0.0),
    ],
)
def test_older_files_have_them_in_their_provenance(parameters, gravity, gap):
    found = older(some(provenance={"parameters": parameters}))
    assert found.gravity == gravity
    assert found.contact_gap == pytest.approx(gap)
    assert found.asked_sizes is None


def test_older_files_with_spacing_and_sizes():
    law = vg.sizes.uniform(0.5, 2.5)
    record = {"parameters": {"spacing": 0.1}, "median_diameter": 2.0, "asked": {"sizes": law.to_mapping()}}
    found = older(some(provenance=record))
    assert found.contact_gap == pytest.approx(0.2)
    assert found.asked_sizes == law
    assert older(some(provenance={"asked": {"sizes": {"kind": "unheard of"}}})).asked_sizes is None
    assert older(some(vg.Box((4, 4, 4), "z"), provenance={"parameters": {"gravity": "-z"}})).gravity is None


def test_units_of_older_files():
    rock = dataclasses.replace(BALL, unit="mm")
    made = vg.Packing.of([rock], vg.Box((4, 4, 4)), position=[(1, 1, 1)])
    assert older(made, unit="1").unit == "mm"
    assert older(made, unit="furlong").unit == "mm"
    assert older(some(), unit="furlong").unit == "1"
    # lengths were taken as they stand, in whatever unit the shape was
    metres = older(made, unit="m")
    assert (metres.unit, metres.shapes[0].unit, metres.diameters.tolist()) == ("m", None, [1.0])


def test_a_damaged_field_is_a_damaged_file():
    for name, value in (
        ("contact_gap", np.array([-1.0])),
        ("gravity", np.array([np.nan, 0, 1])),
        ("gravity", np.ones(2)),
    ):
        record = to_record(some())
        record.arrays[name] = value
        with pytest.raises(FileFormatError, match="holds no packing of voxgran"):
            from_record(record)
    record = to_record(some())
    record.texts["asked_sizes"] = json.dumps({"kind": "unheard of"})
    with pytest.raises(FileFormatError, match="holds no packing of voxgran"):
        from_record(record)


@pytest.mark.parametrize(("told", "unit"), [("mm", "mm"), ("in", "inch"), ("\u00b5m", "um"), ("furlong", "1")])
def test_a_table_of_spheres_names_its_unit(told, unit, tmp_path):
    path = tmp_path / "s.txt"
    path.write_text(f"# unit {told}\n1 1 1 0.5\n3 3 3 0.5\n", encoding="utf-8")
    packing = vg.load(path)
    assert packing.unit == unit
    assert packing.gravity == (0.0, 0.0, -1.0)
    assumed = packing.provenance["assumed"].get("unit")
    assert assumed == (None if unit != "1" else "'furlong' is no unit that is known: lengths are taken as they stand")
    if unit in ("1", "cm"):
        assert vg.load(path, unit="cm").unit == "cm"
        return
    with pytest.raises(InputError, match=f"unit is 'cm' and .* has its lengths in {unit}: leave unit out, and convert"):
        vg.load(path, unit="cm")


class Ring(vg.Cylinder):
    """A container of a class that is not registered."""


class Law(type(vg.sizes.fixed(1.0))):
    """A distribution of such a class."""


def test_what_cannot_be_loaded_is_not_saved(tmp_path):
    own = some(Ring(3.0, 4.0, origin=(2.0, 2.0, 0.0)))
    some().save(tmp_path / "p.vtp")
    before = (tmp_path / "p.vtp").read_bytes()
    with pytest.raises(
        InputError, match="container is a Ring, a class that is not registered: load could not make it again; register"
    ):
        vg.save(own, tmp_path / "p.vtp", overwrite=True)
    for name in ("p.txt", "q.vtp"):
        with pytest.raises(InputError, match="container is a Ring"):
            vg.save(own, tmp_path / name)
        with pytest.raises(InputError, match="container is a Ring"):
            check_savable(own, tmp_path / name)
    with pytest.raises(InputError, match=r"asked_sizes is a Law, .* leave it out with dataclasses.replace"):
        vg.save(some(asked_sizes=Law(diameter=1.0)), tmp_path / "p.vtp", overwrite=True)
    assert (tmp_path / "p.vtp").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["p.vtp"]
    # a table of spheres keeps no container
    vg.save(own, tmp_path / "p.csv")
    assert vg.load(tmp_path / "p.csv", container=vg.Cylinder(3.0, 4.0, origin=(2.0, 2.0, 0.0))).count == 2
    dataclasses.replace(own, container=vg.Box((4, 4, 4))).save(tmp_path / "q.vtp")
    assert vg.load(tmp_path / "q.vtp").container == vg.Box((4, 4, 4))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"unit": "bad"}, "unit 'bad' is unknown"),
        ({"unit": 5}, "unit is 5"),
        ({"stop_reason": "foo"}, "stop_reason is 'foo'"),
        ({"gravity": "up"}, "gravity is 'up'"),
        ({"gravity": (0.0, 1.0)}, "gravity"),
        ({"contact_gap": -1.0}, "contact_gap is -1.0"),
        ({"contact_gap": float("nan")}, "contact_gap is nan"),
        ({"provenance": 5}, "provenance is 5"),
        ({"asked_sizes": 5}, "asked_sizes is 5"),
        ({"relaxation": 5}, "relaxation is 5"),
        ({"forces": 5}, "forces are of type int"),
        ({"lid": 5}, "lid is 5"),
        ({"density": -1.0}, "density is -1.0"),
        ({"position": np.zeros((3, 3))}, "scale has shape"),
        ({"position": np.full((2, 3), np.nan)}, "position is nan"),
        ({"scale": np.array([1.0, -1.0])}, "scale is -1.0 for grain 1"),
        ({"shape_id": np.array([0, 1])}, "shape_id is 1 at index 1"),
        ({"orientation": np.zeros((2, 4))}, "orientation has length 0 at row 0"),
        (
            {"shapes": (dataclasses.replace(BALL, unit="mm"),), "unit": "um"},
            "unit is um and shape 'sphere' has its lengths in mm",
        ),
    ],
)
def test_fields_that_are_replaced_are_checked_as_those_that_are_given(change, words):
    with pytest.raises(InputError, match=words):
        dataclasses.replace(some(), **change)


def test_replaced_fields_come_back(tmp_path):
    made = dataclasses.replace(some(), unit="µm", gravity=(0, 0, -2), shapes=[BALL])
    assert (made.unit, made.gravity, made.shapes) == ("um", (0.0, 0.0, -1.0), (BALL,))
    made.save(tmp_path / "p.vtp")
    assert vg.load(tmp_path / "p.vtp") == made


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("shapes", 5, "shapes is 5: it must be a list of shapes"),
        ("shapes", "bad", "shapes is 'bad': it must be a list of shapes"),
        ("scale", None, "scale is None: it must be an array"),
        ("orientation", None, "orientation is None: it must be an array"),
        ("lid", 5, "lid is 5: it must be that of another packing or None$"),
    ],
)
def test_fields_that_are_replaced_by_no_such_thing_are_refused(field, value, words):
    with pytest.raises(InputError, match=words):
        dataclasses.replace(some(), **{field: value})
