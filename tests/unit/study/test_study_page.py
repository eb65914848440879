"""Page of a study: what it says, what its files hold, which colours it has, and that bad input writes nothing."""

import csv
import itertools
import math
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import voxgran as vg
from voxgran._base.errors import InputError, OutputExistsError, UnknownNameError
from voxgran._base.seeds import stream
from voxgran.cli import main
from voxgran.report import plots
from voxgran.study import page
from voxgran.study.experiments import Band, bands_of
from voxgran.study.figures import figures_of, points_of
from voxgran.study.page import write_study_page
from voxgran.study.statistics import summary

METHODS, SHAPES = ["rsa", "jam", "gravity"], ["sphere", "box <i>"]
EXPERIMENTS = {
    "sphere": {"low": 0.55, "high": 0.64, "source": "Onoda & Liniger 1990; Scott & Kilgour 1969"},
    "box <i>": (0.54, 0.67),
}
#: linear sRGB as seen without the cones for long and for medium waves, Machado, Oliveira & Fernandes 2009
SEEN = {
    "all": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}


@pytest.fixture(scope="module")
def data():
    """Three methods, two shapes and four seeds; one cell fails, and one run of another."""
    generator = stream(1, "values")
    dims = ("method", "shape", "seed")
    values = generator.normal(0.6, 0.01, (3, 2, 4)) + np.array([-0.2, 0.04, 0.0])[:, None, None]
    failure = np.full(values.shape, "", dtype=object)
    failure[0, 1], failure[2, 0, 1] = "rsa cannot pack a box", "the memory <b>ran</b> out"
    values[failure != ""] = np.nan
    variables = {
        "solid_fraction": (dims, values, {"units": "1", "long_name": "solid fraction"}),
        "bulk_solid_fraction": (dims, np.full(values.shape, np.nan)),
        "mean_coordination_number": (dims, 10 * values),
        "deepest_overlap": (dims, 0 * values),
        "seconds": (dims, 10 ** generator.normal(0, 0.1, values.shape), {"units": "s"}),
        "memory": (dims, np.full(values.shape, 2.0**28), {"units": "byte"}),
        "failure": (dims, failure),
    }
    return xr.Dataset(variables, {"method": METHODS, "shape": SHAPES, "seed": [0, 1, 2, 7]})


@pytest.fixture(scope="module")
def written(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    found = write_study_page(data, folder, experiments=EXPERIMENTS, title="Boxes & spheres")
    assert found == folder / "study.html"
    return folder, found.read_text()


def table(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


class Tags(HTMLParser):
    """Tags that are open, resources that are loaded, and ids."""

    def __init__(self):
        super().__init__()
        self.open, self.loaded, self.ids = [], [], []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "link", "img", "br"):
            self.open.append(tag)
        self.loaded += [value for name, value in attrs if name in ("src", "href") and tag != "use"]
        self.ids += [value for name, value in attrs if name == "id"]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_is_whole_and_loads_nothing(written):
    _, text = written
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert tags.loaded == []
    assert len(set(tags.ids)) == len(tags.ids)
    assert "url(http" not in text
    assert "<title>Boxes &amp; spheres</title>" in text
    assert "box &lt;i&gt;" in text
    assert "<i>" not in text
    assert "<b>" not in text


def test_the_page_says_what_failed_and_what_differs(written):
    _, text = written
    body = re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL)
    for words in (
        "method (3), shape (2)",
        "<td>0 of 4</td>",
        "<td>0, 1, 2, 7</td><td>rsa cannot pack a box</td>",
        "<td>1</td><td>the memory &lt;b&gt;ran&lt;/b&gt; out</td>",
        "not known",
        "Comparison of solid fraction",
        "Comparison of mean coordination number",
        "jam \u2212 rsa",
        "significant, p",
        "256 MiB",
        "Grey bands are experiments: sphere 0.55\u20130.64 (Onoda &amp; Liniger 1990; Scott &amp; Kilgour 1969)",
    ):
        assert words in body, words
    assert "nan" not in body.lower().replace("nanum", "")
    # a number that no run knows is not shown
    assert "bulk" not in body


def test_the_bulk_is_shown_where_it_is_not_the_whole_container(data, tmp_path):
    for shift, files in ((1e-12, 2), (0.02, 4)):
        made = data.assign(bulk_solid_fraction=data.solid_fraction + shift)
        text = write_study_page(made, tmp_path, overwrite=True).read_text()
        assert len(list(tmp_path.glob("*.svg"))) == files
        assert ("Comparison of bulk solid fraction" in text) == (files == 4)


def test_what_is_equal_by_construction_is_not_drawn_and_what_varies_comes_first(data, tmp_path):
    made = data.assign(bulk_solid_fraction=data.solid_fraction, solid_fraction=0 * data.solid_fraction + 0.5)
    text = write_study_page(made, tmp_path).read_text()
    assert sorted(path.name for path in tmp_path.glob("*.svg")) == [
        "bulk_solid_fraction_against_seconds.svg",
        "bulk_solid_fraction_by_cell.svg",
    ]
    assert "Comparison of bulk solid fraction" in text
    assert "solid fraction" not in re.findall(r"Comparison of ([^<]*)", text)
    # beside another one that of the container says whose it is
    heads = re.findall(r"<th[^>]*>([^<]*)</th>", text)
    assert heads.index("bulk solid fraction") < heads.index("container solid fraction")
    assert "solid fraction" not in heads
    figure, _ = figures_of(made, "solid_fraction", over="method")
    assert figure.caption.startswith("Container solid fraction against CPU seconds")
    assert ">container solid fraction<" in figure.svg


def test_the_page_says_how_many_runs_warned_of_what(data, tmp_path):
    texts = np.full(data.solid_fraction.shape, "", dtype=object)
    ended = (f"{count} of 250 grains were placed before the method stopped (full)" for count in (243, 249, 99))
    texts[1, 0, :3] = list(ended)
    # more of the container was asked for, too; what else is warned of tells nothing of that
    texts[2, 0, 0] = "the solid fraction is 0.3 instead of 0.5 where the method stopped (saturated)"
    texts[2, 1, :2] = "the bulk holds 3", "3 of 9 grains were placed before the method stopped (steps)"
    made = data.assign(warnings=(data.solid_fraction.dims, texts))
    text = re.sub(r"<t([hd])[^>]*>", r"<t\1>", write_study_page(made, tmp_path).read_text())
    for words in (
        "<th>warned</th>",
        "<th>3</th><td>243 of 250 grains were placed before the method stopped (full)</td>",
        "<th>1</th><td>the bulk holds 3</td>",
    ):
        assert words in text, words
    assert [row["warned"] for row in table(tmp_path / "cells.csv")] == ["0", "0", "3", "0", "1", "2"]
    assert [row["full"] for row in table(tmp_path / "cells.csv")] == ["0", "0", "3", "0", "1", "0"]


def test_cells_in_the_csv_file_are_those_of_the_summary(written, data):
    rows = table(written[0] / "cells.csv")
    assert [(row["method"], row["shape"]) for row in rows] == list(itertools.product(METHODS, SHAPES))
    found = summary(data)
    for row, mean, low, high, error in zip(
        rows,
        found["mean"].values.ravel(),
        found.confidence_low.values.ravel(),
        found.confidence_high.values.ravel(),
        found.standard_error.values.ravel(),
        strict=True,
    ):
        columns = ("solid_fraction", "solid_fraction_low", "solid_fraction_high", "solid_fraction_standard_error")
        given = [float(row[name] or "nan") for name in columns]
        np.testing.assert_array_equal(given, [mean, low, high, error])
    assert rows[1]["failure"] == "4 times: rsa cannot pack a box"
    assert [row["failures"] for row in rows] == ["0", "4", "0", "0", "1", "0"]
    assert rows[4]["solid_fraction_count"] == "3"
    assert "deepest_overlap" in rows[0]


def test_comparisons_in_the_csv_file(written):
    rows = table(written[0] / "comparisons.csv")
    assert {row["variable"] for row in rows} == {"solid_fraction", "mean_coordination_number"}
    assert {row["shape"] for row in rows} == {*SHAPES, "all"}
    row = next(row for row in rows if (row["shape"], row["one"], row["other"]) == ("sphere", "rsa", "jam"))
    assert float(row["difference"]) == pytest.approx(0.24, abs=0.03)
    assert row["verdict"] == "significant"
    assert 0 < float(row["p_value"]) < float(row["p_holm"]) < 0.05


def test_figures_are_files_of_their_own(written):
    folder, _ = written
    names = sorted(path.name for path in folder.glob("*.svg"))
    assert names == ["solid_fraction_against_seconds.svg", "solid_fraction_by_cell.svg"]
    for name in names:
        root = ET.parse(folder / name).getroot()
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
    text = (folder / "solid_fraction_by_cell.svg").read_text()
    for words in (*METHODS, "sphere", "experiments", "solid fraction"):
        assert f">{words}<" in text, words
    assert ">CPU seconds<" in (folder / "solid_fraction_against_seconds.svg").read_text()


def test_points_of_the_figures_are_the_means(data, monkeypatch):
    drawn = []

    def noted(draw, name, **options):
        from matplotlib.figure import Figure

        axes = Figure().add_subplot()
        draw(axes)
        drawn.append(axes)
        return ""

    monkeypatch.setattr(plots, "svg_of", noted)
    figures_of(data, "solid_fraction", over="method", bands=bands_of(EXPERIMENTS))
    means = summary(data, "solid_fraction")["mean"].values
    seconds = np.exp(np.log(data["seconds"]).mean("seed").values)
    known = np.isfinite(means)
    for axes, x in zip(drawn, (seconds, None), strict=True):
        points = [container.lines[0].get_xydata() for container in axes.containers]
        found = np.concatenate(points)
        np.testing.assert_allclose(np.sort(found[:, 1]), np.sort(means[known]))
        if x is not None:
            np.testing.assert_allclose(np.sort(found[:, 0]), np.sort(x[known]))
            assert axes.get_xscale() == "log"
    # one container for each method and shape that has numbers, in the colour of its method
    colors = [container.lines[0].get_color() for container in drawn[1].containers]
    assert [colors.count(color) for color in plots.DISTINCT[:3]] == [1, 2, 2]
    # the first shape has its place around 0, the second one around 1
    first = [container.lines[0].get_xdata()[0] for container in drawn[1].containers]
    assert np.round(first).tolist() == [0, 0, 1, 0, 1]
    assert np.abs(first - np.round(first)).max() < 0.3
    bands = [path.get_extents() for collection in drawn[1].collections for path in collection.get_paths()]
    spans = [(box.x0, box.x1, box.y0, box.y1) for box in bands if box.width > 0.5 and box.height > 0.01]
    np.testing.assert_allclose(spans, [(-0.42, 0.42, 0.55, 0.64), (0.58, 1.42, 0.54, 0.67)])


def test_intervals_of_times_lie_above_0_however_few_and_unlike_they_are(data, monkeypatch):
    drawn = []

    def noted(draw, name, **options):
        from matplotlib.figure import Figure

        drawn.append(Figure().add_subplot())
        draw(drawn[-1])
        return ""

    monkeypatch.setattr(plots, "svg_of", noted)
    seconds = data["seconds"].copy()
    seconds[1, 0] = [0.1, 0.1, 0.1, 5.0]
    figure, _ = figures_of(data.assign(seconds=seconds), "solid_fraction", over="method")
    assert "at the geometric mean of its times" in figure.caption
    ends = np.concatenate([bar.get_segments() for container in drawn[0].containers for bar in container.lines[2][:1]])[
        :, :, 0
    ]
    middle = math.exp(np.log([0.1, 0.1, 0.1, 5.0]).mean())
    own = ends[np.isclose(np.sqrt(ends[:, 0] * ends[:, 1]), middle)]
    assert len(own) == 1
    assert (ends[np.isfinite(ends)] > 0).all()
    # Student's interval of four logarithms
    half = stats.t.ppf(0.975, 3) * np.log([0.1, 0.1, 0.1, 5.0]).std(ddof=1) / 2
    np.testing.assert_allclose(np.log(own[0]), math.log(middle) + np.array([-half, half]), rtol=1e-6)


def lab(color, matrix):
    """Return CIE L*a*b* of a colour that is seen through a matrix on linear sRGB."""
    code = np.array([int(color[at : at + 2], 16) for at in (1, 3, 5)]) / 255
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ np.clip(np.asarray(matrix) @ linear, 0, 1) / (0.9505, 1.0, 1.089)
    root = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * root[1] - 16, 500 * (root[0] - root[1]), 200 * (root[1] - root[2])])


@pytest.mark.parametrize("kind", SEEN)
def test_colours_differ_without_red_or_green_and_from_pages(kind):
    found = [lab(color, SEEN[kind]) for color in plots.DISTINCT]
    assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(found, 2)) > 15
    assert all(25 < one[0] < 80 for one in found)


def test_an_axis_that_varies_with_the_compared_one_is_not_drawn_beside_it():
    coordinates = {"method": ["a", "b"], "container": ("method", ["c", "d"]), "width": [0.1, 0.2], "seed": [0, 1]}
    data = xr.Dataset({"x": (("method", "width", "seed"), np.zeros((2, 2, 2)))}, coordinates)
    assert points_of(data, "method").marker_axis == "width"
    assert points_of(data, "width").marker_axis == "method"
    assert points_of(data.isel(width=[0]).squeeze("width", drop=True), "method").marker_axis == "container"


def test_styles_of_many_values_are_still_different():
    labels = [{"method": f"m{m}", "shape": f"s{s}"} for m in range(12) for s in range(10)]
    sizes = {"method": 12, "shape": 10, "seed": 2}
    coordinates = {"method": [f"m{m}" for m in range(12)], "shape": [f"s{s}" for s in range(10)], "seed": [0, 1]}
    points = points_of(xr.Dataset({"x": (tuple(sizes), np.zeros((12, 10, 2)))}, coordinates), "method")
    assert points.labels == labels
    styles = {tuple(sorted(points.style(at).items())) for at in range(120)}
    assert len(styles) == 120


def test_numbers_on_the_axis_are_joined_and_bands_of_other_axes_go_across(tmp_path):
    values = stream(2, "values").normal(0.6, 0.01, (2, 4, 3))
    dims = ("method", "packing.friction", "seed")
    made = xr.Dataset(
        {"solid_fraction": (dims, values)}, {"method": ["rsa", "jam"], "packing.friction": [0.1, 0.5, 1.0, 5.0]}
    )
    write_study_page(made, tmp_path, experiments={"sphere": (0.55, 0.64)})
    text = (tmp_path / "solid_fraction_by_cell.svg").read_text()
    assert "packing.friction" in text
    assert "experiments" in text
    # no times, no figure of them
    assert len(list(tmp_path.glob("*.svg"))) == 1


def test_what_neither_colour_nor_marker_says_is_in_the_caption(tmp_path):
    dims = ("method", "shape", "settle", "sizes.sigma", "seed")
    values = {"solid_fraction": (dims, stream(3, "values").uniform(0.5, 0.6, (2, 2, 2, 2, 2)))}
    named = {"method": ["a", "b"], "shape": ["s", "t"], "settle": ["no", "yes"], "sizes.sigma": [0.1, 0.2]}
    made = xr.Dataset(values, named)
    text = write_study_page(made, tmp_path).read_text()
    assert "Points of the same colour and marker differ in sizes.sigma." in text


def test_one_cell_one_seed_and_nothing_that_succeeded(tmp_path):
    one = xr.Dataset({"solid_fraction": (("seed",), [0.6])}, {"seed": [0]})
    text = write_study_page(one, tmp_path / "one").read_text()
    assert "the base" in text
    assert "Comparison" not in text
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL)
    values = (("method", "seed"), np.full((2, 2), np.nan))
    failure = (("method", "seed"), np.full((2, 2), "no grain fits", dtype=object))
    none = xr.Dataset({"solid_fraction": values, "failure": failure}, {"method": ["rsa", "jam"], "seed": [0, 1]})
    text = write_study_page(none, tmp_path / "none").read_text()
    assert text.count("no grain fits") == 2
    assert (tmp_path / "none" / "comparisons.csv").read_text().strip() == ""


def test_the_same_study_gives_the_same_files(data, written, tmp_path):
    write_study_page(data, tmp_path, experiments=EXPERIMENTS, title="Boxes & spheres")
    for path in written[0].iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name


def test_long_tables_are_cut_and_say_so(data, tmp_path, monkeypatch):
    monkeypatch.setattr(page, "MOST_ROWS", 3)
    text = write_study_page(data, tmp_path).read_text()
    assert "The first 3 of 6 rows; all are in cells.csv." in text
    assert len(table(tmp_path / "cells.csv")) == 6


def test_bad_input_writes_nothing(data, tmp_path):
    # the last file that would be written
    kept = tmp_path / "study.html"
    kept.write_text("mine")
    with pytest.raises(OutputExistsError):
        write_study_page(data, tmp_path)
    assert list(tmp_path.iterdir()) == [kept]
    for options, error, words in (
        ({"experiments": {"spere": (0.5, 0.6)}}, UnknownNameError, "sphere"),
        ({"experiments": {"sphere": (0.6, 0.5)}}, InputError, "exchange"),
        ({"experiments": {"sphere": {"low": 0.6, "hihg": 0.7}}}, UnknownNameError, "high"),
        ({"experiments": {"sphere": 0.6}}, InputError, "low = "),
        ({"experiments": {"sphere": {"low": "dense"}}}, InputError, "must be a number"),
        ({"experiments": [0.5, 0.6]}, InputError, "table of ranges"),
        ({"over": "metod"}, UnknownNameError, "method"),
        ({"variables": ["solid"]}, UnknownNameError, "solid_fraction"),
        ({"confidence": 95}, InputError, "confidence"),
        ({"interval": "exact"}, InputError, "interval"),
    ):
        with pytest.raises(error, match=words):
            write_study_page(data, tmp_path, overwrite=True, **options)
    assert kept.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [kept]


def test_a_single_measured_value_is_a_band_of_no_height():
    assert bands_of({"sphere": {"low": 0.64}}) == (Band("sphere", 0.64, 0.64),)
    assert bands_of(None) == ()


BASE = {
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 5},
    "measure": {"which": ["density"]},
}


def test_results_of_a_study_have_it_all(tmp_path, here):
    axes = {"shape": ["sphere", "ellipsoid"], "packing.count": [3, 5]}
    base = {**BASE, "shape": [{"family": "sphere"}]}
    made = vg.Study(base=base, axes=axes, seeds=2, experiments={"sphere": (0.05, 0.06, "nobody")})
    result = made.run(tmp_path / "out")
    assert result.summary()["mean"].identical(summary(result.dataset)["mean"])
    compared = result.compare(over="packing.count")
    assert compared.query("test == 'Welch'").groupby("shape").size().to_dict() == {
        "all": 1,
        "ellipsoid": 1,
        "sphere": 1,
    }
    text = result.write_page().read_text()
    assert "sphere 0.05\u20130.06 (nobody)" in text
    with pytest.raises(OutputExistsError):
        result.write_page()
    # what is read from the file gives the same numbers
    with xr.open_dataset(tmp_path / "out" / "study.nc", engine="netcdf4") as read:
        again = write_study_page(read.load(), tmp_path / "again", experiments={"sphere": (0.05, 0.06, "nobody")})
    for name in ("cells.csv", "comparisons.csv"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    assert again.read_text() == text


def test_shapes_of_experiments_are_checked_before_anything_is_packed(tmp_path):
    with pytest.raises(UnknownNameError, match="sphere"):
        vg.Study(base={**BASE, "shape": []}, axes={"shape": ["sphere", "box"]}, experiments={"spere": (0.5, 0.6)})
    file = tmp_path / "study.toml"
    file.write_text('scene = "x.toml"\n')
    with pytest.raises(InputError, match="write them in the file"):
        vg.Study(file, experiments={})


def test_the_command_writes_the_page(tmp_path, monkeypatch, capsys, here):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beds.toml").write_text(
        'seeds = 2\n[base.container]\nkind = "box"\nlengths = [4, 4, 4]\n[[base.shape]]\nfamily = "sphere"\n'
        '[base.packing]\nmethod = "rsa"\n[base.measure]\nwhich = ["density"]\n[axes]\n"packing.count" = [3, 5]\n'
        '[experiments]\nsphere = { low = 0.05, high = 0.06, source = "nobody" }\n'
    )
    # the second time nothing is computed, and the page is written anew
    for _ in range(2):
        assert main(["study", "beds.toml", "--quiet"]) == 0
        assert "study.html" in capsys.readouterr().out
        text = (tmp_path / "out" / "study.html").read_text()
        assert "<h1>Study beds</h1>" in text
        assert "sphere 0.05\u20130.06 (nobody)" in text
        (tmp_path / "out" / "study.html").unlink()


def test_ninety_cells_of_fifteen_shapes_look_different():
    sizes = {"method": [f"m{k}" for k in range(6)], "shape": [f"s{k}" for k in range(15)]}
    values = {"solid_fraction": ((*sizes, "seed"), stream(4, "values").uniform(0.5, 0.6, (6, 15, 1)))}
    points = points_of(xr.Dataset(values, sizes), over="method")
    assert len({tuple(points.style(at).values()) for at in range(90)}) == 90


def test_markers_over_categories_tell_a_third_axis_apart(monkeypatch):
    """Over shapes, markers are those of the next axis that varies; the caption says what is left."""
    drawn = []

    def noted(draw, name, **options):
        from matplotlib.figure import Figure

        axes = Figure().add_subplot()
        draw(axes)
        drawn.append(axes)
        return ""

    monkeypatch.setattr(plots, "svg_of", noted)
    sizes = {"method": ["a", "b"], "shape": ["s", "t"], "settle": ["no", "yes"], "sizes.sigma": [0.1, 0.2]}
    values = {"solid_fraction": ((*sizes, "seed"), stream(4, "values").uniform(0.5, 0.6, (2, 2, 2, 2, 2)))}
    (figure,) = figures_of(xr.Dataset(values, sizes), "solid_fraction", over="method")
    assert "Points of the same colour and marker differ in sizes.sigma." in figure.caption
    kinds = [(c.lines[0].get_color(), c.lines[0].get_marker()) for c in drawn[0].containers]
    assert sorted(set(kinds)) == sorted(itertools.product(plots.DISTINCT[:2], "os"))
    assert [text.get_text() for text in drawn[0].get_legend().get_texts()] == ["a", "b", "no", "yes"]
    del sizes["sizes.sigma"], sizes["settle"]
    values = {"solid_fraction": ((*sizes, "seed"), np.full((2, 2, 2), 0.5))}
    figures_of(xr.Dataset(values, sizes), "solid_fraction", over="method")
    assert {c.lines[0].get_marker() for c in drawn[1].containers} == {"o"}
    assert [text.get_text() for text in drawn[1].get_legend().get_texts()] == ["a", "b"]
