"""Files beside the package: what is checked, drawn and stated twice agrees with its source."""

import re
import runpy
import tomllib
from functools import cache
from pathlib import Path

import pytest

import voxgran

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
HOUSE = runpy.run_path(str(ROOT / "tools" / "house.py"))
#: all files are parsed once
ROOMS = cache(HOUSE["imports"])
FORMS = ("crash", "wish", "wrong_number")


def read_yaml(name):
    """Return what a YAML file of the project holds."""
    return pytest.importorskip("yaml").safe_load((ROOT / name).read_text())


def recipe(target):
    """Return the commands of a target of the Makefile."""
    text = (ROOT / "Makefile").read_text()
    lines = re.search(rf"^{target}:[^\n]*\n((?:\t[^\n]*\n)+)", text, flags=re.MULTILINE)[1].splitlines()
    return [line.strip().replace("$(BIN)", ".venv/bin") for line in lines]


def test_hooks_of_pre_commit_are_the_checks_of_make_lint():
    text = (ROOT / ".pre-commit-config.yaml").read_text()
    assert re.findall(r"^ *entry: (.*)$", text, flags=re.MULTILINE) == recipe("lint")
    # by the tools of the environment, on all files: no versions of their own
    assert re.findall(r"repo: (.*)", text) == ["local"]
    assert (
        text.count("language: system")
        == text.count("pass_filenames: false")
        == text.count("entry: ")
        == len(recipe("lint"))
    )


def test_the_workflow_runs_what_must_pass_on_the_versions_that_are_declared():
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    stated = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    assert re.findall(r'"(3\.\d+)"', text) == stated
    assert re.search(r"^ *- run: \.ci/run$", text, flags=re.MULTILINE)
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111
    needed = re.findall(r'^    "lib.*": "(.*)",$', (ROOT / "tools" / "bootstrap.sh").read_text(), flags=re.MULTILINE)
    assert needed
    assert [package for package in needed if f" {package}" not in text] == []
    assert read_yaml(".github/workflows/ci.yml")["permissions"] == {"contents": "read"}


@pytest.mark.parametrize("name", FORMS)
def test_forms_for_issues_ask_for_the_doctor(name):
    form = read_yaml(f".github/ISSUE_TEMPLATE/{name}.yml")
    assert {"name", "description", "body"} <= form.keys()
    ids = [field["id"] for field in form["body"]]
    assert len(set(ids)) == len(ids)
    assert ids[-1] == "doctor"
    for field in form["body"]:
        assert field["type"] == "textarea"
        assert {"label", "description"} <= field["attributes"].keys()
    assert "`voxgran doctor`" in form["body"][-1]["attributes"]["label"]
    assert form["body"][-1]["validations"]["required"] is (name != "wish")


def test_the_citation_names_this_version_and_its_licence():
    text = (ROOT / "CITATION.cff").read_text()
    plain = dict(re.findall(r"^([a-z-]+): *(\S.*)$", text, flags=re.MULTILINE))
    assert {"cff-version", "message", "title", "type", "version", "license", "abstract"} <= plain.keys()
    assert plain["version"] == voxgran.__version__
    assert plain["license"] == PROJECT["license"]
    assert "name: " + PROJECT["authors"][0]["name"] in text
    full = read_yaml("CITATION.cff")
    assert full["type"] == "software"
    assert full["authors"]
    assert full["keywords"]


def test_the_figure_of_the_house_is_that_of_the_imports():
    assert HOUSE["drawing"](ROOMS()) == (ROOT / "docs/figures/house.svg").read_text(), "run tools/house.py"


def test_arrows_that_follow_from_others_are_left_out():
    graph = {"a": set(), "b": {"a"}, "c": {"a", "b"}, "d": {"a", "c"}}
    assert HOUSE["reduced"](graph) == {"a": set(), "b": {"a"}, "c": {"b"}, "d": {"c"}}
    assert HOUSE["layers"](graph) == [["a"], ["b"], ["c"], ["d"]]
    with pytest.raises(ValueError, match="rooms import each other: a, b"):
        HOUSE["layers"]({"a": {"b"}, "b": {"a"}})


def test_every_room_has_its_question():
    assert HOUSE["questions"]().keys() == ROOMS().keys()


def test_the_files_that_the_plan_of_the_house_names_exist():
    rows = re.findall(r"^\| `(\w+)/`[^|]*\|[^|]*\|(.*)\|$", HOUSE["PLAN"].read_text(), flags=re.MULTILINE)
    for room, names in (row for row in rows if row[0] in ROOMS()):
        there = {path.stem for path in (ROOT / "voxgran" / room).rglob("*")}
        # a key, a function, and folders elsewhere
        others = {"kind", "measure", "report", "benchmarks"}
        assert set(re.findall(r"`([a-z_]+)/?`", names)) - there <= others, room


PAGES = ["CONTRIBUTING.md", "SECURITY.md", "docs/contribute/extending.md", "examples/plugin/about.md"]


@pytest.mark.parametrize("name", PAGES)
def test_files_and_targets_that_a_page_names_exist(name):
    text, here = (ROOT / name).read_text(), (ROOT / name).parent
    for link in re.findall(r"\]\(([^)#:]+)\)", text):
        assert (here / link).exists(), link
    paths = re.findall(r"`((?:voxgran|tests|examples|tools|docs)/[\w./]+)`", text)
    # capitals stand for a name
    assert [path for path in paths if not re.search("NAME|KIND", path) and not (ROOT / path).exists()] == []
    targets = re.findall(r"`make ([\w-]+)`", text)
    assert [target for target in targets if not recipe(target)] == []
