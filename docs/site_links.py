"""Links of the pages: written as GitHub understands them, and turned here into what the site has.

A link to a script in examples/ leads to its page in the gallery, one to another file of the repository to a download,
and one to a folder becomes its text. The first use of a term of the glossary in a page is linked to the glossary, so
that the pages themselves stay free of marks.
"""

import itertools
import os
import re
from pathlib import Path

DOCS = Path(__file__).parent
ROOT = DOCS.parent
#: pages made of files at the root of the repository
ROOT_PAGES = {"CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contribute/contributing.md"}
#: parts of the site that a program writes, and that a build may lack
MADE = ("gallery", "methods", "reference")
#: a fence with all that it holds, code between ticks, and a link or picture: mark, text, target
FENCE = r"^(?P<fence>```+|~~~+|:::+)(?s:.*?)^(?P=fence)[ \t]*$"
CODE = r"``[^`]+``|`[^`\n]+`"
LINK = re.compile(rf"{FENCE}|{CODE}|(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)", re.MULTILINE)
#: a comment, with its line where it has lines of its own
COMMENT = re.compile(r"^<!--(?s:.*?)-->\n|<!--(?s:.*?)-->", re.MULTILINE)
#: what is no prose: fences, headings, tables, indented code, links, roles, code, bold words
NO_PROSE = re.compile(
    rf"{FENCE}|^#.*$|^\|.*$|^ {{4,}}.*$|!?\[(?:[^\[\]]|\[[^\]]*\])*\]\([^)]*\)|\{{\w+\}}`[^`]*`|\*\*[^*]+\*\*|{CODE}",
    re.MULTILINE,
)


def links_in(text):
    """Return the targets of the links and pictures of a page."""
    return [match.group(4) for match in LINK.finditer(text) if match.group(4)]


def with_links(text, folder, *, page=None):
    """Return the text of a page whose links to files are relative to a folder, with links that the site has.

    `page` is the folder of the page in docs/; default: the folder itself.
    """
    page = folder if page is None else page

    def replaced(match):
        _, mark, words, target = match.groups()
        if target is None:
            return match.group()
        path, anchor = target.partition("#")[::2]
        if "://" in target or target.startswith("mailto:") or not path:
            return match.group()
        return _link(mark, words, (folder / path).resolve(), anchor, page)

    return LINK.sub(replaced, text)


def _link(mark, words, file, anchor, page):
    """Return the link of a page to a file of the repository."""
    for name, made in ROOT_PAGES.items():
        if file == ROOT / name:
            file = DOCS / made
    if file == ROOT / "README.md":
        file = DOCS / "index.md"
    if file.parent == ROOT / "examples" and file.suffix == ".py":
        shown = DOCS / "gallery" / f"{file.stem}.rst"
        file = shown if shown.exists() else file
    if file == ROOT / "examples" and (DOCS / "gallery" / "index.rst").exists():
        file = DOCS / "gallery" / "index.rst"
    if file.is_dir() or (file.is_relative_to(DOCS) and not file.exists() and file.relative_to(DOCS).parts[0] in MADE):
        return words
    inside = file.is_relative_to(DOCS)
    if mark or (inside and file.suffix in (".md", ".rst")):
        return f"{mark}[{words}]({_relative(file, page)}{'#' + anchor if anchor else ''})"
    plain = words.replace("`", "")
    return f"{{download}}`{plain} <{_relative(file, page)}>`"


def _relative(file, page):
    """Return the path of a file relative to a folder, with slashes."""
    return Path(os.path.relpath(file, page)).as_posix()


def write_root_pages(docs):
    """Write the pages made of files at the root of the repository, where these are there."""
    for name, made in ROOT_PAGES.items():
        if (ROOT / name).exists():
            target = docs / made
            write_if_new(target, with_links((ROOT / name).read_text(), ROOT, page=target.parent))


def write_if_new(path, text):
    """Write a page unless it has this text already, so that Sphinx reads what changed only."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


def glossary_terms():
    """Return the terms of the glossary, the longest first; a term has a line of its own before what it means."""
    lines = (DOCS / "glossary.md").read_text().splitlines()
    found = [line for line, after in itertools.pairwise(lines) if line[:1].isalpha() and after.startswith("   ")]
    return sorted(found, key=len, reverse=True)


def with_terms(text, terms):
    """Return the text of a page in which the first use of each term, or of its plural, leads to the glossary."""
    if not terms:
        return text
    pattern = re.compile(rf"\b({'|'.join(re.escape(term) for term in terms)})(s?)\b", re.IGNORECASE)
    known, used = {term.lower(): term for term in terms}, set()

    def linked(match):
        term = known[match.group(1).lower()]
        if term in used:
            return match.group()
        used.add(term)
        return f"{{term}}`{match.group()} <{term}>`"

    made, begin = [], 0
    for match in NO_PROSE.finditer(text):
        made += [pattern.sub(linked, text[begin : match.start()]), match.group()]
        begin = match.end()
    return "".join([*made, pattern.sub(linked, text[begin:])])


def with_pages_that_exist(text, folder):
    """Return the text of a page whose tables of contents name only pages that exist: a site without gallery has none.

    A page that no table names is a warning of Sphinx, so that a misspelt entry is found all the same.
    """

    def kept(match):
        head, entries, end = match.groups()
        found = [line for line in entries.splitlines() if not line or line[0] == ":" or _page_exists(line, folder)]
        return "\n".join([head, *found, end])

    return re.sub(r"^(```\{toctree\})\n(.*?)\n(```)$", kept, text, flags=re.MULTILINE | re.DOTALL)


def _page_exists(entry, folder):
    """Return whether the page of an entry of a table of contents exists."""
    name = re.sub(r".*<(.*)>", r"\1", entry)
    return any((folder / f"{name}{suffix}").exists() for suffix in (".md", ".rst"))


def on_source(app, name, source):
    """Give a page of Markdown links that the site has, and links to the glossary."""
    file = Path(app.env.doc2path(name))
    if file.suffix != ".md":
        return
    # sources of numbers, which tools/pages.py reads
    text = COMMENT.sub("", with_pages_that_exist(source[0], file.parent))
    if file.relative_to(DOCS).as_posix() not in ROOT_PAGES.values():
        text = with_links(text, file.parent)
    if name not in ("glossary", "index", "changelog") and not name.startswith("reference/"):
        text = with_terms(text, glossary_terms())
    source[0] = text
