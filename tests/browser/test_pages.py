"""Pages in a real browser: the view shows the packing, turns, is cut, names grains; pages fit narrow and wide windows.

Chromium runs without a window and draws by the processor, which takes about a second for a frame of many triangles:
the packing is small.
"""

import dataclasses
import time

import chromium
import numpy as np
import pytest
from kit import lattice

import voxgran as vg
from voxgran.report import view
from voxgran.report.stage import view_axes

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(chromium.PROGRAM is None, reason="chromium is not installed: make test-browser"),
    pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning"),
]
CANVAS = "#view-canvas"
WIDTHS = (400, 1600)


def beds():
    """Return 27 grains of three shapes, in contact along x, and the same with smaller grains."""
    shapes = [vg.make_shape("sphere"), vg.make_shape("box"), vg.make_shape("cylinder")]
    position = lattice(3, 3, 3)
    bed = vg.Packing.of(shapes, vg.Box((3, 3, 3)), position=position, shape_id=np.arange(27) // 3 % 3, unit="mm")
    return bed, dataclasses.replace(bed, scale=np.full(27, 0.8))


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Return a report of a packing, one of disks, and a comparison."""
    folder = tmp_path_factory.mktemp("pages")
    bed, smaller = beds()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(view, "TRIANGLES", 4_000)
        vg.save_report(bed, folder / "report.html", statistics=vg.measure(bed), verification=vg.verify(bed))
        disks = vg.Packing.of(
            vg.shapes.disk(), vg.Rectangle((3, 2)), position=[[0.5, 0.5, 0], [1.5, 0.5, 0], [2, 1.4, 0]]
        )
        vg.save_report(disks, folder / "disks.html")
        for name in ("sphere", "box"):
            one = vg.Packing.of(vg.make_shape(name), vg.Box((2, 2, 2)), position=[[1, 1, 1]])
            with pytest.MonkeyPatch.context() as coarse:
                coarse.setattr(view, "TRIANGLES", 80)
                vg.save_report(one, folder / f"{name}.html")
        vg.save_comparison({"first": bed, "second": smaller}, folder / "comparison.html", which=["density"])
    return folder


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Return a browser."""
    with chromium.Page(tmp_path_factory.mktemp("chromium")) as page:
        yield page


@pytest.fixture
def report(browser, pages):
    """Return the browser with the report open."""
    browser.open(pages / "report.html")
    return browser


def settled(browser, after=None):
    """Return the picture of the view once it is another one than before a change, if given, and changes no more."""
    end = time.monotonic() + 60
    before = browser.picture(CANVAS)
    while time.monotonic() < end:
        browser.frames(3)
        time.sleep(0.1)
        now = browser.picture(CANVAS)
        if (before == now).all() and (after is None or (after != now).any()):
            return now
        before = now
    raise AssertionError("the view does not change, or does not come to rest")


def change(browser, name, value, event="input"):
    """Set a control of the view as a person would."""
    browser.run(
        f"(() => {{ const e = document.getElementById('view-{name}'); e.value = {value!r}; "
        f"e.dispatchEvent(new Event('{event}')); }})()"
    )


def colored(picture):
    """Return the share of pixels that are neither gray nor white."""
    return float((np.ptp(picture.astype(int), axis=-1) > 40).mean())


def info(browser):
    return browser.run("document.getElementById('view-info').textContent")


def click(browser, across, down):
    left, top, width, height = browser.box(CANVAS)
    x, y = left + across * width, top + down * height
    browser.mouse(("mouseMoved", x, y))
    settled(browser)
    browser.mouse(("mousePressed", x, y), ("mouseReleased", x, y))
    browser.wait("document.getElementById('view-info').textContent", 20)


@pytest.mark.parametrize("name", ["report", "disks", "comparison"])
def test_pages_open_without_an_error_and_load_nothing(browser, pages, name):
    browser.open(pages / f"{name}.html")
    assert browser.run("document.getElementById('view-state').hidden")
    assert browser.complaints() == []
    assert browser.requests() == [(pages / f"{name}.html").as_uri()]
    assert 0.03 < colored(settled(browser)) < 0.8


def test_a_drag_turns_the_packing_and_picks_no_grain(report):
    before = settled(report)
    left, top, width, height = report.box(CANVAS)
    x, y = left + 0.5 * width, top + 0.5 * height
    report.mouse(
        ("mouseMoved", x, y), ("mousePressed", x, y), ("mouseMoved", x + 40, y + 5), ("mouseMoved", x + 120, y + 30),
        ("mouseReleased", x + 120, y + 30),
    )  # fmt: skip
    after = settled(report, before)
    assert (before != after).any(axis=-1).mean() > 0.03
    assert info(report) == ""
    assert report.complaints() == []


def test_a_click_names_the_grain_under_it(report):
    click(report, 0.5, 0.5)
    said = info(report)
    assert said.startswith("Grain ")
    bed, _ = beds()
    number = int(said.split()[1].rstrip(":"))
    # the line of sight through the middle meets it, and no grain in front of it for certain
    toward = view_axes()[2]
    away = bed.position - bed.container.bounds.mean(axis=0)
    depth = away @ toward
    off = np.linalg.norm(away - depth[:, None] * toward, axis=1)
    assert off[number] < bed.bounding_radii[number]
    assert depth[number] >= depth[off < 0.35].max() - 1e-9
    assert f"shape {bed.shapes[bed.shape_id[number]].name}" in said
    assert f"diameter {bed.diameters[number]:.4g} mm" in said
    found = bed.contacts(1e-9)
    partners = sorted({*found.j[found.i == number].tolist(), *found.i[found.j == number].tolist()})
    assert report.run("[...document.querySelectorAll('#view-info button')].map((b) => +b.textContent)") == partners


def test_a_number_and_a_contact_pick_a_grain(report):
    plain = settled(report)
    change(report, "grain", "18", "change")
    assert info(report).startswith("Grain 18: ")
    settled(report, plain)
    report.run("document.querySelector('#view-info button').click()")
    assert not info(report).startswith("Grain 18: ")
    change(report, "grain", "", "change")
    assert info(report) == ""
    change(report, "grain", "99", "change")
    assert info(report) == ""


@pytest.mark.parametrize(("axis", "end"), [("x", 0), ("y", 100), ("z", 0)])
def test_sliders_hide_what_lies_beyond(report, axis, end):
    uncut = settled(report)
    change(report, f"cut-{axis}", 50)
    cut = settled(report, uncut)
    change(report, f"cut-{axis}", end)
    emptied = settled(report, cut)
    whole = colored(uncut)
    assert colored(emptied) < 0.005 < colored(cut) < whole
    assert report.run(f"document.getElementById('view-at-{axis}').textContent").endswith(" mm")
    report.run("document.getElementById('view-reset').click()")
    assert colored(settled(report, emptied)) == pytest.approx(whole, abs=1e-3)


def test_colours_are_those_of_the_chosen_quantity(report):
    names = report.run("[...document.getElementById('view-color').options].map((o) => o.value)")
    assert names == ["diameter", "height", "shape", "coordination", "distance"]
    pictures = [settled(report)]
    for name in ("height", "shape"):
        change(report, "color", name, "change")
        pictures.append(settled(report, pictures[-1]))
    assert (pictures[1] != pictures[2]).any(axis=-1).mean() > 0.02
    assert report.run("document.getElementById('view-legend').textContent") == "Colour: number of the shape"
    assert report.run("document.getElementById('view-high').textContent") == "2"


@pytest.mark.parametrize(("name", "smooth"), [("sphere", True), ("box", False)])
def test_spheres_are_shaded_smoothly_and_boxes_have_flat_sides(browser, pages, name, smooth):
    browser.open(pages / f"{name}.html")
    picture = settled(browser).astype(int)
    shown = np.ptp(picture, axis=-1) > 40
    assert shown.sum() > 5_000
    # of a sphere of 80 flat triangles 85 % of the pixels have the colour of the next one
    equal = (picture[:, 1:] == picture[:, :-1]).all(axis=-1)[shown[:, 1:]].mean()
    assert equal < 0.5 if smooth else equal > 0.9


def test_disks_are_seen_from_above(browser, pages):
    browser.open(pages / "disks.html")
    settled(browser)
    assert browser.run("document.getElementById('view-cut-z')") is None
    change(browser, "grain", "1", "change")
    assert "In contact with 0 " in info(browser)


def test_a_comparison_shows_one_packing_after_the_other(browser, pages):
    browser.open(pages / "comparison.html")
    first = settled(browser)
    browser.run("(() => { const e = document.getElementById('view-packing'); e.selectedIndex = 1; "
                "e.dispatchEvent(new Event('change')); })()")  # fmt: skip
    second = settled(browser, first)
    assert (first != second).any(axis=-1).mean() > 0.02
    change(browser, "grain", "0", "change")
    assert "diameter 0.8 mm" in info(browser)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ["report", "comparison"])
def test_nothing_overflows(browser, pages, name, width):
    browser.open(pages / f"{name}.html", width=width)
    change(browser, "grain", "13", "change")
    outside = "e.getBoundingClientRect().right > innerWidth + 0.5 && !e.closest('.scroll, pre, svg, #view-canvas')"
    code = f"[...document.querySelectorAll('body *')].filter((e) => {outside}).map((e) => e.tagName + e.id)"
    assert browser.run(code) == []
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.box(CANVAS)[2] > 0.6 * min(width, 1120)


def test_it_prints_in_one_column_without_the_view(report):
    report.ask("Emulation.setEmulatedMedia", media="print")
    try:
        lefts = (
            "new Set([...document.querySelectorAll('.wide figure')].map((e) => e.getBoundingClientRect().left)).size"
        )
        assert report.run(lefts) == 1
        assert report.run("getComputedStyle(document.getElementById('view')).display") == "none"
    finally:
        report.ask("Emulation.setEmulatedMedia", media="screen")
    assert report.run(lefts) == 2


def test_pictures_stand_without_javascript(browser, pages):
    browser.open(pages / "report.html", scripts=False)
    browser.ask("Emulation.setScriptExecutionDisabled", value=False)
    # what the page showed while no script could run
    assert browser.run("document.getElementById('view-body').hidden")
    assert browser.run("[...document.images].every((e) => e.naturalWidth > 0 && e.alt)")
    assert browser.run("document.querySelector('noscript').innerText").startswith("The view needs JavaScript")
    assert browser.picture()[..., 0].std() > 5


def test_a_browser_without_webgl_says_so_and_keeps_the_pictures(browser, pages):
    added = browser.ask(
        "Page.addScriptToEvaluateOnNewDocument", source="delete window.DecompressionStream"
    )["identifier"]  # fmt: skip
    try:
        browser.ask("Page.navigate", url=(pages / "report.html").as_uri())
        said = "document.getElementById('view-state') && document.getElementById('view-state').textContent"
        browser.wait(f"({said} || '').startsWith('This browser cannot show the view')")
        assert browser.run("document.getElementById('view-body').hidden")
    finally:
        browser.ask("Page.removeScriptToEvaluateOnNewDocument", identifier=added)
