"""The tutorial as a notebook: its cells executed by IPython, and their outputs looked at in Chromium."""

import html
import re
from pathlib import Path

import chromium
import numpy as np
import pytest

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(chromium.PROGRAM is None, reason="chromium is not installed: make test-browser"),
]
PAGE = Path(__file__).parents[2] / "docs" / "start" / "tutorial.md"
#: values that a reader puts at the end of a cell to see them
SHOWN = ("rock", "clump", "packing")


@pytest.fixture(scope="module")
def notebook(tmp_path_factory):
    """Execute the cells of the tutorial; return a page with what they print and, as a notebook does, show."""
    shells = pytest.importorskip("IPython.core.interactiveshell")
    folder = tmp_path_factory.mktemp("notebook")
    cells = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("IPYTHONDIR", str(folder / "ipython"))
        shell = shells.InteractiveShell()
        shell.history_manager.enabled = False
        # as in a notebook; at a terminal values are shown as text only
        shell.display_formatter.active_types = shell.display_formatter.format_types
        for cell in cells:
            shell.run_cell(cell).raise_error()
        outputs = {}
        for name in SHOWN:
            value = shell.run_cell(name)
            value.raise_error()
            outputs[name] = shell.display_formatter.format(value.result)[0]
        # of the packing as a notebook keeps it where it may hold a megabyte only
        small = shell.run_cell("packing.view(most=1.0)").result
        outputs["static"] = shell.display_formatter.format(small)[0]
        shell.history_manager.end_session()
    parts = [f'<div id="{name}">{output["text/html"]}</div>' for name, output in outputs.items()]
    path = folder / "notebook.html"
    path.write_text(f"<!doctype html><title>notebook</title>{''.join(parts)}", encoding="utf-8")
    return path, outputs


@pytest.fixture(scope="module")
def shown(notebook, tmp_path_factory):
    """Return the browser with the page of the notebook open, and its view drawn."""
    with chromium.Page(tmp_path_factory.mktemp("chromium")) as page:
        page.open(notebook[0])
        page.box("iframe")
        page.wait(
            "document.querySelector('iframe').contentDocument.getElementById('view-body')?.dataset.ready === 'yes'"
        )
        yield page


def test_values_at_the_end_of_cells_are_shown(notebook, shown):
    _, outputs = notebook
    assert all("text/plain" in output for output in outputs.values())
    for name in SHOWN:
        size = shown.box(f"#{name} img, #{name} svg")[2:]
        assert min(size) > 60, name
    assert "150" in shown.run("document.getElementById('packing').textContent")
    assert shown.complaints() == []


def test_the_view_of_the_bed_turns_in_its_frame(notebook, shown):
    path, _ = notebook
    left, top, width, height = shown.box("iframe")
    before = shown.picture("iframe")
    assert (np.ptp(before.astype(int), axis=-1) > 40).mean() > 0.02
    x, y = left + 0.4 * width, top + 0.4 * height
    shown.mouse(
        ("mouseMoved", x, y), ("mousePressed", x, y), ("mouseMoved", x + 40, y + 5), ("mouseMoved", x + 120, y + 30),
        ("mouseReleased", x + 120, y + 30),
    )  # fmt: skip
    shown.frames(10)
    assert (before != shown.picture("iframe")).any(axis=-1).mean() > 0.01
    # a saved notebook opens without a network
    assert shown.requests() == [path.as_uri()]


def test_a_view_that_is_static_says_why(notebook, shown):
    assert shown.run("document.querySelectorAll('#static iframe').length") == 0
    told = shown.run("document.getElementById('static').textContent")
    assert re.search(r"The picture does not turn: its view takes \d\.\d MB, more than 1; view\(most=\.\.\.\)", told)
    assert html.unescape(notebook[1]["static"]["text/html"]).count("<iframe") == 0
