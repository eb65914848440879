"""The interactive view is asked for and left out at the prompt and in scenes."""

import pytest
from kit import slow, small_scene

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.cli import main
from voxgran.scene.sections import Output

pytestmark = pytest.mark.usefixtures("jagged_pictures")

VIEW = 'id="view-canvas"'
#: words at the prompt, and whether the page has the view
WORDS = [((), True), slow(("--interactive",), True), (("--no-interactive",), False)]
SCENE = (
    small_scene()
    + """[measure]
which = ["gradation"]
[output]
vtk = false
statistics = false
"""
)


@pytest.fixture
def saved(tmp_path):
    """Return a file of a packing."""
    bed = vg.Packing.of(vg.shapes.sphere(), vg.Box((3, 3, 3)), position=[[1, 1, 1], [2, 2, 2]])
    vg.save(bed, tmp_path / "bed.vtp")
    return tmp_path / "bed.vtp"


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.parametrize(
    ("words", "shown"), [((), True), slow(("--interactive",), True), (("--no-interactive",), False)]
)
def test_reports_at_the_prompt_have_the_view_unless_it_is_refused(saved, words, shown, capsys):
    page = saved.with_name("page.html")
    assert main(["report", str(saved), "-o", str(page), *words]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    text = page.read_text()
    assert (VIEW in text) == shown
    assert ("<script" in text) == shown
    assert text.count("<img") >= 2


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.parametrize(
    ("words", "shown"), [((), True), slow(("--interactive",), True), (("--no-interactive",), False)]
)
def test_comparisons_at_the_prompt_have_the_view_unless_it_is_refused(saved, words, shown, capsys):
    page = saved.with_name("page.html")
    assert main(["compare", f"one={saved}", f"two={saved}", "-o", str(page), *words]) == 0
    text = page.read_text()
    assert (VIEW in text) == shown
    assert ("<script" in text) == shown


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.parametrize(
    ("line", "shown"), [("", True), slow("interactive = true", True), ("interactive = false", False)]
)
def test_scenes_have_the_view_unless_their_key_refuses_it(tmp_path, line, shown):
    (tmp_path / "scene.toml").write_text(SCENE + line + "\n")
    scene = vg.Scene.from_toml(tmp_path / "scene.toml")
    assert scene.output.interactive is shown
    scene.run(tmp_path / "out")
    assert (VIEW in (tmp_path / "out" / "report.html").read_text()) == shown


def test_the_key_is_true_or_false(tmp_path):
    assert Output().interactive
    (tmp_path / "scene.toml").write_text(SCENE + 'interactive = "no"\n')
    with pytest.raises(InputError, match="interactive"):
        vg.Scene.from_toml(tmp_path / "scene.toml")
