"""Comparison of packings: differences, what is claimed of them, one page and its twin."""

import json
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

import voxgran as vg
from voxgran._base.errors import InputError, OutputExistsError, PackingWarning
from voxgran._base.seeds import stream
from voxgran.measures.registered.coordination import coordination_number
from voxgran.measures.registered.density import main_fraction

pytestmark = [pytest.mark.filterwarnings("ignore:.*the bulk holds"), pytest.mark.usefixtures("jagged_pictures")]


def heap(seed, count, **provenance):
    position = stream(seed, "heap").uniform(0.5, 5.5, (count, 3))
    scale = stream(seed, "sizes").uniform(0.3, 0.6, count)
    box, record = vg.Box((6, 6, 6)), {"method": "rsa", "seed": seed, **provenance}
    return vg.Packing.of([vg.make_shape("sphere")], box, position=position, scale=scale, unit="mm", provenance=record)


@pytest.fixture(scope="module")
def groups():
    return {"few": [heap(k, 40) for k in range(4)], "many": [heap(k + 10, 60) for k in range(3)]}


def written(packings, tmp_path, **options):
    """Return the page and its twin."""
    vg.save_comparison(packings, tmp_path / "c.html", **{"pictures": False, "overwrite": True, **options})
    return (tmp_path / "c.html").read_text(), json.loads((tmp_path / "c.json").read_text())


def row_of(twin, name):
    return next(row for row in twin["numbers"] if row["name"] == name)["groups"]


def test_means_errors_and_significance_are_those_of_scipy(groups, tmp_path):
    text, twin = written(groups, tmp_path, which=["density", "coordination"])
    row = row_of(twin, "container_solid_fraction")
    few, many = ([packing.solid_fraction for packing in group] for group in groups.values())
    assert row["few"]["mean"] == pytest.approx(np.mean(few))
    assert row["many"]["standard_error"] == pytest.approx(scipy.stats.sem(many))
    assert row["many"]["difference"] == pytest.approx(np.mean(many) - np.mean(few))
    assert row["many"]["p_value"] == pytest.approx(scipy.stats.ttest_ind(many, few, equal_var=False).pvalue)
    assert row["many"]["verdict"] == "significant"
    assert "difference" not in row["few"]
    for words in ("significant, p", "±", "independent samples", "3 packings of 60 grains, rsa"):
        assert words in text
    assert "No significance is claimed" not in text
    assert "src=" not in text


def test_numbers_of_the_container_of_a_bed_are_named_after_it(tmp_path):
    beds = {name: replace(heap(k, 40), gravity=(0.0, 0.0, -1.0)) for k, name in enumerate(("one", "two"))}
    _, twin = written(beds, tmp_path, which=["density"])
    for place, bed in zip(twin["groups"], beds.values(), strict=True):
        assert (place["region"], place["solid_fraction"]) == main_fraction(bed)
        assert place["region"] == "bed"
        whole = {"solid_fraction": bed.solid_fraction, "porosity": bed.porosity}
        for name, value in whole.items():
            assert row_of(twin, f"container_{name}")[place["name"]]["mean"] == pytest.approx(value)
    names = [row["name"] for row in twin["numbers"]]
    assert not {"solid_fraction", "porosity"} & set(names)
    assert names.index("bed_solid_fraction") < names.index("container_solid_fraction")


def test_distances_over_grains_are_tested_by_regrouping_packings_only(groups, tmp_path):
    text, twin = written(groups, tmp_path, which=["density", "coordination"])
    tests = {test["what"]: test for test in twin["distributions"]}
    assert set(tests) == {"equivalent diameter", "coordination number"}
    sizes = [np.concatenate([p.diameters for p in group]) for group in groups.values()]
    assert tests["equivalent diameter"]["distance"] == pytest.approx(scipy.stats.ks_2samp(*sizes).statistic)
    # 35 ways of grouping four and three packings
    shares = 35 * tests["equivalent diameter"]["p_value"]
    assert shares == pytest.approx(round(shares))
    assert "no independent samples" in text
    fewer = {"few": groups["few"][:3], "many": groups["many"]}
    assert [test["p_value"] for test in written(fewer, tmp_path)[1]["distributions"]] == [None, None]


def test_coordination_is_counted_up_to_one_gap(groups, tmp_path):
    near = heap(30, 50)
    far = heap(31, 50)
    far = replace(far, contact_gap=0.08 * far.diameters.mean())
    text, twin = written({"near": near, "far": far}, tmp_path, which=["coordination"])
    assert "at a gap of at most 0.08 mean diameters" in text
    for name, packing in (("near", near), ("far", far)):
        counts = coordination_number(packing, reference_gap=0.08).of_grain
        assert row_of(twin, "coordination_number")[name]["mean"] == pytest.approx(counts.mean())


def test_single_packings_have_no_verdict(groups, tmp_path):
    pair = {"a": groups["few"][0], "b <i>": groups["many"][0]}
    text, twin = written(pair, tmp_path, which=["density"], pictures=True, interactive=False)
    assert "No significance is claimed for differences from or of a, b &lt;i&gt;, which have one packing each" in text
    # the letters of a picture spell short words
    told = re.sub(r"base64,[^\"]*", "", text)
    for words in ("significant,", "p =", "±", "nan"):
        assert words not in told
    assert "<i>" not in text.replace("<i role", "")
    assert text.count("data:image/png;base64,") == 2
    assert (tmp_path / "c.html").stat().st_size < 5e6
    expected = {"known": 1, "mean": 60.0, "standard_error": None}
    expected |= {"difference": 20.0, "p_value": None, "verdict": "not tested"}
    assert row_of(twin, "count")["b <i>"] == expected


def test_one_packing_against_several_has_no_verdict(groups, tmp_path):
    text, twin = written({"one": groups["few"][0], "many": groups["many"]}, tmp_path, which=["density"])
    assert "No significance is claimed for differences from or of one, which has one packing" in text
    assert "independent samples: a difference" not in text
    assert {row["groups"]["many"]["p_value"] for row in twin["numbers"]} == {None}


def test_equal_to_rounding_is_equal(groups, tmp_path):
    """A group that was moved by rounding differs in nothing, whatever a test of its rounding says."""
    moved = [replace(packing, scale=packing.scale * (1 + 1e-14 * (k + 1))) for k, packing in enumerate(groups["few"])]
    with warnings.catch_warnings(action="error"):
        warnings.filterwarnings("ignore", ".*the bulk holds")
        text, twin = written({"few": groups["few"][:1], "moved": moved[:1]}, tmp_path, which=["density"])
        several = written({"few": groups["few"], "moved": moved}, tmp_path, which=["density"])[1]
    for row in twin["numbers"]:
        if row["groups"]["few"]["mean"] is not None:
            assert row["groups"]["moved"]["verdict"] == "equal", row["name"]
            assert row["groups"]["moved"]["difference"] == 0.0
    known = [row["groups"]["few"]["mean"] is not None for row in twin["numbers"]]
    # each number that is known, and the distribution of sizes
    assert text.count("<td>equal</td>") == sum(known) + 1
    assert {row["groups"]["moved"]["verdict"] for row in several["numbers"]} == {"equal", "not tested"}
    assert {test["verdict"] for test in several["distributions"]} == {"equal"}
    assert row_of(several, "container_solid_fraction")["few"]["standard_error"] > 0
    assert row_of(several, "container_volume")["few"]["standard_error"] == 0.0


def test_numbers_without_scatter_are_not_tested(groups, tmp_path):
    text, twin = written(groups, tmp_path, which=["density"])
    assert row_of(twin, "count")["many"] == {
        "known": 3,
        "mean": 60.0,
        "standard_error": 0.0,
        "difference": 20.0,
        "p_value": None,
        "verdict": "not tested",
    }
    assert "<td>20</td>" in text


def test_what_is_not_known_stands_alone(groups, tmp_path):
    dense = heap(50, 400)
    text, twin = written({"few": groups["few"][:2], "part": [groups["few"][3], dense]}, tmp_path, which=["density"])
    row = row_of(twin, "bulk_solid_fraction")
    assert row["few"] == {"known": 0, "mean": None, "standard_error": None}
    assert row["part"]["known"] == 1
    assert row["part"]["mean"] == pytest.approx(float(vg.measure(dense, which=["density"])["bulk_solid_fraction"]))
    assert (row["part"]["difference"], row["part"]["p_value"]) == (None, None)
    assert "<td>not known</td>" in text
    assert "nan" not in text
    assert "(1 of 2)</td>" in text


def test_counts_and_methods_of_all_packings_are_told(tmp_path):
    mixed = [heap(1, 40), heap(2, 45), heap(3, 42, method="digital")]
    text, twin = written({"mixed": mixed, "one": heap(4, 1)}, tmp_path, which=["density"])
    assert "3 packings of 40 to 45 grains, rsa, digital" in text
    assert twin["groups"][0] == {
        "name": "mixed",
        "solid_fraction": np.mean([main_fraction(packing)[1] for packing in mixed]),
        "region": "bed",
        "packings": 3,
        "grains": [40, 45, 42],
        "methods": ["rsa", "digital"],
        "seeds": [1, 2, 3],
    }


def test_curves_of_all_packings_are_drawn(groups, tmp_path):
    several = written(groups, tmp_path, which=["density"])[0]
    single = written({name: group[0] for name, group in groups.items()}, tmp_path, which=["density"])[0]
    assert several.count("clip-path") == single.count("clip-path") + 5
    assert written({"a": [heap(k, 5) for k in range(7)], "b": heap(9, 5)}, tmp_path)[0].count("The first 5 packings")


def test_warnings_name_the_packing(groups, tmp_path):
    with pytest.warns(PackingWarning) as caught:
        written({"few": groups["few"][:2], "one": groups["many"][0]}, tmp_path, which=["density"])
    starts = [str(one.message).split(": the bulk holds")[0] for one in caught]
    assert starts == ["few, seed 0", "few, seed 1", "one"]


def test_what_cannot_be_compared_is_refused(groups, tmp_path):
    with pytest.raises(InputError, match="1 entries: a comparison needs at least two"):
        vg.save_comparison({"a": groups["few"]}, tmp_path / "c.html")
    with pytest.raises(InputError, match="'b' is empty"):
        vg.save_comparison({"a": groups["few"], "b": []}, tmp_path / "c.html")
    with pytest.raises(InputError, match="'b' holds the same packing twice: those of a group must be independent"):
        vg.save_comparison({"a": groups["few"], "b": [groups["many"][0]] * 2}, tmp_path / "c.html")
    for wrong in (3, "b.vtp", [None]):
        with pytest.raises(InputError, match="packings 'b'"):
            vg.save_comparison({"a": groups["few"], "b": wrong}, tmp_path / "c.html")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "c.json").write_text("mine")
    with pytest.raises(OutputExistsError, match=r"c\.json is there"):
        vg.save_comparison(groups, tmp_path / "c.html")
    assert (tmp_path / "c.json").read_text() == "mine"


def test_packings_without_grains_are_compared(tmp_path):
    empty = vg.Packing.of([vg.make_shape("sphere")], vg.Box((6, 6, 6)), position=np.zeros((0, 3)), unit="mm")
    text, twin = written({"empty": [empty, empty], "few": heap(1, 3)}, tmp_path)
    assert twin["distributions"] == []
    assert "0 grains, method not known" in text


def test_packings_of_other_units_are_converted_to_that_of_the_first(groups, tmp_path):
    few = groups["few"][0]
    pair = {"mm": few, "metres": few.to_unit("m")}
    vg.save_comparison(pair, tmp_path / "c.html", which=["density"], pictures=False)
    rows = {row["name"]: row for row in json.loads((tmp_path / "c.json").read_text())["numbers"]}
    for name in ("mean_diameter", "container_solid_fraction", "specific_surface"):
        entry = rows[name]["groups"]["metres"]
        assert entry["mean"] == pytest.approx(rows[name]["groups"]["mm"]["mean"], rel=1e-12)
        assert abs(entry["difference"]) < 1e-12
    units = {
        name: rows[name]["unit"] for name in ("mean_diameter", "grain_volume", "specific_surface", "container_porosity")
    }
    assert list(units.values()) == ["mm", "mm^3", "mm^-1", "1"]
    assert "equivalent diameter (mm)" in (tmp_path / "c.html").read_text()
    vg.save_comparison(dict(reversed(pair.items())), tmp_path / "d.html", which=["density"], pictures=False)
    rows = {row["name"]: row for row in json.loads((tmp_path / "d.json").read_text())["numbers"]}
    assert rows["mean_diameter"]["unit"] == "m"
    assert rows["mean_diameter"]["groups"]["mm"]["mean"] == pytest.approx(few.diameters.mean() / 1000)


@pytest.mark.parametrize(
    ("first", "words"), [("1", "in mm, the first one without"), ("mm", "without .* first one in mm")]
)
def test_packings_with_and_without_a_unit_are_not_compared(first, words, groups, tmp_path):
    few = groups["few"][0]
    bare = vg.Packing.of(few.shapes, few.container, position=few.position, scale=few.scale)
    pair = {"a": bare, "b": few} if first == "1" else {"a": few, "b": [groups["few"][1], bare]}
    with pytest.raises(InputError, match=f"packings 'b' has lengths {words}"):
        vg.save_comparison(pair, tmp_path / "c.html", pictures=False)
