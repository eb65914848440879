"""Lists of grains: each row is placed once, and the packing says which row each grain is."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import voxgran as vg
from voxgran._base.errors import (
    CallError,
    FileFormatError,
    GrainTooLargeError,
    InputError,
    PackingWarning,
    TooLargeError,
    UnknownNameError,
)
from voxgran.packing.draw import Request
from voxgran.packing.pack import prepare_task
from voxgran.shapes.size_laws.listed import in_turn

SPHERE, BRICK = vg.shapes.sphere(), vg.shapes.box(lengths=(1.1, 0.9, 0.7))
BOX = vg.Box((4, 4, 4))
LIST = {"shape": ["box", "sphere", "box", "sphere"], "diameter": [1.0, 0.5, 0.8, 0.6], "count": [1, 3, 0, 2]}
ROWS = [0, 1, 1, 1, 3, 3]


def pack(grains, shapes=(BRICK, SPHERE), container=BOX, **asked):
    """Return the packing of a list at random."""
    return vg.pack(list(shapes), container, "rsa", grains=grains, **asked)


def task(grains, shapes=(BRICK, SPHERE), container=BOX, **asked):
    """Return the task of a list, before anything is packed."""
    return prepare_task(Request(list(shapes), container, "rsa", grains=grains, **asked))


def test_tables_of_all_kinds_are_one_list(tmp_path):
    frame = pd.DataFrame(LIST)
    frame.rename(columns={"diameter": "Diameter [mm]"}).to_csv(tmp_path / "list.csv", index=False)
    lines = ["# of a Tuesday", "Shape;d [um];Count", "box;1000,0;1", "sphere;500,0;3", "box;800,0;0", "sphere;600;2"]
    (tmp_path / "european.csv").write_text("\n".join(lines), encoding="utf-8")
    known = pack(LIST, unit="mm")
    assert sorted(known.grain_id) == ROWS
    by_index = LIST | {"shape": [0, 1, 0, 1]}
    for grains in (by_index, frame, tmp_path / "list.csv", str(tmp_path / "european.csv")):
        packing = pack(grains, unit="mm")
        assert packing == known
        assert packing.grain_id.tolist() == known.grain_id.tolist()


@pytest.mark.parametrize(
    "text", ["diameter [um]\n1000\n500.5\n", "diameter\n1.0\n0.5005\n", "d [mm]\n1,0\n0,5005 # wet\n"]
)
def test_a_file_of_one_column_is_read_as_one(tmp_path, text):
    (tmp_path / "list.csv").write_text(text, encoding="utf-8")
    assert task(tmp_path / "list.csv", [SPHERE], unit="mm").sizes.diameters == pytest.approx((0.5005, 1.0))


def test_methods_that_place_grains_as_they_are_take_lists():
    with pytest.raises(InputError) as found:
        vg.pack(SPHERE, BOX, "voronoi_fill", grains={"diameter": [1.0]})
    scaling = {"apollonian", "growth", "jam", "random_apollonian", "tetrahedral", "voronoi_fill"}
    assert set(str(found.value).partition(", one of ")[2].split(", ")) >= set(vg.packing_methods()) - scaling
    assert not scaling & set(str(found.value).partition(", one of ")[2].split(", "))


def test_shapes_are_placed_each_once_at_their_own_size():
    rocks = [BRICK, SPHERE.scaled(0.7), BRICK.scaled(0.9), SPHERE.scaled(0.7)]
    packing = vg.pack(grains=rocks, container=BOX, method="advancing_front")
    assert len(packing.shapes) == 3
    assert sorted(packing.grain_id) == [0, 1, 2, 3]
    for grain, row in zip(packing, packing.grain_id, strict=True):
        assert grain.shape == rocks[row]
        assert grain.scale == pytest.approx(1.0)
    heavy = vg.pack(grains=rocks, container=BOX, method="advancing_front", density=[1.0, 2.0, 3.0, 4.0])
    assert heavy.densities.tolist() == [1.0 + row for row in heavy.grain_id]


@pytest.mark.parametrize(("dimension", "unit_volume"), [(3, math.pi / 6.0), (2, math.pi / 4.0)])
def test_masses_are_volumes_times_densities(dimension, unit_volume):
    shapes = [SPHERE, BRICK] if dimension == 3 else [vg.shapes.disk(), vg.shapes.polygon(corners=5)]
    container = BOX if dimension == 3 else vg.Rectangle((4, 4))
    mass, shape = np.array([2.0, 0.4, 0.9]), [0, 1, 0]
    one = pack({"mass": mass, "shape": shape}, shapes, container, density=2.5)
    assert one.masses == pytest.approx(mass[one.grain_id])
    own = pack({"mass": mass, "shape": shape, "density": [2.5, 7.8, 2.5]}, shapes, container)
    assert own.masses == pytest.approx(mass[own.grain_id])
    assert own.densities == pytest.approx(np.array([2.5, 7.8, 2.5])[own.grain_id])
    assert one.diameters[one.grain_id == 0] == pytest.approx((2.0 / 2.5 / unit_volume) ** (1.0 / dimension))
    several = pack({"mass": mass, "shape": shape}, shapes, container, density=[2.5, 7.8])
    assert several.masses == pytest.approx(mass[several.grain_id])


@pytest.mark.parametrize("density", [{"density [g/cm3]": [2.65]}, {"density": [2650.0]}, {"rho [kg/m³]": [2650.0]}])
def test_masses_with_units_are_those_of_the_unit_of_lengths(density):
    packing = pack({"mass [g]": [1.0]} | density, [SPHERE], vg.Box((40, 40, 40)), unit="mm")
    assert packing.diameters[0] == pytest.approx(10.0 * (6.0 / math.pi / 2.65) ** (1 / 3))
    assert packing.density == pytest.approx(2650.0)


def test_rows_without_shapes_are_spheres_or_disks(tmp_path):
    (tmp_path / "list.csv").write_text("diameter,count\n1,2\n0.5,3\n", encoding="utf-8")
    packing = vg.pack(grains=tmp_path / "list.csv", container=BOX, method="rsa")
    assert [shape.name for shape in packing.shapes] == ["sphere"]
    assert sorted(packing.diameters) == [0.5, 0.5, 0.5, 1.0, 1.0]
    flat = vg.pack(grains={"mass": [1.0, 2.0]}, container=vg.Rectangle((4, 4)), method="rsa", density=2.0)
    assert [shape.name for shape in flat.shapes] == ["disk"]
    assert sorted(flat.masses) == pytest.approx([1.0, 2.0])
    # densities by row split the shape
    apart = vg.pack(grains={"diameter": [1.0, 0.5], "density": [2.0, 3.0]}, container=BOX, method="rsa")
    assert apart.densities.tolist() == [2.0 + row for row in apart.grain_id]
    # the list takes the shapes of the start
    more = vg.pack(container=BOX, method="rsa", start=pack(LIST), grains={"diameter": [0.4], "shape": ["box"]})
    assert more.shapes[more.shape_id[-1]] == BRICK
    with pytest.raises(FileFormatError, match="it must have 'diameter' or 'mass'; rename one"):
        vg.pack(grains={"shape": ["sphere"]}, container=BOX, method="rsa")
    with pytest.raises(CallError, match=r"^pack needs shapes; write pack\(shapes, Box"):
        vg.pack(container=BOX, method="rsa", count=3)
    with pytest.raises(CallError, match=r"^pack needs container and method; write pack"):
        vg.pack(grains={"diameter": [1.0]})


def test_families_of_shapes_are_known_by_name_where_no_shapes_are_given(tmp_path):
    (tmp_path / "list.csv").write_text("shape,diameter,density\nbox,1.0,2650\ntorus,0.8,7800\n")
    made = vg.pack(grains=tmp_path / "list.csv", container=vg.Box((6, 6, 6)), method="rsa", unit="mm")
    names = [made.shapes[k].name for k in made.shape_id]
    assert (names, made.diameters.tolist()) == (["box", "torus"], pytest.approx([1.0, 0.8]))
    assert made.densities.tolist() == [2650.0, 7800.0]
    with pytest.raises(UnknownNameError, match="'boxx' is unknown: did you mean 'box'"):
        vg.pack(grains={"shape": ["boxx"], "diameter": [1.0]}, container=vg.Box((6, 6, 6)), method="rsa")
    with pytest.raises(InputError, match="dimension 2: the container has 3"):
        vg.pack(grains={"shape": ["disk"], "diameter": [1.0]}, container=vg.Box((6, 6, 6)), method="rsa")


def test_densities_of_a_list_reach_input_files(tmp_path):
    table = {"diameter": [1.0, 0.8], "density": [2650, 7800]}
    made = vg.pack(grains=table, container=vg.Box((5, 5, 5)), method="rsa", unit="mm")
    vg.write_deck(made, tmp_path / "run", "lammps")
    atoms = (tmp_path / "run" / "lammps_grains.data").read_text().partition("Atoms")[2].split("\n")[2:4]
    # diameter and density, in SI units
    rows = np.array([atom.split()[2:4] for atom in atoms], dtype=float)
    assert rows == pytest.approx(np.array([(1e-3, 2650.0), (8e-4, 7800.0)]), rel=1e-12)


def test_shapes_of_one_name_are_taken_in_turn():
    rocks = [vg.make_shape("convex_polyhedron", seed=seed) for seed in range(3)]
    rows = {"shape": ["convex_polyhedron", "sphere", "convex_polyhedron"], "count": [4, 1, 2]}
    assert task(rows, [*rocks, SPHERE]).problem.shape_id.tolist() == [0, 1, 2, 0, 3, 1, 2]
    # without a column of shapes they have their shares, in each stretch of the list
    found = task({"diameter": np.full(400, 0.1)}, weights=[3, 1]).problem.shape_id
    assert [abs(int(found[k : k + 40].sum()) - 10) <= 1 for k in range(0, 400, 40)] == [True] * 10


def test_things_in_turn_have_their_shares_at_any_number():
    assert in_turn(np.array([0.0, 1.0, 0.0]), 5).tolist() == [1] * 5
    assert in_turn(np.full(3, 1 / 3), 7).tolist() == [0, 1, 2, 0, 1, 2, 0]
    for m in (1, 2, 5, 40):
        shares = np.random.Generator(np.random.Philox(m)).dirichlet(np.full(m, 0.3))
        found = in_turn(shares, 3000)
        assert len(found) == 3000
        many = np.cumsum(found[:, None] == np.arange(m), axis=0)
        assert np.abs(many - shares * np.arange(1, 3001)[:, None]).max() <= 0.5 + 0.5 * m * shares.max()


def test_an_index_is_no_name():
    # shapes of label images are called by numbers
    named = [replace(BRICK, name="1"), replace(SPHERE, name="0")]
    assert task({"shape": [0, 1]}, named).problem.shape_id.tolist() == [0, 1]
    assert task({"shape": ["0", "1"]}, named).problem.shape_id.tolist() == [1, 0]
    assert task(named, []).problem.shape_id.tolist() == [0, 1]


def test_a_clump_is_called_by_the_name_of_its_shape():
    clump = vg.fit_clump(BRICK, method="four_point", max_spheres=3).to_shape()
    assert pack({"shape": ["box", clump.name]}, [SPHERE, clump]).shape_id.tolist() == [1, 1]


BAD = [
    ({"diameter": [1.0, 0.0]}, {}, r"row 1: diameter is 0: it must be above 0"),
    ({"diameter": [-1.0]}, {}, r"row 0: diameter is -1: it must be above 0"),
    ({"diameter": [1.0, math.nan]}, {}, r"row 1: diameter is nan, and no number"),
    ({"diameter": [1.0, "wide"]}, {}, r"row 1: diameter is 'wide', and no number"),
    ({"colour": [1.0]}, {}, r"has the columns 'colour': it must have 'diameter', 'mass' or 'shape'"),
    ({"diameter": [1.0], "shape": ["bxo"]}, {}, r"row 0: shape 'bxo' is unknown: did you mean 'box'"),
    ({"diameter": [1.0], "shape": [2]}, {}, r"row 0: shape is 2: it must be the name .* from 0 to 1"),
    ({"diameter": [1.0, 1.0], "shape": [0, math.nan]}, {}, r"row 1: shape is nan, and no number"),
    ({"mass": [1.0]}, {}, r"has masses and no densities"),
    ({"mass [g]": [1.0]}, {"density": 2650.0}, r"lengths have no unit"),
    ({"mass": [1.0], "density [g/cm3]": [2.65]}, {"unit": "mm"}, r"masses have no unit: write it"),
    ({"mass [lb]": [1.0]}, {"density": 2650.0, "unit": "mm"}, r"must be one of kg, g, mg, t"),
    ({"diameter [mm]": [1.0]}, {}, r"has diameters in mm: give unit"),
    ({"diameter": [1.0], "density": [0.0]}, {}, r"row 0: density is 0: it must be above 0"),
    ({"diameter": [1.0], "density": [2.0]}, {"density": 2.0}, r"has densities and density is given too"),
    ({"diameter": [1.0], "count": [1.5]}, {}, r"row 0: count is 1.5: it must be a whole number"),
    ({"diameter": [1.0], "count": [0]}, {}, r"grains is empty"),
    ({"diameter": []}, {}, r"grains is empty"),
    (pd.DataFrame({"diameter": []}), {}, r"grains is empty"),
    ([], {}, r"grains is empty"),
    ([SPHERE], {}, r"it has its own; leave shapes out"),
    ([SPHERE], {"shapes": None}, r"shapes is None"),
    ([1.0, 2.0], {}, r"grains\[0\] is 1.0: it must be a Shape"),
    (3.0, {}, r"grains is 3.0: it must be a table"),
    ({"diameter": 3.0}, {}, r"diameter is 3.0, and no column"),
    ({"diameter": [1.0], "d": [1.0]}, {}, r"are both columns of diameter"),
    ({"diameter": [1.0], "shape": [0, 1]}, {}, r"columns of several lengths"),
    ({"diameter": [1.0]}, {"count": 3}, r"grains is given, and count is 3"),
    ({"diameter": [1.0]}, {"sizes": vg.sizes.fixed(1.0)}, r"grains is given, and sizes is Fixed"),
    ({"diameter": [1.0]}, {"solid_fraction": 0.3}, r"grains is given, and solid_fraction is 0.3"),
    ({"diameter": [1.0], "count": [1000]}, {}, r"8.18 times the volume of the container"),
    ({"diameter": [1.0], "count": [1e30]}, {}, r"need at least"),
    ({"diameter": [[1.0, 2.0]]}, {}, r"row 0: diameter is \[1.0, 2.0\], and no number"),
    ({"diameter": np.ones((2, 2))}, {}, r"row 0: diameter is array\(\[1., 1.\]\), and no number"),
]


@pytest.mark.parametrize(("grains", "asked", "words"), BAD)
def test_a_bad_list_is_one_sentence(grains, asked, words):
    shapes = asked.get("shapes", [BRICK, SPHERE])
    rest = {name: value for name, value in asked.items() if name != "shapes"}
    with pytest.raises((InputError, UnknownNameError, TooLargeError), match=words) as found:
        vg.pack(shapes, BOX, "rsa", grains=grains, **rest)
    assert "\n" not in str(found.value)


def test_a_bad_file_is_named_with_its_row(tmp_path):
    (tmp_path / "list.csv").write_text("diameter;shape\n1,0;box\n?;box\n", encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"list.csv \(rows from 0 on\), row 1: diameter is '\?', and no number"):
        pack(tmp_path / "list.csv")


def test_rows_that_cannot_fit_are_named_before_anything_is_packed():
    with pytest.raises(GrainTooLargeError, match=r"^rows 1, 3 of grains \(from 0 on\), of diameter 5, cannot fit"):
        task({"diameter": [1.0, 5.0, 0.5, 4.5, 9.0], "count": [1, 1, 1, 1, 0]}, [SPHERE])


def test_rows_that_find_no_room_are_named():
    with pytest.warns(PackingWarning) as found:
        packing = vg.pack(SPHERE, BOX, "rsa", grains={"diameter": [0.5, 2.2, 2.0, 1.9, 0.4, 1.8, 1.7]})
    lost = sorted(set(range(7)) - set(packing.grain_id.tolist()))
    assert lost
    assert packing.provenance["missed"]["count"] == len(lost)
    told = ", ".join(map(str, lost))
    (text,) = (str(entry.message) for entry in found)
    rows = "row" if len(lost) == 1 else "rows"
    assert text.startswith(f"{packing.count} of 7 grains were placed, without {rows} {told} of the list (from 0 on), ")
    assert "order='largest'" in text


def test_rows_stay_with_their_grains(tmp_path):
    packing = pack(LIST, unit="mm", seed=2)
    row = packing.grain_id
    assert packing[packing.diameter > 0.55].grain_id.tolist() == [0, 3, 3]
    assert packing[::-1].grain_id.tolist() == row[::-1].tolist()
    assert packing.to_unit("m").grain_id.tolist() == row.tolist()
    assert packing.to_dataframe().grain_id.tolist() == row.tolist()
    assert vg.grow(packing).grain_id.tolist() == row.tolist()
    assert vg.inscribe(packing, [BRICK]).grain_id.tolist() == row.tolist()
    assert packing.with_clumps(max_spheres=3).grain_id.tolist() == row.tolist()
    other = vg.Packing.of([SPHERE], BOX, position=[(2, 2, 2)], unit="mm", gravity="none")
    assert other.grain_id is None
    assert (packing + other).grain_id.tolist() == [*row, -1]
    assert (other + packing).grain_id.tolist() == [-1, *row]
    assert (other + other).grain_id is None
    with pytest.raises(InputError, match=r"grain_id is -2 at index 0: .* at least -1"):
        vg.Packing.of([SPHERE], BOX, position=[(2, 2, 2)], grain_id=[-2])
    vg.save(packing, tmp_path / "bed.vtp")
    assert vg.load(tmp_path / "bed.vtp").grain_id.tolist() == row.tolist()
    vg.save(other, tmp_path / "other.vtp")
    assert vg.load(tmp_path / "other.vtp").grain_id is None
    vg.save_statistics(vg.measure(packing, "grains"), tmp_path / "bed.nc")
    assert vg.load_statistics(tmp_path / "bed.nc")["grains"].grain_id.values.tolist() == row.tolist()


def test_rows_stay_with_their_grains_as_they_settle():
    bed = vg.settle(pack(LIST, seed=2), gravity="-z")
    assert sorted(bed.grain_id) == ROWS
    assert bed.diameters == pytest.approx(np.array(LIST["diameter"])[bed.grain_id])


def test_grains_of_a_start_are_of_no_row_or_of_their_own():
    start = pack({"diameter": [0.7, 0.6]}, [SPHERE])
    assert pack({"diameter": [0.5]}, [SPHERE], start=start).grain_id.tolist() == [0, 1, 0]
    without = vg.pack(SPHERE, BOX, "rsa", count=2, density=2.0)
    more = pack({"diameter": [0.5], "density": [3.0]}, [BRICK], start=without)
    assert more.grain_id.tolist() == [-1, -1, 0]
    assert more.densities.tolist() == [2.0, 2.0, 3.0]
    # a list for the shapes of the start
    assert pack({"diameter": [0.5]}, [], start=without).grain_id.tolist() == [-1, -1, 0]
    assert vg.pack(SPHERE, BOX, "rsa", count=1, start=start).grain_id.tolist() == [0, 1, -1]


def test_an_interrupted_list_goes_on_to_the_same_rows(tmp_path):
    asked = {"grains": LIST | {"count": [5, 5, 5, 5]}, "voxel_size": 0.1, "sweeps": 60, "settle": False}
    whole = vg.pack([BRICK, SPHERE], BOX, "digital", **asked)
    part = vg.pack([BRICK, SPHERE], BOX, "digital", checkpoint=tmp_path / "run", time_limit=0.0, **asked)
    assert part.stop_reason == "interrupted"
    again = vg.pack([BRICK, SPHERE], BOX, "digital", checkpoint=tmp_path / "run", resume=True, **asked)
    assert again == whole
    assert again.grain_id.tolist() == whole.grain_id.tolist()
    assert np.bincount(again.grain_id).tolist() == [5, 5, 5, 5]


def test_the_gradation_is_compared_with_the_list():
    packing = pack(LIST)
    assert packing.asked_sizes == vg.sizes.discrete([0.5, 0.6, 1.0], [3, 2, 1])
    found = vg.measure(packing, "gradation")["gradation"]
    assert float(found.distance_volume) == pytest.approx(0.0, abs=1e-12)
    assert float(found.distance_number) == pytest.approx(0.0, abs=1e-12)


def test_a_row_without_a_shape_is_named(tmp_path):
    (tmp_path / "list.csv").write_text("diameter,shape\n2,sphere\n1\n")
    with pytest.raises(InputError, match="row 1: shape is missing"):
        vg.pack(vg.make_shape("sphere"), vg.Box((9, 9, 9)), "rsa", grains=tmp_path / "list.csv")
