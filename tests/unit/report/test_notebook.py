"""What notebooks show of packings: the view in a frame, which loads nothing, or a card with the reason."""

import html
import sys

import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, MissingLibraryError
from voxgran.report import notebook


@pytest.fixture(scope="module")
def bed():
    """Return a small packing."""
    return vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 4)), "rsa", count=8, seed=0)


def test_a_view_in_a_frame(bed, tmp_path):
    made = bed.view(color_by="height")
    shown = made._repr_html_()
    assert shown.count("<iframe srcdoc=") == 1
    assert html.escape(made.page) in shown
    assert f"{made.megabytes:.1f} MB" in shown
    # it loads nothing
    assert "http" not in made.page.split('<script type="application/gzip" id="view-viewer">')[0]
    assert 'src="' not in made.page
    assert '"color": "height"' in made.page
    assert "MB; it turns" in repr(made)
    made.save(tmp_path / "view.html")
    assert (tmp_path / "view.html").read_text() == made.page
    with pytest.raises(FileFormatError):
        made.save(tmp_path / "view.png")
    assert "<iframe" in bed._repr_html_()


def test_it_says_why_it_is_static(bed, monkeypatch):
    large = vg.view(bed, most=0.1)
    assert "MB, more than 0.1" in large.reason
    shown = large._repr_html_()
    assert "<iframe" not in shown
    assert "data:image/png" in shown
    assert html.escape(large.reason) in shown
    with pytest.raises(InputError, match="static"):
        large.save("view.html")
    monkeypatch.setattr(notebook, "GRAINS", 5)
    assert "5 of 8 grains" in vg.view(bed).reason
    monkeypatch.undo()

    def missing(*_):
        raise MissingLibraryError("plotly is not installed: pip install plotly")

    monkeypatch.setattr(notebook, "views_of", missing)
    assert "plotly is not installed" in bed._repr_html_()
    assert "no grains" in vg.view(bed[:0]).reason or "plotly" in vg.view(bed[:0]).reason


def test_the_widget_of_pyvista_where_trame_is_there(bed, monkeypatch):
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    monkeypatch.setattr(notebook, "notebook_backend", lambda: "trame")
    monkeypatch.setattr(notebook, "plot", lambda packing, color_by: (packing, color_by))
    assert bed.view(color_by="shape") == (bed, "shape")
    assert "<iframe" in bed._repr_html_()
