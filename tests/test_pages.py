"""What the pages show: the numbers of files, what their Python and commands print, and figures that commands make.

The Python of the pages runs as it is written, in an empty folder, without files of a checkout.
"""

import re
import runpy
import subprocess
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest
from kit import slow

from benchmarks.model import benchmarks
from voxgran._base.errors import EngineError

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures"
TOOL = SimpleNamespace(**runpy.run_path(str(ROOT / "tools" / "pages.py")))
PAGES = TOOL.pages()
#: pages whose Python and commands take seconds
QUICK = ("README.md", "tutorial.md")
#: columns that are other numbers on every run: of times, and of as many attempts as there is time for
TIMES = re.compile("second|calibration|ratio_to|accepted|bytes|memory|_mib")
#: benchmarks that take more than ten minutes, or programs that this machine may lack
LEFT_OUT = ("scale", "settle", "twin_loops", "compression", "relax")


def name_of(page):
    return page.relative_to(ROOT).as_posix()


def shows_output(page):
    text = page.read_text()
    return bool(TOOL.blocks_of(text)) or bool(re.search(r"^```console\n(\$ .*\n)+[^`$]", text, flags=re.MULTILINE))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_numbers_of_a_page_are_those_of_its_files(page):
    assert TOOL.differences(page, TOOL.filled) == [], "run tools/pages.py --write"


@pytest.mark.exact_start("it compares digits that a run prints with those of a page")
@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.usefixtures("jagged_pictures")
@pytest.mark.parametrize(
    "page", [page if page.name in QUICK else slow(page) for page in PAGES if shows_output(page)], ids=name_of
)
def test_a_page_shows_what_its_python_and_its_commands_print(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    try:
        assert TOOL.differences(page, TOOL.printed) == []
    except EngineError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_python_of_a_page_names_no_files_of_a_checkout(page):
    for block in TOOL.blocks_of(page.read_text()):
        assert not re.search(r"""load\w*\(["'](data/|eros|bennu|itokawa|bunny|\w+\.obj)""", block), block


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_rows_of_a_table_have_as_many_cells_as_its_head(page):
    text = re.sub("<!--.*?-->|^```.*?^```|`[^`\n]*`", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for table in re.findall(r"(?:^\|.*\n)+", text, flags=re.MULTILINE):
        assert len({row.count("|") for row in table.splitlines()}) == 1, table[:80]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_programs_and_tests_that_a_page_names_exist(page):
    text = page.read_text()
    assert set(re.findall(r"-m benchmarks\s(\w+)`", text)) <= set(benchmarks())
    for file in re.findall(r"\b(?:examples|tools|tests)/[\w/]+\.(?:py|toml)\b", text):
        assert (ROOT / file).is_file(), file


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_comment_of_a_page_is_a_source_of_numbers(page):
    text = page.read_text()
    assert text.count("<!--") == len(TOOL.VALUE.findall(text)) + len(TOOL.TABLE.findall(text))


def made_by_make():
    """Return the names of the files of docs/figures that the targets of the Makefile make."""
    asked = ["make", "--dry-run", "--always-make", "figures", "bench", "studies"]
    commands = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    commands = commands.replace("\\\n", " ")
    sources = {name: (ROOT / f"{file.replace('.', '/')}.py").read_text() for name, file in benchmarks().items()}
    found = set(re.findall(r"docs/figures/([\w.]+)", commands)) | {"house.svg"}
    for line in re.findall(r"^cp (.*) docs/figures$", commands, flags=re.MULTILINE):
        found |= {Path(word).name for word in line.split()}
    for name in re.findall(r"-m benchmarks (\w+) -o docs/figures$", commands, flags=re.MULTILINE):
        found |= {f"{name}.{end}" for end in ("csv", "svg")} | set(re.findall(r'"(\w+\.\w{3})"', sources[name]))
    if "APP_PICTURES=docs/figures" in commands:
        tested = (ROOT / "tests" / "browser" / "test_app.py").read_text()
        found |= set(re.findall(r'kept\(tab, tmp_path, "(\w+\.png)"\)', tested))
    return found


def test_every_file_of_the_figures_is_made_by_make_and_stands_on_a_page():
    names = {path.name for path in FIGURES.iterdir()}
    assert names - made_by_make() == set()
    text = "".join(path.read_text() for path in [*PAGES, *ROOT.glob("docs/contribute/*.md"), *ROOT.glob("*.md")])
    assert {name for name in names if f"figures/{name}" not in text} == set()


def test_every_benchmark_is_a_target_of_make():
    text = (ROOT / "Makefile").read_text().replace("\\\n", " ")
    assert set(re.search(r"^BENCHES := \$\(addprefix bench-,(.*)\)", text, re.MULTILINE)[1].split()) == set(
        benchmarks()
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in benchmarks() if name not in LEFT_OUT])
def test_a_benchmark_gives_the_numbers_of_its_files_but_for_times(name, tmp_path):
    made = [path for path in import_module(benchmarks()[name]).run(tmp_path) if path.suffix == ".csv"]
    for path in made:
        assert [lasting(row) for row in rows(path)] == [lasting(row) for row in rows(FIGURES / path.name)], path.name


def rows(path):
    """Return the rows of a file, without those of programs that this machine may lack."""
    programs = re.compile("LAMMPS|PyBullet|MuJoCo|SNOW|CLUMP|multisphere")
    TOOL.table.__wrapped__.__globals__["FIGURES"] = path.parent
    found = TOOL.table.__wrapped__(path.stem)
    return [row for row in found if not any(programs.search(str(value)) for value in row.values())]


def lasting(row):
    """Return a row without times and their ratios."""
    timed = any(TIMES.search(name) for name in row)
    return {name: value for name, value in row.items() if not TIMES.search(name) and not (timed and name == "ratio")}


PAGE = """
Spheres reach 0.5<!-- = of("made", shape="sphere").density:.3f -->.

<!-- rows of made.csv where density > 0
| {shape} | {density:.2f} |
-->

| shape | density |
|---|---|
| old | 1 |
| rows | 2 |

<!-- values of made.csv
| both | {mean(each("density")):.2f} | {at(shape="cube").note} |
-->
| | mean | note |
|---|---|---|

after
"""


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A file in place of those of docs/figures."""
    (tmp_path / "made.csv").write_text('shape,density,note\nsphere,0.6405,\ncube,0.7,"a, b"\n')
    monkeypatch.setitem(TOOL.table.__wrapped__.__globals__, "FIGURES", tmp_path)
    TOOL.table.cache_clear()
    yield
    TOOL.table.cache_clear()


def test_numbers_and_tables_are_made_of_a_file(made):
    text = TOOL.filled(PAGE)
    assert "reach 0.640<!-- = of" in text
    assert "|---|---|\n| sphere | 0.64 |\n| cube | 0.70 |\n\n<!-- values" in text
    assert text.endswith("|---|---|---|\n| both | 0.67 | a, b |\n\nafter\n")
    assert TOOL.filled(text) == text


def test_rows_with_equal_values_are_a_group(made):
    text = "<!-- rows of made.csv by note\n| {note} | {max(each('density')):.1f} |\n-->\n| a | b |\n|---|---|\n"
    assert TOOL.filled(text).endswith("|  | 0.6 |\n| a, b | 0.7 |\n")


@pytest.mark.parametrize(
    ("expression", "said"),
    [
        ('of("made", shape="box").density', "0 rows have"),
        ('of("made").density', "2 rows have"),
        ('of("made", shape="cube").mass', "no column mass; there are shape, density, note"),
        ('of("none").density', "none.csv"),
    ],
)
def test_a_source_that_is_not_there_is_told(expression, said, made):
    with pytest.raises((KeyError, ValueError, OSError), match=said):
        TOOL.filled(f"0.1<!-- = {expression} -->")


def test_what_is_printed_replaces_the_block_that_follows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = '```python\nx = 1\nprint(x)\n```\n\n```text\n2\n```\n\n```console\n$ python -c "print(3)"\nold\n```\n'
    page += "```text\nno output\n```\n```console\n$ voxgran run none.toml\n```\n"
    assert TOOL.printed(page) == page.replace("\n2\n", "\n1\n").replace("\nold\n", "\n3\n")


def test_pages_are_replaced_where_this_is_asked(made, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    assert "+Spheres reach 0.640" in "\n".join(TOOL.differences(page, TOOL.filled))
    assert page.read_text() == PAGE
    assert TOOL.differences(page, TOOL.filled, write=True)
    assert TOOL.differences(page, TOOL.filled) == []


def test_the_pages_are_all_that_users_read():
    assert {"README.md", "index.md", "glossary.md", "settling.md", "tutorial.md", "densities.md"} <= {
        page.name for page in PAGES
    }
