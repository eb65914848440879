"""Axes of a study: what values change in a scene, what they are called, and one sentence per mistake."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, MissingFileError, UnknownNameError
from voxgran.study.axes import axis_values, changed

BASE = {
    "scene": {"seed": 4, "seeds": 3, "unit": "mm"},
    "shape": [{"family": "sphere"}],
    "sizes": {"kind": "lognormal", "median": 1.0, "sigma": 0.2, "share_by": "volume"},
    "container": {"kind": "box", "lengths": [5, 5, 5]},
    "packing": {"method": "rsa", "count": 10},
    "measure": {"which": ["density"]},
}


def study(axes=None, base=BASE, **given):
    return vg.Study(base=base, axes=axes, **given)


def labels(axis, values):
    return [value.label for value in axis_values(axis, values)]


def test_all_combinations_of_values_are_cells():
    made = study({"packing.count": [5, 10], "sizes.sigma": (0.1, 0.2, 0.3)})
    cells = made.cells()
    assert [cell.place for cell in cells] == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]
    assert [(cell.scene.count, cell.scene.sizes.sigma) for cell in cells] == [
        (count, sigma) for count in (5, 10) for sigma in (0.1, 0.2, 0.3)
    ]
    assert cells[4].values == {"packing.count": 10, "sizes.sigma": 0.2}
    assert cells[4].name == "packing.count 10, sizes.sigma 0.2"
    assert made.seeds == (4, 5, 6)
    assert all(cell.scene.general.seed == 4 for cell in cells)


def test_a_study_runs_in_the_folder_out_where_none_is_given(tmp_path, monkeypatch, here):
    monkeypatch.chdir(tmp_path)
    result = study({"packing.count": [5]}, seeds=[1]).run()
    assert result.folder.resolve() == (tmp_path / "out").resolve()
    assert (tmp_path / "out" / "study.nc").exists()


def test_a_study_without_axes_is_the_base():
    (cell,) = study().cells()
    assert cell.values == {}
    assert cell.scene.to_mapping()["packing"] == {"method": "rsa", "count": 10}


def test_seeds_are_counted_from_that_of_the_base_or_listed():
    assert study(seeds=2).seeds == (4, 5)
    assert study(seeds=[9, 1]).seeds == (9, 1)
    assert study(seeds=np.array([3])).seeds == (3,)
    for wrong in (0, [], [1, 1], [-1], 1.5, "3"):
        with pytest.raises(InputError, match="seeds"):
            study(seeds=wrong)


def test_friction_is_one_axis_for_all_methods_that_settle():
    assert axis_values("friction", [0.1, 0.5])[1].label == 0.5
    bed = changed(BASE, {"friction": 0.3, "method": "gravity"})
    assert bed["packing"]["friction"] == 0.3
    assert "settle" not in bed
    walk = changed(BASE, {"friction": 0.3, "settle": True, "method": "digital"})
    assert walk["settle"] == {"enabled": True, "friction": 0.3}
    assert "friction" not in walk["packing"]


def test_methods_are_names_or_tables_and_may_settle():
    values = ["digital", {"method": "gravity", "friction": 0.3}, {"name": "digital", "settle": {"friction": 0.1}}]
    third = axis_values("method", values)[2].given
    made = changed(BASE | {"settle": {"rest": 0.9}}, {"method": third})
    assert made["packing"] == {"method": "digital", "count": 10}
    assert made["settle"] == {"rest": 0.9, "friction": 0.1}
    assert changed(BASE, {"method": {"method": "digital", "settle": False}})["settle"] == {"enabled": False}
    assert labels("method", values) == ["digital", "gravity", "method digital, settle friction 0.1"]
    assert labels("method", [values[0], {**values[2], "label": "at rest"}]) == ["digital", "at rest"]
    by_object = axis_values("method", [vg.methods.Rsa(tries=50)])[0]
    assert by_object.given == {"method": "rsa", "tries": 50}
    cells = study({"method": ["rsa", {"method": "expand", "solid_fraction": 0.3}]}).cells()
    assert [(cell.scene.method, cell.scene.solid_fraction) for cell in cells] == [("rsa", None), ("expand", 0.3)]


def test_shapes_are_families_files_tables_or_mixtures(data_dir):
    eros = str(data_dir / "eros.obj")
    values = ["sphere", eros, {"family": "ellipsoid", "semi_axes": [1, 1, 2]}, ["sphere", "box"]]
    cells = study({"shape": values}).cells()
    assert [[(entry.source, entry.name) for entry in cell.scene.shapes] for cell in cells] == [
        [("family", "sphere")],
        [("file", eros)],
        [("family", "ellipsoid")],
        [("family", "sphere"), ("family", "box")],
    ]
    assert [cell.values["shape"] for cell in cells] == ["sphere", "eros", "ellipsoid", "sphere + box"]


def test_sizes_and_containers_are_replaced_by_kind_or_changed_by_key():
    made = changed(BASE, {"sizes": {"kind": "fixed", "diameter": 1.0}, "container": {"periodic": ["x"]}})
    assert made["sizes"] == {"kind": "fixed", "diameter": 1.0, "share_by": "volume"}
    assert made["container"] == {"kind": "box", "lengths": [5, 5, 5], "periodic": ["x"]}
    made = changed(BASE, {"sizes": {"sigma": 0.4}})
    assert made["sizes"] == BASE["sizes"] | {"sigma": 0.4}
    assert BASE["sizes"]["sigma"] == 0.2
    cells = study({"container": [vg.Box((4, 4, 4)), vg.Cylinder(2, 5)], "sizes": [vg.sizes.uniform(0.5, 1.0)]}).cells()
    assert [cell.scene.container.kind for cell in cells] == ["box", "cylinder"]
    assert [cell.values["container"] for cell in cells] == ["box", "cylinder"]


def test_paths_lead_into_sections_and_shapes():
    two = BASE | {"shape": [{"family": "box", "lengths": [1, 1, 1]}, {"family": "sphere"}]}
    assert [e["share"] for e in changed(two, {"shape.share": 0.5})["shape"]] == [0.5, 0.5]
    one = changed(two, {"shape.0.lengths": [1, 2, 3]})["shape"]
    assert one[0]["lengths"] == [1, 2, 3]
    assert one[1:] == two["shape"][1:]
    assert changed(BASE, {"packing.shaking.duration": 3})["packing"]["shaking"] == {"duration": 3}
    with pytest.raises(InputError, match=r"2 \[\[shape\]\]"):
        changed(two, {"shape.2.share": 1})
    with pytest.raises(InputError, match="no table"):
        changed(BASE, {"packing.count.many": 1})
    # a whole key of a single axis is set after the table that it is in
    made = changed(BASE, {"packing.tries": 7, "method": {"method": "rsa", "tries": 5}})
    assert made["packing"]["tries"] == 7


def test_toml_without_quotes_makes_tables_of_axes():
    cells = study({"packing": {"count": [5, 6]}}).cells()
    assert [cell.values for cell in cells] == [{"packing.count": 5}, {"packing.count": 6}]


def test_labels_are_numbers_only_where_all_values_are():
    assert labels("packing.count", [5, 6.5]) == [5, 6.5]
    assert labels("packing.count", np.array([5, 6])) == [5, 6]
    assert labels("container.lengths", [[1, 2, 3], [2, 2, 2]]) == ["[1, 2, 3]", "[2, 2, 2]"]
    assert labels("settle.enabled", [True, False]) == ["true", "false"]
    assert labels("settle", [False, {"friction": 0.3}]) == ["false", "friction 0.3"]
    assert labels("container.lengths", [{"label": "small"}]) == ["small"]


def test_zipped_axes_share_one_dimension():
    axes = {"packing.count": [5, 10], "sizes.sigma": [0.1, 0.2], "sizes.median": [0.5, 0.6, 0.7]}
    made = study(axes, zip=[["packing.count", "sizes.sigma"]])
    assert len(made.cells()) == 6
    assert [cell.place for cell in made.cells()][:2] == [(0, 0), (0, 1)]
    assert {(cell.scene.count, cell.scene.sizes.sigma) for cell in made.cells()} == {(5, 0.1), (10, 0.2)}
    two = {axis: axes[axis] for axis in ("packing.count", "sizes.sigma")}
    assert len(study(two, combine="zip").cells()) == 2
    # values may repeat where the pairs differ
    assert len(study({"packing.count": [5, 5], "sizes.sigma": [0.1, 0.2]}, combine="zip").cells()) == 2
    with pytest.raises(InputError, match=r"packing.count 2, sizes.sigma 2, sizes.median 3"):
        study(axes, combine="zip")
    with pytest.raises(UnknownNameError, match=r"did you mean 'sizes.sigma'"):
        study(axes, zip=[["packing.count", "sizes.sigm"]])
    with pytest.raises(InputError, match="twice"):
        study(axes, zip=[["packing.count", "sizes.sigma"], ["sizes.sigma", "sizes.median"]])
    with pytest.raises(InputError, match="list of axes"):
        study(axes, zip=["packing.count", "sizes.sigma"])
    with pytest.raises(InputError, match="'cross' or 'zip'"):
        study(axes, combine="product")


def test_different_values_of_listed_cells_are_called_differently():
    smooth, rough = ({"method": "gravity", "friction": friction} for friction in (0.0, 1.0))
    listed = [{"label": name, "method": value} for name, value in (("a", smooth), ("b", rough), ("c", smooth))]
    cells = study(cells=[*listed, {"label": "d", "method": "digital"}]).cells()
    methods = [cell.values["method"] for cell in cells]
    assert methods == ["method gravity, friction 0.0", "method gravity, friction 1.0", methods[0], "digital"]
    one = [{"label": name, "method": smooth, "packing.count": count} for name, count in (("a", 5), ("b", 6))]
    assert [cell.values["method"] for cell in study(cells=one).cells()] == ["gravity", "gravity"]
    named = [{"label": name, "method": value | {"label": "bed"}} for name, value in (("a", smooth), ("b", rough))]
    with pytest.raises(InputError, match="axis method has two values 'bed'"):
        study(cells=named)


def test_listed_cells_are_one_dimension():
    listed = [{"packing.count": 5, "label": "few"}, {"method": {"method": "expand", "solid_fraction": 0.3}}]
    cells = study({"sizes.sigma": [0.1, 0.2]}, cells=listed).cells()
    assert [cell.values for cell in cells] == [
        {"sizes.sigma": 0.1, "cell": "few", "packing.count": "5"},
        {"sizes.sigma": 0.1, "cell": "method expand", "method": "expand"},
        {"sizes.sigma": 0.2, "cell": "few", "packing.count": "5"},
        {"sizes.sigma": 0.2, "cell": "method expand", "method": "expand"},
    ]
    with pytest.raises(InputError, match=r"\[axes\] and in \[\[cell\]\]"):
        study({"packing.count": [1]}, cells=[{"packing.count": 2}])
    with pytest.raises(InputError, match="two values 'few'"):
        study(cells=[listed[0], listed[0]])
    with pytest.raises(UnknownNameError, match="did you mean 'method'"):
        study(cells=[{"methd": "rsa"}])


@pytest.mark.parametrize(
    ("axis", "meant"),
    [
        ("methd", "method"),
        ("tries", "packing.tries"),
        ("paking.count", "packing"),
        ("packing.tires", "tries"),
        ("container.size", "lengths"),
        ("sizes.sigm", "sigma"),
        ("scene.densty", "density"),
        ("seds", "seeds"),
        ("count", "packing.count"),
        ("sigma", "sizes.sigma"),
        ("packing_count", "packing.count"),
    ],
)
def test_a_misspelt_axis_gets_a_suggestion(axis, meant):
    with pytest.raises(UnknownNameError, match=rf"{axis.split('.')[0]}.*did you mean '{meant}"):
        study({axis: [1, 2]})


@pytest.mark.parametrize("axis", ["seed", "seeds", "scene.seed", "scene.seeds", "scene"])
def test_seeds_are_no_axis(axis):
    with pytest.raises(InputError, match="seeds = 5"):
        study({axis: [{"seed": 1}] if axis == "scene" else [1, 2]})


def test_wrong_values_are_one_sentence():
    for axis, values, told in (
        ("packing.count", 5, r"must be a list of values; write \[5\]"),
        ("packing.count", "57", "must be a list"),
        ("packing.count", [], "at least one value"),
        ("packing.count", [5, 5], "two values 5"),
        ("packing.count", [5, -5], r"^cell packing.count -5: \[packing\] count is -5"),
        ("method", [3], "a name or a table"),
        ("shape", [[]], "a name or a table"),
        ("settle", ["on"], "a table of keys of"),
        ("output.vtk", [True], "same for all cells"),
        ("measure.which", [["density"]], "same for all cells"),
        ("method.tries", [5], "did you mean 'packing.tries'"),
        ("sizes", [{"kind": "lognormal"}], "sizes lognormal.*median is missing"),
    ):
        with pytest.raises(InputError, match=told):
            study({axis: values})
    with pytest.raises(MissingFileError, match=r"cell shape rock: .*rock.stl is not there"):
        study({"shape": ["rock.stl"]})


def test_a_parameter_that_a_method_has_not_is_one_sentence_for_all_cells():
    with pytest.raises(
        InputError, match=r"tries of 'expand' \(3 of 6 cells\); give such a key with its method"
    ) as told:
        study({"method": ["rsa", "expand"], "packing.tries": [5, 6, 7]})
    assert "{ method = 'rsa', tries = 5 }" in str(told.value)
    base = BASE | {"packing": {"method": "digital", "voxel_size": 0.1, "count": 5}}
    with pytest.raises(InputError, match=r"voxel_size of 'rsa' \(1 of 2 cells\)"):
        study({"method": ["digital", "rsa"]}, base)
    # with its method it is fine
    assert len(study({"method": [{"method": "digital", "voxel_size": 0.1}, "rsa"]}).cells()) == 2
    assert len(study(cells=[{"method": "expand", "packing.solid_fraction": 0.2}, {"packing.tries": 5}]).cells()) == 2


def test_a_base_is_a_scene_a_mapping_or_a_file(tmp_path):
    scene = vg.Scene.from_mapping(BASE)
    (tmp_path / "scene.toml").write_text(
        '[scene]\nseed = 4\nseeds = 3\nunit = "mm"\n[[shape]]\nfamily = "sphere"\n[sizes]\nkind = "lognormal"\n'
        'median = 1.0\nsigma = 0.2\nshare_by = "volume"\n[container]\nkind = "box"\nlengths = [5, 5, 5]\n'
        '[packing]\nmethod = "rsa"\ncount = 10\n[measure]\nwhich = ["density"]\n[output]\ndem = ["lammps"]\n'
    )
    (tmp_path / "study.toml").write_text('scene = "scene.toml"\n[axes]\npacking.count = [5, 6]\n')
    made = [
        study({"packing.count": [5, 6]}),
        study({"packing.count": [5, 6]}, scene),
        study({"packing.count": [5, 6]}, tmp_path / "scene.toml"),
        vg.Study(tmp_path / "study.toml"),
    ]
    assert len({tuple(cell.key for cell in one.cells()) for one in made}) == 1
    assert {one.seeds for one in made} == {(4, 5, 6)}
    for wrong in ({"base": 3}, {}, {"base": BASE, "source": "study.toml"}):
        with pytest.raises(InputError, match=r"base|Study"):
            vg.Study(wrong.pop("source", None), **wrong)


def test_a_study_file_says_what_it_is_of(tmp_path):
    path = tmp_path / "study.toml"
    for text, told in (
        ("seeds = 3\n", "neither scene nor base"),
        ('scene = "a.toml"\n[base.packing]\ncount = 3\n', "both scene and base"),
        ("scene = 3\n", "must be the path of a file"),
        ('sene = "scene.toml"\n', "did you mean 'scene'"),
        ("[packing]\ncount = 3\n", r"write \[base\.packing\], or scene ="),
        ('[[shape]]\nfamily = "sphere"\n', r"write \[\[base\.shape\]\]"),
        ("[study]\nseeds = 3\n", r"remove the line \[study\]"),
        ('method = ["rsa"]\n', r"write it below \[axes\]"),
        ("[base.paking]\ncount = 3\n", "did you mean 'packing'"),
        ('keep = "all"\n[base.packing]\ncount = 3\n', "keep is 'all'"),
        ("[base.packing]\ncount = 3\n[cell]\n", r"write \[\[cell\]\]"),
        ("[base.packing]\ncount = 3\n", r"\[\[shape\]\] is missing"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=told):
            vg.Study(path)
    path.write_text('scene = "scene.toml"\n')
    with pytest.raises(MissingFileError, match=r"scene.toml is not there"):
        vg.Study(path)


WALK = BASE | {"packing": {"method": "digital", "count": 5}}
SHELL = WALK | {"shape": [{"family": "shell"}]}


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (WALK, WALK | {"settle": {"enabled": True}}),
        (WALK, WALK | {"settle": {"friction": 0.5}}),
        (BASE, BASE | {"settle": {"enabled": False}}),
        (BASE, BASE | {"packing": BASE["packing"] | {"tries": 1000}}),
        (BASE, BASE | {"shape": [{"family": "sphere", "share": 1, "seed": 0}]}),
        (BASE | {"sizes": {}}, BASE | {"sizes": {"share_by": "number"}}),
        (BASE, BASE | {"material": {"friction": 0.1}}),
        (BASE | {"measure": {"which": ["density", "rdf"]}}, BASE | {"measure": {"which": ["rdf", "density"]}}),
        (WALK | {"settle": {"friction": 1}}, WALK | {"settle": {"friction": 1.0}}),
    ],
)  # fmt: skip
def test_scenes_that_are_the_same_have_the_same_hash(one, other):
    assert study({}, one).cells()[0].key == study({}, other).cells()[0].key


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (WALK, WALK | {"settle": {"enabled": False}}),
        (WALK, WALK | {"settle": {"friction": 0.4}}),
        (SHELL, SHELL | {"settle": {"enabled": True}}),
        (BASE | {"sizes": {}}, BASE | {"sizes": {"share_by": "volume"}}),
        (BASE, BASE | {"packing": BASE["packing"] | {"tries": 999}}),
    ],
)
def test_scenes_that_differ_have_different_hashes(one, other):
    assert study({}, one).cells()[0].key != study({}, other).cells()[0].key


DENSER = [{"family": "sphere", "density": 2.0}, {"family": "box", "density": 1.0}]
ALIKE = [{"family": "sphere", "density": 2.0}, {"family": "box", "density": 2.0}]
BED = BASE | {"packing": {"method": "gravity", "count": 5}}


@pytest.mark.parametrize(
    ("axes", "base", "told"),
    [
        ({"material": [{"friction": 0.1}, {"friction": 0.2}]}, BASE, "axis material: it is the contact law"),
        ({"material.friction": [0.1, 0.2]}, BASE, "axis material.friction: it is the contact law"),
        ({"scene.unit": ["mm", "m"]}, BASE, "all cells have one unit"),
        ({"shape.density": [1, 2]}, BED, "shape.density 1 and shape.density 2 give the same numbers"),
        ({"scene.density": [1, 2]}, BED, "give the same numbers"),
        ({"shape": [DENSER, {"shapes": ALIKE, "label": "alike"}]}, BASE, "shape sphere [+] box and shape alike give"),
        ({"settle": [True, {"enabled": True}]}, WALK, "settle true and settle enabled true give"),
        ({"packing.tries": [999, 1000], "settle": [False, {"enabled": False}]}, BASE, "settle false and settle"),
    ],
)
def test_axes_that_change_no_result_are_refused(axes, base, told):
    with pytest.raises(InputError, match=told):
        study(axes, base)


def test_cells_have_one_unit(tmp_path):
    vg.save_shape(vg.shapes.box(lengths=(1, 1, 1)), tmp_path / "b.stl")
    files = [{"file": str(tmp_path / "b.stl"), "unit": unit, "label": unit} for unit in ("mm", "um")]
    assert len(study({"shape": files}, BASE).cells()) == 2
    bare = BASE | {"scene": {"seed": 4}}
    with pytest.raises(InputError, match=r"unit is mm and um and \[scene\] unit is not given: .*give \[scene\] unit"):
        study({"shape": files}, bare)
    assert len(study({"shape": [files[0], "sphere"]}, bare).cells()) == 2


def test_densities_are_axes_where_grains_of_several_settle_and_where_packings_are_kept():
    assert len(study({"shape": [DENSER, {"shapes": ALIKE, "label": "alike"}]}, BED).cells()) == 2
    assert len(study({"shape.0.density": [1, 2, 3]}, BED | {"shape": DENSER}).cells()) == 3
    assert len(study({"shape.density": [1, 2]}, keep="packings").cells()) == 2


def test_values_that_differ_in_one_cell_alone_are_an_axis():
    densities = {"shape.0.density": [1, 3], "method": ["rsa", {"method": "gravity", "label": "bed"}]}
    made = study(densities, BASE | {"shape": DENSER})
    assert [cell.values["shape.0.density"] for cell in made.cells()] == [1, 1, 3, 3]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the bulk holds", "ignore:in 4 of 4 cells")
@pytest.mark.usefixtures("forked_workers")
def test_layers_and_obstacles_are_varied_and_packed_as_in_single_scenes(tmp_path, monkeypatch):
    vg.save_shape(vg.shapes.box(lengths=(0.5, 0.5, 0.5)), tmp_path / "bar.stl")
    base = {
        "layer": [{"shape": [{"family": "sphere"}], "count": 2}, {"shape": [{"file": "bar.stl"}], "count": 2}],
        "container": {"kind": "box", "lengths": [3, 3, 10]},
        "packing": {"method": "gravity"},
        "obstacle": [{"family": "sphere", "position": [1.5, 1.5, 0.5], "scale": 1.0}],
        "measure": {"which": ["density"]},
    }
    monkeypatch.chdir(tmp_path)
    study = vg.Study(base=base, axes={"layer.1.count": [1, 2], "obstacle.0.scale": [0.5, 1.0]}, seeds=[0])
    data = study.run("out", workers=1).dataset
    for cell in study.cells()[::3]:
        single = vg.Scene.from_mapping(cell.mapping | {"output": {"report": False, "statistics": False}})
        packing = single.run("_".join(map(str, cell.place))).packing
        assert data["solid_fraction"].sel(cell.values).item() == packing.solid_fraction
        assert packing.count == 2 + cell.values["layer.1.count"]


@pytest.mark.parametrize("axis", ["layer.0.count", "obstacle.friction", "layer.count"])
def test_axes_of_entries_that_are_not_there_are_refused(base, axis):
    with pytest.raises(InputError, match=rf"axis {axis}: the scene has 0 \[\["):
        vg.Study(base=base, axes={axis: [1, 2]}).cells()
