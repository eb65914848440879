"""`measure`: what is in the tree, for which packing, at what cost."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
import xarray
from kit import column, lattice

from voxgran._base.errors import InputError, PackingWarning, UnknownNameError
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.io.netcdf import load_statistics, save_statistics
from voxgran.measures.model import Measure, measure, measure_registry, measures
from voxgran.measures.registered.profile import axis_profile
from voxgran.packing.model import Packing
from voxgran.settling.relaxation import Relaxation
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
DISK = Shape.of(Outline("disk", radius=0.5), name="disk")
ALL = (
    "compression",
    "contacts",
    "coordination",
    "density",
    "fabric",
    "forces",
    "gradation",
    "grains",
    "homogeneity",
    "local_density",
    "profile",
    "provenance",
    "rdf",
    "relaxation",
    "repose",
    "segregation",
    "strict",
    "transport",
    "voids",
)


def some(count=60, **more):
    """Return spheres side by side in a periodic box."""
    position = lattice(4, 4, 4)[:count]
    return Packing.of([BALL], Box((4, 4, 4), periodic="xyz"), position=position, **more)


def test_the_names():
    assert set(measures()) == set(ALL)
    for name in ALL:
        entry = measure_registry().get(name)
        assert isinstance(entry, Measure)
        assert entry.name == name
        assert entry.summary


def test_all_and_the_usual():
    usual, every = measure(some()), measure(some(), which="all")
    assert set(usual.groups) <= set(every.groups)
    assert set(measure(some(), which=["density", "all"]).groups) == set(every.groups)


def test_an_unknown_name():
    with pytest.raises(UnknownNameError, match="measure 'densty' is unknown: did you mean 'density'"):
        measure(some(), which=["densty"])
    with pytest.raises(UnknownNameError, match="measure 'window' is unknown"):
        measure(some(), which=["window"])


@pytest.mark.parametrize("name", ALL)
def test_each_measure_fills_the_groups_that_it_names(name):
    entry = measure_registry().get(name)
    packing = column(5) if name in ("forces", "compression") else some()
    if name == "compression":
        packing = replace(packing, forces=replace(packing.forces, stress=np.eye(3)))
    if name == "relaxation":
        numbers = dict.fromkeys(("sinking", "largest_displacement", "coordination_before", "duration"), 0.5)
        packing = replace(packing, relaxation=Relaxation(engine="lammps", coordination_after=2.0, **numbers))
    assert set(entry.compute(packing)) == set(entry.groups)
    tree = measure(packing, which=[name])
    assert set(tree.groups) == {"/", "/provenance", *entry.groups}


def test_a_single_name_may_be_given_as_text():
    assert set(measure(some(), which="density").groups) == {"/", "/provenance"}


def every_variable(tree):
    """Yield path and variable of all variables and coordinates."""
    for node in tree.subtree:
        for name, found in node.to_dataset(inherit=False).variables.items():
            yield f"{node.path}/{name}", found


@pytest.mark.parametrize("unit", ["1", "mm"])
def test_units_and_names_everywhere(unit):
    tree = measure(some(unit=unit))
    assert set(tree.groups) == {
        *("/", "/grains", "/contacts", "/contact_numbers", "/fabric", "/profiles", "/gradation", "/provenance")
    }
    for path, found in every_variable(tree):
        assert found.attrs["units"], path
        assert len(found.attrs["long_name"]) > 3, path
        for value in found.attrs.values():
            assert type(value) in (str, float, int), path
        if unit == "1" and path != "/provenance/wall_seconds":
            assert found.attrs["units"] == "1", path
    assert tree.attrs["unit"] == unit


def test_it_survives_a_file(tmp_path):
    tree = measure(some(unit="mm", provenance={"method": "digital", "timing": {"wall_seconds": 1.0}}))
    save_statistics(tree, tmp_path / "a.nc")
    again = load_statistics(tmp_path / "a.nc")
    for (path, found), (_, read) in zip(every_variable(tree), every_variable(again), strict=True):
        assert found.dims == read.dims, path
        assert (found.dtype.kind in "UO") or np.array_equal(found.values, read.values, equal_nan=True), path
        assert found.attrs["units"] == read.attrs["units"], path
    assert str(again["provenance"].record.values) == str(tree["provenance"].record.values)


@pytest.mark.parametrize("dimension", [2, 3])
def test_no_grains_measure_without_warnings(dimension, tmp_path):
    container = Box((4, 4, 4)) if dimension == 3 else Rectangle((4, 4))
    shapes = [BALL] if dimension == 3 else [DISK]
    for given in (shapes, []):
        with warnings.catch_warnings(action="error"):
            tree = measure(Packing.of(given, container, position=np.zeros((0, 3))))
            save_statistics(tree, tmp_path / "empty.nc", overwrite=True)
        assert int(tree["count"]) == 0
        assert float(tree.solid_fraction) == 0.0
        assert math.isnan(float(tree.bulk_solid_fraction))
        assert tree["grains"].sizes["grain"] == tree["contacts"].sizes["contact"] == 0


def test_disks():
    position = np.stack(np.meshgrid(np.arange(8) + 0.5, np.arange(8) + 0.5, [0.0], indexing="ij"), axis=-1)
    packing = Packing.of([DISK], Rectangle((8, 8), periodic="xy"), position=position.reshape(-1, 3), unit="cm")
    tree = measure(packing)
    assert float(tree.bulk_solid_fraction) == pytest.approx(math.pi / 4, rel=1e-12)
    assert tree.grain_volume.attrs == {"units": "cm^2", "long_name": "area of all grains together"}
    assert (tree["grains"].coordination_number == 4).all()
    assert set(tree["profiles"].coords) == {"gap", "x", "y"}


def test_the_rows_of_the_grains():
    packing = some(5, scale=np.array([1.0, 0.9, 0.8, 0.7, 0.6]), unit="mm")
    grains = measure(packing, which=["grains"])["grains"]
    assert np.array_equal(np.stack([grains.x, grains.y, grains.z], axis=1), packing.position)
    assert np.array_equal(grains.diameter, packing.diameters)
    assert np.array_equal(grains.volume, packing.volumes)
    assert np.array_equal(grains.orientation, packing.orientation)
    assert np.array_equal(grains.scale, packing.scale)
    assert grains.volume.attrs["units"] == "mm^3"
    assert grains.intermediate_axis.values == pytest.approx(packing.diameters)
    assert grains.shape_id.dtype == np.int64


def test_little_is_computed_that_is_not_asked():
    packing = some()
    measure(packing, which=["density", "gradation", "grains"])
    assert not packing._contacts


def test_few_grains_warn_once():
    with pytest.warns(PackingWarning, match="the bulk holds") as found:
        tree = measure(Packing.of([BALL], Box((4, 4, 4)), position=[[2, 2, 2]]))
    assert len(found) == 1
    assert isinstance(tree, xarray.DataTree)


def test_the_relaxation_of_a_packing_that_was_not_relaxed():
    with pytest.raises(InputError, match=r"relaxation of the packing is None: .*; use relax"):
        measure(some(), "relaxation")


def test_unknown_names_beside_all():
    with pytest.raises(UnknownNameError, match="did you mean 'fabric'"):
        measure(some(), ["all", "fabrik"])


@pytest.mark.parametrize("guess", ["by", "by_material", "group_by", "per_shape"])
def test_a_measure_of_each_material_is_that_of_its_grains(guess):
    bed = Packing.of([BALL] * 2, Box((4, 4, 4)), position=[(1, 1, 1), (3, 1, 3)], shape_id=[0, 1])
    with pytest.raises(InputError, match=r"measure\(packing\[packing.shape_id == 0\], \"profile\"\)"):
        measure(bed, "profile", **{guess: "shape"})
    both = axis_profile(bed, "z", bins=8).solid_fraction
    parts = [axis_profile(bed[bed.shape_id == number], "z", bins=8).solid_fraction for number in (0, 1)]
    np.testing.assert_allclose(sum(parts), both)
    assert not (parts[0] * parts[1]).any()
