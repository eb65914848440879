"""Rules that every page of the documentation keeps, and the links that the site makes of those in the pages."""

import re
from pathlib import Path

import pytest
import site_links
from kit import slow

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
PAGES = sorted(
    path
    for path in DOCS.rglob("*.md")
    if path.relative_to(DOCS).parts[0] not in site_links.MADE
    and path.relative_to(DOCS).as_posix() not in site_links.ROOT_PAGES.values()
)
GUIDE = [path for path in PAGES if path.parent.name == "guide" and path.name != "index.md"]
NEW_GUIDE = ("containers", "packing", "files", "checkpoints")
#: lists of files and their members
WITHOUT_PICTURE = ("checkpoints", "decks_blocks", "files")
#: two screens
LONGEST_TEXT = 70


def longest_text(text):
    """Return the most lines of text in a row without a picture, a table or an example."""
    found = row = 0
    shown, fence = False, ""
    for line in text.splitlines():
        mark = re.match(r" *(```+|:::+)", line)
        if mark:
            fence = "" if fence else mark.group(1)
        shown = bool(fence or mark) or line.startswith(("|", "    ", "![")) or "![" in line
        row = 0 if shown else row + 1
        found = max(found, row)
    return found


def name_of(path):
    return path.relative_to(DOCS).as_posix()


def test_the_length_of_text_ends_at_pictures_tables_and_examples():
    assert longest_text("a\n" * 5) == 5
    for shown in ("| a |\n", "```python\n" + "b\n" * 9 + "```\n", "![a](b.png)\n", "    code\n"):
        assert longest_text("a\n" * 5 + shown + "a\n" * 3) == 5


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_a_page_has_two_screens_of_text_at_most_before_something_to_see(path):
    assert longest_text(path.read_text()) <= LONGEST_TEXT


@pytest.mark.parametrize("path", GUIDE, ids=name_of)
def test_a_page_of_the_guide_begins_with_what_it_is_for_and_an_example(path):
    lines = path.read_text().splitlines()
    assert lines[0].startswith("# ")
    example = next(number for number, line in enumerate(lines) if line.startswith("```"))
    text = [line for line in lines[1:example] if line]
    assert 1 <= len(text) <= 8
    assert not any(line.startswith(("|", "#", "    ")) for line in text)


@pytest.mark.parametrize("path", GUIDE, ids=name_of)
def test_a_page_of_the_guide_shows_a_picture(path):
    assert re.search(r"!\[.+?\]\(\.\./figures/\w+\.(?:svg|png)\)", path.read_text()) or path.stem in WITHOUT_PICTURE


@pytest.mark.parametrize("part", ["start", "guide", "validation", "contribute"])
def test_every_page_is_in_the_contents_of_its_part(part):
    text = (DOCS / part / "index.md").read_text()
    entries = re.search(r"```\{toctree\}\n(.*?)```", text, re.DOTALL).group(1).split()
    assert {path.stem for path in PAGES if path.parent.name == part} - {"index"} <= set(entries)
    assert len(entries) == len(set(entries))


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_a_page_says_nothing_twice(path):
    shown = re.sub(r"^```.*?^```", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)
    paragraphs = [text for text in shown.split("\n\n") if len(text) > 60]
    assert len(paragraphs) == len(set(paragraphs))


@pytest.mark.parametrize("path", [*PAGES, ROOT / "README.md"], ids=lambda path: path.name)
def test_links_lead_to_files_that_exist(path):
    for target in site_links.links_in(path.read_text()):
        file = (path.parent / target.partition("#")[0]).resolve()
        if "://" in target or target.startswith("#"):
            continue
        made = file.is_relative_to(DOCS) and file.relative_to(DOCS).parts[0] in site_links.MADE
        assert made or file.exists(), target


@pytest.mark.filterwarnings("ignore:the bulk holds")
@pytest.mark.parametrize("page", [slow(page) if page in ("containers", "packing") else page for page in NEW_GUIDE])
def test_examples_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for example in re.findall(r"```python\n(.*?)```", (DOCS / "guide" / f"{page}.md").read_text(), re.DOTALL):
        exec(example, {})


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("[a](rsa.md#x)", "[a](rsa.md#x)"),
        ("[a](#x) [b](https://a.b/c.csv)", "[a](#x) [b](https://a.b/c.csv)"),
        ("![a](../figures/rsa.svg)", "![a](../figures/rsa.svg)"),
        ("[`a`](../../examples/any_porosity.toml)", "{download}`a <../../examples/any_porosity.toml>`"),
        ("[a](../figures/rsa.csv)", "{download}`a <../figures/rsa.csv>`"),
        ("[a](../../examples/studies)", "a"),
        ("[a](../methods/no_such.md)", "a"),
        ("[a](../../README.md)", "[a](../index.md)"),
        ("[a](../../CHANGELOG.md)", "[a](../changelog.md)"),
        ("`[a](../figures/rsa.csv)`", "`[a](../figures/rsa.csv)`"),
        ("```text\n[a](../figures/rsa.csv)\n```", "```text\n[a](../figures/rsa.csv)\n```"),
    ],
)
def test_links_become_what_the_site_has(text, made):
    assert site_links.with_links(text, DOCS / "guide") == made


def test_a_script_leads_to_its_page_in_the_gallery_where_there_is_one(monkeypatch, tmp_path):
    (tmp_path / "docs" / "gallery").mkdir(parents=True)
    monkeypatch.setattr(site_links, "ROOT", tmp_path)
    monkeypatch.setattr(site_links, "DOCS", tmp_path / "docs")
    call = ("[a](../../examples/a.py) [b](../../examples)", tmp_path / "docs" / "guide")
    assert site_links.with_links(*call) == "{download}`a <../../examples/a.py>` [b](../../examples)".replace(
        "[b](../../examples)", "{download}`b <../../examples>`"
    )
    for name in ("a", "index"):
        (tmp_path / "docs" / "gallery" / f"{name}.rst").touch()
    assert site_links.with_links(*call) == "[a](../gallery/a.rst) [b](../gallery/index.rst)"


def test_links_of_a_page_from_the_root_are_relative_to_its_new_place():
    text = site_links.with_links("[a](docs/guide/rsa.md)", ROOT, page=DOCS / "contribute")
    assert text == "[a](../guide/rsa.md)"


def test_the_first_use_of_a_term_leads_to_the_glossary():
    text = "# A rattler\n\n[rattler](a.md), `rattler`\n\n| rattler |\n\n```\nstudy\n```\n"
    text += "Rattlers and\na rattler. Study. Jammed.\n"
    made = site_links.with_terms(text, ["rattler", "study", "jam"])
    assert made == text.replace("Rattlers", "{term}`Rattlers <rattler>`").replace("Study.", "{term}`Study <study>`.")
    assert site_links.with_terms(text, []) == text


def test_the_longest_term_is_linked():
    terms = site_links.glossary_terms()
    assert {"solid fraction", "bulk solid fraction", "clump", "bonded clump", "Verlet list"} <= set(terms)
    assert len(terms) > 40
    made = site_links.with_terms("The bulk solid fraction of two bonded clumps.", terms)
    assert made == "The {term}`bulk solid fraction <bulk solid fraction>` of two {term}`bonded clumps <bonded clump>`."


def test_contents_name_pages_that_exist_only():
    text = "```{toctree}\n:hidden:\n\nrsa\nno_such_page\nA <files>\n```\n\n```python\nno_such_page\n```"
    made = site_links.with_pages_that_exist(text, DOCS / "guide")
    assert made == text.replace("no_such_page\nA", "A")
