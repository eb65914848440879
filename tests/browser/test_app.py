"""The app in a real browser: put together by clicks and keys, run, cut, coloured, taken away, as at the prompt.

With the variable APP_PICTURES the pictures of the guide are written into that folder.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import chromium
import numpy as np
import pytest
from kit import grey_beads
from PIL import Image

import voxgran as vg
from voxgran.cli import main

pytest.importorskip("trame_pyvista", reason="the extra [app] is not installed")
pytest.importorskip("tomli_w")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(chromium.PROGRAM is None, reason="chromium is not installed: make test-browser"),
    pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning"),
]
SPHERES = """
[scene]
seed = 3
[[shape]]
family = "sphere"
[container]
kind = "box"
lengths = [22, 22, 22]
[packing]
method = "rsa"
solid_fraction = 0.35
[measure]
which = ["coordination"]
[output]
report = false
vtk = false
"""


class App:
    """The app as a process, and pages of it."""

    def __init__(self, folder, *words):
        command = [sys.executable, "-m", "voxgran", "app", *words, "--no-browser", "-o", str(folder / "runs")]
        self.folder, self.log = folder, (folder / "log").open("w")
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self.log, text=True, cwd=folder)
        self.address = self.process.stdout.readline().split()[1]

    def __enter__(self):
        return self

    def children(self):
        """Return the numbers of the processes that it has started."""
        tasks = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        return [int(number) for task in tasks for number in task.read_text().split()]

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(30) in (0, 130), (self.folder / "log").read_text()
        self.process.stdout.close()
        self.log.close()


@pytest.fixture
def tab(tmp_path):
    """Return a tab, whose downloads go to a folder."""
    (tmp_path / "taken").mkdir()
    with chromium.Page(tmp_path / "chromium") as page:
        yield ready(page, tmp_path / "taken")


def ready(page, folder):
    """Return a page that saves downloads in a folder."""
    page.size(1400, 900)
    page.ask("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder))
    return page


def click(page, selector, text=""):
    """Click in the middle of the first element that holds a text, which is scrolled to."""
    found = f"[...document.querySelectorAll({selector!r})].find((e) => e.innerText.includes({text!r}))"
    page.wait(f"!!({found})")
    unmarked = "document.querySelectorAll('.aim').forEach((e) => e.classList.remove('aim'))"
    page.run(f"{unmarked}; ({found}).classList.add('aim')")
    before, box = None, page.box(".aim")
    while box != before:
        # what opens moves
        time.sleep(0.3)
        before, box = box, page.box(".aim")
    left, top, width, height = box
    x, y = left + width / 2, top + height / 2
    page.mouse(("mousePressed", x, y), ("mouseReleased", x, y))


def write(page, selector, text):
    """Write into a field, in place of what it holds."""
    page.wait(f"!!document.querySelector({selector!r})")
    page.run(f"(() => {{ const e = document.querySelector({selector!r}); e.focus(); e.select(); }})()")
    page.ask("Input.insertText", text=text)


def give(page, selector, path):
    """Give a file to a field."""
    found = page.ask("Runtime.evaluate", expression=f"document.querySelector({selector!r})")["result"]["objectId"]
    page.ask("DOM.setFileInputFiles", files=[str(path)], objectId=found)


def text_of(page, selector):
    """Return the text of an element."""
    return page.run(f"(document.querySelector({selector!r}) || {{innerText: ''}}).innerText")


def press(page, key, code, times=1):
    """Press a key of a code."""
    for kind in ("keyDown", "keyUp") * times:
        page.ask("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)


def taken(page, folder, name):
    """Return a file that is taken away."""
    click(page, f"[id='take-{name}']")
    end = time.monotonic() + 60
    while not (folder / name).exists():
        assert time.monotonic() < end, f"{name} has not come: {text_of(page, '#error')} {page.complaints()}"
        time.sleep(0.1)
    return folder / name


def kept(page, folder, name):
    """Keep a picture of the page."""
    Image.fromarray(page.picture()).save(folder / name)
    if os.environ.get("APP_PICTURES"):
        Image.fromarray(page.picture()).quantize(256).save(Path(os.environ["APP_PICTURES"]) / name, optimize=True)


def changed(page, before):
    """Return the view when it is another picture, and the same one for two seconds."""
    end, last, now = time.monotonic() + 90, None, before
    while last is None or np.abs(now - before).max(axis=2).mean() < 1 or np.abs(now - last).max() > 0:
        assert time.monotonic() < end, "the view has not changed"
        time.sleep(2)
        last, now = now, page.picture("#view").astype(int)
    return now


def same(one, two):
    """Return whether two packings have the same bits."""
    one, two = vg.load(one), vg.load(two)
    return all(np.array_equal(getattr(one, name), getattr(two, name)) for name in ("position", "orientation", "scale"))


def test_a_scene_is_put_together_run_looked_at_and_taken_away(tab, tmp_path):
    with App(tmp_path) as app:
        tab.go(app.address.partition("?")[0])
        time.sleep(2)
        assert not tab.run("!!document.querySelector('#run')"), "a page without the token is shown"
        tab.go(app.address)
        tab.wait("!!document.querySelector('#plan') && document.querySelector('#plan').innerText.length > 0")
        click(tab, "#preview")
        click(tab, ".v-expansion-panel-title", "Packing")
        write(tab, "#packing-count", "sixty")
        tab.wait("document.querySelector('#error').innerText.includes('[packing]')")
        tab.wait("document.querySelector('.v-expansion-panel-title .section-error:not(:empty)') !== null")
        write(tab, "#packing-count", "60")
        tab.wait("document.querySelector('#plan').innerText.includes('60')")
        assert not text_of(tab, "#error")
        (tmp_path / "no_mesh.stl").write_text("nothing of this is a mesh")
        give(tab, "#upload", tmp_path / "no_mesh.stl")
        tab.wait("document.querySelector('#error').innerText.includes('no_mesh.stl')")
        assert tab.run("document.querySelector('#packing-count').value") == "60"
        click(tab, "#run")
        tab.wait("!!document.querySelector('.lamp')", 240)
        time.sleep(4)
        kept(tab, tmp_path, "app.png")
        before = tab.picture("#view").astype(int)
        # coloured by height, and cut along x
        click(tab, "#color-by")
        click(tab, ".v-overlay .v-list-item", "height")
        tab.wait("document.querySelector('#color-by').closest('.v-select').innerText.includes('height')")
        colored = changed(tab, before)
        tab.run("document.querySelector('.v-slider-thumb').focus()")
        press(tab, "ArrowLeft", 37, times=50)
        changed(tab, colored)
        kept(tab, tmp_path, "app_cut.png")
        scene, packing = taken(tab, tmp_path / "taken", "scene.toml"), taken(tab, tmp_path / "taken", "packing.vtp")
        tab.size(1024, 700)
        time.sleep(2)
        kept(tab, tmp_path, "app_small.png")
        tab.size(400, 800)
        time.sleep(2)
        for button in ("#ct", "#preview", "#run", "#right"):
            assert tab.box(button)[0] + tab.box(button)[2] <= 400, button
        # trame's client asks once whether the server starts sessions, which it does not
        assert not [said for said in tab.complaints() if "405" not in str(said)]
    assert vg.load(packing).count == 60
    assert main(["run", str(scene), "-o", str(tmp_path / "out"), "--quiet"]) in (0, None)
    assert same(packing, tmp_path / "out" / "packing.vtp")


def test_a_run_stops_goes_on_and_is_seen_by_a_second_browser_and_without_one(tab, tmp_path):
    (tmp_path / "scene.toml").write_text(SPHERES)
    with App(tmp_path, "scene.toml") as app:
        tab.go(app.address)
        click(tab, "#run")
        tab.wait("document.querySelector('.run') && document.querySelector('.run').innerText.includes('packing')", 60)
        # it waits, so that it has not ended when it is stopped, however slow the browsers are
        (run,) = app.children()
        os.kill(run, signal.SIGSTOP)
        with chromium.Page(tmp_path / "second") as other:
            ready(other, tmp_path).go(app.address)
            click(other, ".run .stop", "STOP")
            os.kill(run, signal.SIGCONT)
            tab.wait("!!document.querySelector('.run .go-on')")
            click(tab, ".run .go-on")
        # nobody looks
        tab.go("about:blank")
        end = time.monotonic() + 240
        while not (tmp_path / "runs" / "run_1" / "summary.json").exists():
            assert time.monotonic() < end
            time.sleep(0.2)
        tab.go(app.address)
        tab.wait("!!document.querySelector('.lamp')")
        # loaded again, without the token in its address; and the app ends while a run is computed
        tab.go(app.address.partition("?")[0])
        click(tab, "#run")
        tab.wait("[...document.querySelectorAll('.run')].some((e) => e.innerText.includes('packing'))")
        children = app.children()
    assert children
    assert not any(Path(f"/proc/{child}").exists() for child in children)
    assert list((tmp_path / "runs" / "run_2").glob("checkpoint*"))
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "out"), "--quiet"]) in (0, None)
    assert same(tmp_path / "runs" / "run_1" / "packing.vtp", tmp_path / "out" / "packing.vtp")


BED = """
[scene]
seed = 3
[[shape]]
family = "box"
[container]
kind = "box"
lengths = [3, 3, 7]
[packing]
method = "gravity"
count = 25
[output]
report = false
statistics = false
vtk = false
"""


def chosen(page, selector, text):
    """Choose an entry of a list; return all of them."""
    click(page, selector)
    page.wait(f"[...document.querySelectorAll('.v-overlay .v-list-item')].some((e) => e.innerText == {text!r})")
    listed = page.run("[...document.querySelectorAll('.v-overlay .v-list-item')].map((e) => e.innerText)")
    click(page, ".v-overlay .v-list-item", text)
    page.wait("!document.querySelector('.v-overlay .v-list-item')")
    return listed


def test_contacts_a_picked_grain_figures_and_all_files(tab, tmp_path):
    (tmp_path / "scene.toml").write_text(BED)
    with App(tmp_path, "scene.toml") as app:
        tab.go(app.address)
        click(tab, "#run")
        tab.wait("document.querySelectorAll('.lamp').length == 2", 240)
        assert "at rest" in text_of(tab, "#results")
        last = changed(tab, np.zeros_like(tab.picture("#view").astype(int)))
        for way in ("contacts", "force chains", "grains"):
            assert chosen(tab, "#way", way) == ["grains", "contacts", "force chains"]
            last = changed(tab, last)
        chosen(tab, "#color-by", "residual")
        last = changed(tab, last)
        left, top, width, height = tab.box("#view")
        for share in (0.6, 0.7, 0.5):
            # one of these places shows a grain
            x, y = left + 0.5 * width, top + share * height
            event = f"new MouseEvent('dblclick', {{bubbles: true, clientX: {x}, clientY: {y}}})"
            tab.run(f"document.elementFromPoint({x}, {y}).dispatchEvent({event})")
            with contextlib.suppress(AssertionError):
                tab.wait("!!document.querySelector('#grain')", 20)
                break
        assert "residual (weights of the grain)" in text_of(tab, "#grain")
        # beside the bed, not over it
        assert tab.box("#grain")[0] >= left + width
        time.sleep(4)
        last = tab.picture("#view").astype(int)
        for way in ("surface", "voxels", "points", "clump", "neighbours"):
            assert len(chosen(tab, "#way", f"picked grain: {way}")) == 8
            last = changed(tab, last)
            if way == "clump":
                kept(tab, tmp_path, "app_grain.png")
        click(tab, "#figures")
        tab.wait("document.querySelectorAll('.figure img').length >= 5", 60)
        for name in (
            "packing.vtp",
            "scene.toml",
            "scene.py",
            "report.html",
            "statistics.nc",
            "picture.png",
            "lammps.zip",
        ):
            assert taken(tab, tmp_path / "taken", name).stat().st_size > 0, name


def test_a_scan_is_opened_segmented_by_sliders_and_becomes_a_packing(tab, tmp_path, monkeypatch):
    # lines of Python are for who starts where the app was started
    monkeypatch.chdir(tmp_path)
    rows = 8 + 16 * np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    centers = rows + np.random.default_rng(1).uniform(-1, 1, rows.shape)
    # two of the spheres are nearly one
    centers[[4, 13]] = [(13.25, 24, 24), (21.75, 24, 24)]
    np.save(tmp_path / "scan.npy", grey_beads(centers, 7, 48))
    with App(tmp_path) as app:
        tab.go(app.address)
        click(tab, "#ct")
        write(tab, "#scan-path", "nothing.npy")
        click(tab, "#scan-open")
        tab.wait("document.querySelector('#scan').innerText.includes('nothing.npy is not there')")
        write(tab, "#scan-path", "scan.npy")
        click(tab, "#scan-open")
        tab.wait("document.querySelectorAll('.slice').length == 3")
        # the file does not say how large its voxels are
        click(tab, "#scan-finish")
        tab.wait("document.querySelector('#scan').innerText.includes('voxel_size is None')")
        write(tab, "#scan-voxel_size", "0,05")
        write(tab, "#scan-unit", "mm")
        click(tab, "#scan-open")
        tab.wait("document.querySelector('#scan-about').innerText.includes('0.05 x 0.05 x 0.05 mm')")
        tab.wait("document.querySelector('#scan-found').innerText.includes('perhaps one: 9 and 10')")
        tab.run("document.querySelector('#scan .v-slider-thumb').focus()")
        press(tab, "ArrowLeft", 37, times=5)
        tab.wait("document.querySelector('#scan-found').innerText.includes('perhaps several: 9')")
        # slices with the labels come after them
        time.sleep(2)
        kept(tab, tmp_path, "app_scan.png")
        python = text_of(tab, "#scan-python")
        assert "load_image('scan.npy'" in python
        click(tab, "#scan-finish")
        tab.wait("!!document.querySelector('.lamp')", 240)
        assert not tab.run("document.querySelector('#scan').offsetHeight")
        packing = vg.load(taken(tab, tmp_path / "taken", "packing.vtp"))
        assert not [said for said in tab.complaints() if "405" not in str(said)]
    names = {}
    exec(python, names)
    assert packing.count == 26
    assert np.array_equal(packing.position, names["packing"].position)
