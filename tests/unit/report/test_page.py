"""The page stands alone, says the numbers, and lets no name break out."""

import csv
import dataclasses
import json
import math
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from kit import lattice

import voxgran as vg
from voxgran._base.errors import OutputExistsError
from voxgran.contacts.verify import verify
from voxgran.containers.kinds.box import Box
from voxgran.measures.model import measure
from voxgran.measures.registered.density import main_fraction
from voxgran.packing.model import Packing
from voxgran.report import facts
from voxgran.report import page as pages
from voxgran.report.compare import save_comparison
from voxgran.report.figures import figures_of
from voxgran.report.page import page_numbers, save_report
from voxgran.scene.run import summary_of
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

pytestmark = pytest.mark.usefixtures("jagged_pictures")

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
VOID = {"meta", "img", "link", "br", "hr", "input"}


class Page(HTMLParser):
    """Collect tags and texts, and check that every tag is closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.texts = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if data.strip():
            self.texts.append(" ".join(data.split()))

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


def page_of(packing, path, **options):
    save_report(packing, path, **options)
    return Page(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("report")


def test_a_whole_page(packing, statistics, tmp_path, monkeypatch):
    monkeypatch.setattr("voxgran.report.page.SHAPES_DRAWN", 1)
    comparisons = {
        "digital": {"grains": 48, "solid fraction": 0.4, "verified": True},
        "control_point": {"grains": 48, "seconds": 12.5},
    }
    page = page_of(
        packing,
        tmp_path / "out" / "page.html",
        statistics=statistics,
        verification=verify(packing),
        comparisons=comparisons,
        pictures_folder=tmp_path / "pictures",
        title="Blocks & <spheres>",
    )
    text = " ".join(page.texts)
    for part in ("Blocks & <spheres>", "48", f"{packing.solid_fraction:.4f}", "0.4321", f"{1 - 0.4321:.4f}"):
        assert part in text
    for part in (
        "1 of 2 shapes, all of which are equally frequent.",
        "digital",
        "control_point",
        "12.5",
        "voxel size 0.05",
        "1.5 s",
        "0.6",
        "<block> & co",
    ):
        assert part in text
    images = page.all("img")
    assert len(images) == 3 + 4
    assert all(image["src"].startswith("data:image/png;base64,") and image["alt"] for image in images)
    assert len(page.all("svg")) == 5
    assert [name for name, _ in page.tags if re.fullmatch("h[1-6]", name)][:2] == ["h1", "h2"]
    assert page.all("html") == [{"lang": "en"}]
    assert (tmp_path / "out" / "page.html").stat().st_size < 5_000_000
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == [
        "contacts.png",
        "cut_open.png",
        "grain_0.png",
        "whole.png",
    ]
    record = json.loads(page.texts[page.texts.index("Provenance, whole") + 1])
    assert record == packing.provenance


def test_nothing_is_loaded_from_elsewhere(packing, statistics, tmp_path):
    page = page_of(packing, tmp_path / "p.html", statistics=statistics, pictures=False)
    addresses = [v for _, attributes in page.tags for k, v in attributes.items() if k in ("src", "href", "xlink:href")]
    assert all(address.startswith(("#", "data:")) for address in addresses)
    assert page.all("script") == page.all("link") == page.all("iframe") == []
    style = re.search(r"<style>(.*?)</style>", (tmp_path / "p.html").read_text(), re.DOTALL).group(1)
    assert "url(" not in style
    assert "@import" not in style
    assert "prefers-color-scheme: dark" in style


def test_ids_are_used_once(packing, statistics, tmp_path):
    page = page_of(packing, tmp_path / "p.html", statistics=statistics, pictures=False)
    names = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(names) == len(set(names))
    labels = {attributes["aria-labelledby"] for _, attributes in page.tags if "aria-labelledby" in attributes}
    assert labels <= set(names)


def test_names_cannot_break_out_of_the_page(packing, tmp_path):
    evil = "</pre><script>alert(1)</script>"
    shapes = [dataclasses.replace(shape, name=evil) for shape in packing.shapes]
    spoilt = Packing.of(
        shapes, packing.container, position=[[1, 1, 1]], provenance={"method": evil, "parameters": {evil: evil}}
    )
    page = page_of(spoilt, tmp_path / "p.html", pictures=False, title=evil, comparisons={evil: {evil: evil}})
    assert page.all("script") == []


def test_the_verdict_is_told(packing, tmp_path):
    # two spheres that overlap by half a diameter, and one that is half outside
    spoilt = Packing.of(packing.shapes[:1], packing.container, position=[[1, 1, 1], [1.5, 1, 1], [4, 3, 3]])
    page = page_of(spoilt, tmp_path / "p.html", pictures=False, verification=verify(spoilt))
    text = " ".join(page.texts)
    assert "overlapping pairs 1" in text
    assert "escaped 1" in text
    assert "The deepest overlaps i j image depth 0 1 (0, 0, 0) 0.5" in text
    assert "The farthest escapes grain depth 2 0.5" in text
    assert "bad" in {attributes.get("class", "").split(" ")[0] for attributes in page.all("dd")}
    sound = Packing.of(packing.shapes[:1], packing.container, position=[[1, 1, 1]])
    good = page_of(sound, tmp_path / "good.html", pictures=False, verification=verify(sound))
    assert "true shapes: no overlap, no escape" in good.texts
    none = page_of(packing, tmp_path / "none.html", pictures=False)
    assert "not run" in none.texts


def test_an_empty_packing_has_a_page(packing, tmp_path):
    page = page_of(Packing.of([], packing.container, position=[]), tmp_path / "p.html")
    assert "Packing of 0 grains" in page.texts
    assert len(page.all("img")) == 1
    assert page.all("svg") == []
    # with shapes, measures and a verification: as where no grain had room
    none = Packing.of(packing.shapes, packing.container, position=[], shape_id=[])
    assert (
        "Packing of 0 grains"
        in page_of(none, tmp_path / "n.html", statistics=measure(none), verification=verify(none)).texts
    )


def test_two_dimensions_have_a_page(flat, tmp_path):
    page = page_of(flat, tmp_path / "p.html")
    assert len(page.all("img")) == 1 + 2 * 3
    assert "share by area" in page.texts


def test_what_is_there_stays_unless_asked(packing, tmp_path):
    save_report(packing, tmp_path / "p.html", pictures=False)
    before = (tmp_path / "p.html").read_bytes()
    with pytest.raises(OutputExistsError, match="not replaced unasked"):
        save_report(packing, tmp_path / "p.html", pictures=False, title="new")
    assert (tmp_path / "p.html").read_bytes() == before


def test_pictures_go_into_a_folder_beside_what_is_there(packing, tmp_path):
    bare = Packing.of([], packing.container, position=[])
    (tmp_path / "packing.vtp").write_text("mine")
    save_report(bare, tmp_path / "p.html", pictures_folder=tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *("p.html", "p.json", "p_making.csv", "p_numbers.csv", "packing.vtp", "whole.png")
    ]
    assert (tmp_path / "packing.vtp").read_text() == "mine"
    with pytest.raises(OutputExistsError, match=r"whole.png is there already"):
        save_report(bare, tmp_path / "q.html", pictures_folder=tmp_path)
    assert not (tmp_path / "q.html").exists()


def test_the_same_packing_gives_the_same_page(packing, statistics, tmp_path):
    for name in ("a", "b"):
        save_report(packing, tmp_path / f"{name}.html", statistics=statistics, pictures=False)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1234567, "1\u202f234\u202f567"),
        (0.000123456, "0.0001235"),
        (-1e-9, "\u22121e\u221209"),
        (-12345, "\u221212\u202f345"),
        (np.float64(0.5), "0.5"),
        (True, "yes"),
        (np.bool_(False), "no"),
        (None, "none"),
        (float("nan"), "not known"),
        ("text", "text"),
    ],
)
def test_numbers_are_written_for_people(value, text):
    assert facts.number(value) == text


def test_each_distance_of_sizes_says_what_it_compares(packing, tmp_path):
    record = {**packing.provenance, "missed": {"count": 2, "gradation": 0.0123}}
    rows = {row.label: row for row in facts.details(dataclasses.replace(packing, provenance=record))}
    assert rows["missed"].value == "count 2"
    row = rows["sizes, placed against drawn"]
    assert row.value == "0.0123"
    assert row.note.startswith(
        "largest difference, by number, between the share up to a size of the grains that were dr"
    )
    assert not row.note.endswith("grew")
    grown = {row.label: row for row in facts.details(dataclasses.replace(packing, provenance={**record, "growth": {}}))}
    assert grown["sizes, placed against drawn"].note.endswith(", before they grew")
    save_report(dataclasses.replace(packing, provenance=record), tmp_path / "p.html", pictures=False)
    text = (tmp_path / "p.html").read_text()
    assert "Placed against requested: the largest difference between the two curves, by volume" in text
    assert "grains that were drawn for this run" in text


def test_shapes_are_listed_with_their_shares(packing):
    rows = facts.shape_rows(packing)
    assert [row[:3] for row in rows] == [("sphere", "sphere", "24"), ("<block> & co", "mesh", "24")]
    assert sum(float(row[3].rstrip(" %")) for row in rows) == pytest.approx(100, abs=0.11)


def heap(count, gravity):
    """Return spheres on a cubic lattice in the lower part of a high box: a bed where there is gravity."""
    position = lattice(count, count, 6)
    return Packing.of([BALL], Box((count, count, 60), periodic="xy"), position=position, gravity=gravity)


@pytest.mark.parametrize(
    ("count", "gravity", "region"),
    [(8, "-z", "bulk"), (3, "-z", "bed"), (8, None, "container"), (3, None, "container")],
)
@pytest.mark.parametrize("measured", [True, False])
@pytest.mark.filterwarnings("ignore:the bulk holds")
def test_numbers_of_a_bed_are_those_below_its_surface(count, gravity, region, measured, tmp_path):
    packing = heap(count, gravity)
    tree = measure(packing, "density") if measured else None
    found = facts.headline(packing, tree, None)
    whole = math.pi / 60
    # layers of spheres on a lattice, cut where they may be
    fraction = whole if region == "container" else float(found[1].value)
    assert [fact.label for fact in found[1:3]] == ["solid fraction", "porosity"]
    assert float(found[1].value) == pytest.approx(fraction, abs=1e-4)
    assert float(found[2].value) == pytest.approx(1 - fraction, abs=2e-4)
    if region != "container":
        assert fraction == pytest.approx(math.pi / 6, abs=0.03)
        assert f"of the {region}" in found[1].note
        assert (found[3].label, float(found[3].value)) == (
            "solid fraction of the container",
            pytest.approx(whole, abs=1e-4),
        )
    numbers = page_numbers(packing, tree, None, figures=[])
    assert numbers["region"] == region
    assert numbers["solid_fraction"] == pytest.approx(fraction, abs=1e-4)
    assert numbers["porosity"] == 1 - numbers["solid_fraction"]
    assert numbers["container_solid_fraction"] == pytest.approx(whole)
    assert numbers["container_porosity"] == 1 - packing.solid_fraction
    if measured:
        summary = summary_of(packing, verify(packing), tree)
        names = ("solid_fraction", "porosity", "region", "container_solid_fraction", "container_porosity")
        assert [summary[name] for name in names] == [numbers[name] for name in names]
        # the numbers of the prompt, of comparisons and of studies: those of the container come last
        assert list(tree.data_vars)[-2:] == ["solid_fraction", "porosity"]
        if gravity:
            assert float(tree.bed_porosity) == 1 - float(tree.bed_solid_fraction)


@pytest.mark.filterwarnings("ignore:the bulk holds")
def test_figures_and_comparisons_of_a_bed_are_of_what_lies_below_its_surface(tmp_path):
    bed, tree = heap(8, "-z"), measure(heap(8, "-z"), ["density", "profile"])
    region, fraction = main_fraction(bed, tree)
    curve = next(figure for figure in figures_of(bed, tree) if figure.name == "solid_fraction_z")
    assert f"bulk: {fraction:.3f}" in curve.svg
    assert curve.svg.index("bulk: ") < curve.svg.index("container: ")
    save_comparison({"bed": bed, "other": heap(8, None)}, tmp_path / "c.html", which=["density"], pictures=False)
    text = (tmp_path / "c.html").read_text()
    assert f"{fraction:.4f}" in text
    assert f"solid fraction of the {region}; 384 grains" in text.replace("\u202f", "")
    assert "solid fraction of the container; 384 grains" in text


def test_the_shapes_that_are_drawn_are_called_as_frequent_as_they_are(monkeypatch):
    monkeypatch.setattr("voxgran.report.page.SHAPES_DRAWN", 2)
    balls = [vg.make_shape("sphere", diameter=d) for d in (1.0, 0.9, 0.8, 0.7)]
    named = [vg.Shape.of(ball.geometry, name=name) for ball, name in zip(balls, "abbc", strict=True)]
    places = [(1 + k, 1, 1) for k in range(5)]
    rare = vg.Packing.of(named, vg.Box((7, 2, 2)), position=places[:4], shape_id=[0, 1, 2, 3])
    assert pages._grains_note(rare) == "2 of 4 shapes, all of which are equally frequent."
    # those of one name count as one
    assert [shape.name for shape in pages._drawn_shapes(rare)] == ["a", "b"]
    often = vg.Packing.of(named, vg.Box((7, 2, 2)), position=places, shape_id=[0, 1, 2, 3, 3])
    assert pages._grains_note(often) == "2 of 4 shapes, the most frequent ones."
    assert [shape.name for shape in pages._drawn_shapes(often)] == ["c", "a"]
    few = vg.Packing.of(named[:2], vg.Box((7, 2, 2)), position=places[:3], shape_id=[0, 1, 1])
    assert pages._grains_note(few) == ""


def test_tables_lie_beside_the_page_as_csv(packing, tmp_path):
    save_report(packing, tmp_path / "p.html", pictures=False)
    with open(tmp_path / "p_numbers.csv", encoding="utf-8", newline="") as file:
        numbers = {row[0]: row[1] for row in csv.reader(file)}
    assert numbers["grains"] == str(packing.count)
    with open(tmp_path / "p_shapes.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["shape", "geometry", "grains", "share"]
    assert sum(int(row[2]) for row in rows[1:]) == packing.count
