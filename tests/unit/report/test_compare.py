"""Comparison of packings: differences, their significance, one page and its twin."""

import json

import numpy as np
import pytest
import scipy.stats

import voxgran as vg
from voxgran._base.errors import InputError, OutputExistsError
from voxgran._base.seeds import stream

pytestmark = pytest.mark.filterwarnings("ignore:the bulk holds")


def heap(seed, count):
    position = stream(seed, "heap").uniform(0.5, 5.5, (count, 3))
    scale = stream(seed, "sizes").uniform(0.3, 0.6, count)
    return vg.Packing.of([vg.make_shape("sphere")], vg.Box((6, 6, 6)), position=position, scale=scale, unit="mm")


@pytest.fixture(scope="module")
def groups():
    return {"few": [heap(k, 40) for k in range(4)], "many": [heap(k + 10, 60) for k in range(3)]}


def test_means_errors_and_significance_are_those_of_scipy(groups, tmp_path):
    vg.write_comparison(groups, tmp_path / "c.html", which=["density", "coordination"], pictures=False)
    twin = json.loads((tmp_path / "c.json").read_text())
    row = next(row for row in twin["numbers"] if row["name"] == "solid_fraction")
    few, many = ([packing.solid_fraction for packing in group] for group in groups.values())
    assert row["kinds"]["few"]["mean"] == pytest.approx(np.mean(few))
    assert row["kinds"]["many"]["standard_error"] == pytest.approx(scipy.stats.sem(many))
    assert row["kinds"]["many"]["difference"] == pytest.approx(np.mean(many) - np.mean(few))
    expected = scipy.stats.ttest_ind(many, few, equal_var=False).pvalue
    assert row["kinds"]["many"]["p_value"] == pytest.approx(expected)
    text = (tmp_path / "c.html").read_text()
    assert "significant" in text
    assert "±" in text
    assert "src=" not in text
    assert {test["what"] for test in twin["distributions"]} == {"equivalent diameter", "coordination number"}
    sizes = [np.concatenate([p.diameters for p in group]) for group in groups.values()]
    assert twin["distributions"][0]["distance"] == pytest.approx(scipy.stats.ks_2samp(*sizes).statistic)


def test_single_packings_have_no_verdict(groups, tmp_path):
    pair = {"a": groups["few"][0], "b <i>": groups["many"][0]}
    vg.write_comparison(pair, tmp_path / "c.html", which=["density"])
    text = (tmp_path / "c.html").read_text()
    assert "without a verdict" in text
    assert "may be chance" not in text
    assert "<i>" not in text.replace("<i role", "")
    assert text.count("data:image/png;base64,") == 2
    assert (tmp_path / "c.html").stat().st_size < 5e6
    row = next(row for row in json.loads((tmp_path / "c.json").read_text())["numbers"] if row["name"] == "count")
    assert row["kinds"]["b <i>"] == {"mean": 60.0, "standard_error": None, "difference": 20.0, "p_value": None}


def test_what_cannot_be_compared_is_refused(groups, tmp_path):
    with pytest.raises(InputError, match="1 entries: a comparison needs at least two"):
        vg.write_comparison({"a": groups["few"]}, tmp_path / "c.html")
    with pytest.raises(InputError, match="'b' is empty"):
        vg.write_comparison({"a": groups["few"], "b": []}, tmp_path / "c.html")
    (tmp_path / "c.json").write_text("mine")
    with pytest.raises(OutputExistsError, match=r"c\.json is there"):
        vg.write_comparison(groups, tmp_path / "c.html")
    assert (tmp_path / "c.json").read_text() == "mine"
