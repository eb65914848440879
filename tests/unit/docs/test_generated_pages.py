"""The pages that a program writes: every public name, key and option has its place."""

import argparse
import inspect
import re
import tomllib
from pathlib import Path

import site_commands
import site_reference
import site_scene
import site_tables

import voxgran as vg
from voxgran._base.config import parameters_of
from voxgran.cli.commands import COMMANDS
from voxgran.clumps.fit import TARGETS
from voxgran.containers.model import container_registry
from voxgran.packing.method import method_registry
from voxgran.scene import keys
from voxgran.scene.description import SECTIONS
from voxgran.shapes.family import families

OF_FAMILY = {item.name: item for item in parameters_of(families().get("solid_union").parameters)}
OF_METHOD = {item.name: item for item in parameters_of(method_registry().get("digital").parameters)}


def section(page, heading):
    """Return the text of a page below a heading, up to the next one of the same level."""
    level = heading.split()[0]
    return page.split(f"\n{heading}\n")[1].split(f"\n{level} ")[0]


def test_a_table_has_no_empty_columns_and_no_bars_in_its_cells():
    made = site_tables.table(("a", "b", "c"), [("1", "", "x|y"), ("2", "", "z\n w")])
    assert made == "| a | c |\n| --- | --- |\n| 1 | x\\|y |\n| 2 | z w |"


def test_every_section_and_key_of_a_scene_is_explained():
    page, scene = site_scene.page(), Path(vg.__file__).parent / "cli/scene.toml"
    for name, entries in tomllib.loads(scene.read_text()).items():
        heading = "## [[shape]]" if name == "shape" else f"## [{name}]"
        for key in entries[0] if isinstance(entries, list) else entries:
            own = (
                families().get("solid_union").parameters
                if name == "shape"
                else method_registry().get("digital").parameters
            )
            elsewhere = key in {item.name for item in parameters_of(own)} or name == "sizes" or key == "kind"
            assert f"| `{key}` |" in (page if elsewhere else section(page, heading)), (name, key)
    for name in SECTIONS:
        assert re.search(rf"^## \[+{name}\]+$", page, re.MULTILINE), name
    for registry in (method_registry(), families()):
        for name in registry.names():
            for item in parameters_of(registry.get(name).parameters):
                assert f"| `{item.name}` |" in section(page, f"### {name}") + page
    assert "| `growth_rate` | a number in [0.0001, 1] | `0.01` |" in section(page, "### jam")


def test_defaults_are_written_as_in_a_scene_file():
    values = (True, 0.002, 3, "xy", ("box", "cone"), (3, 6), None)
    shown = ("`true`", "`0.002`", "`3`", '`"xy"`', '`["box", "cone"]`', "`[3, 6]`", "")
    assert tuple(map(site_scene.toml, values)) == shown
    fields = {item.name: item.default for item in parameters_of(keys.Packed)}
    assert site_scene.toml(fields["method"]) == "required"


def test_every_key_of_a_container_has_its_meaning():
    rows = [row.split(" | ") for row in site_scene.containers().splitlines() if row.startswith("| `")]
    assert ["| `cylinder`", "`height`", "required", "Height, in the unit of lengths. |"] in rows
    assert {row[0].strip("| `") for row in rows} == set(container_registry().names())
    assert all(len(row[3]) > 5 for row in rows)


def test_targets_of_clumps_are_those_of_fit_clump():
    target = next(item for item in parameters_of(keys.ClumpOfShape) if item.name == "target")
    assert target.type_text == "one of " + ", ".join(map(repr, TARGETS))


def test_every_key_of_the_table_is_taken_by_a_scene(tmp_path):
    vg.save_shape(vg.make_shape("box"), tmp_path / "box.stl")
    packing = vg.pack(vg.make_shape("sphere"), vg.Box((9, 9, 9)), "rsa", count=2)
    vg.save(packing, tmp_path / "start.vtp")
    (tmp_path / "list.csv").write_text("diameter\n1.0\n")
    clump = {"max_spheres": 9, "method": "optimal", "target": "iou", "value": 0.5, "seed": 1}
    values = {
        keys.AnyShape: {
            "share": 1.0,
            "density": 7800.0,
            "material": "steel",
            "clump": clump,
            "faces": 20,
            "roughen": {"rms": 0.02},
        },
        keys.ShapeOfFile: {"file": "box.stl", "repair": True, "surface": False, "unit": "mm"},
        keys.ShapeOfFamily: {"family": "solid_union", "seed": 1, "count": 2},
        keys.Standing: {"position": [4, 4, 2], "orientation": [1, 0, 0, 0], "scale": 1.0, "packing": "start.vtp"},
        keys.Packed: {"method": "digital", "count": 2, **dict.fromkeys(keys.DENSITIES), "start": "start.vtp"},
        keys.Shares: {"kind": "fixed", "share_by": "volume"},
        keys.Listed: {"file": "list.csv"},
        keys.Layered: {"count": 2, "height": 2.0, "sizes": {"kind": "fixed"}, "orientations": {"kind": "random"}},
        keys.Oriented: {"kind": "random"},
        keys.Twinned: dict.fromkeys(keys.names_of(keys.Twinned)),
        keys.Settled: {"enabled": True},
        keys.NamedMaterial: {"name": "steel", "pair": {"steel": {"friction": 0.2}}},
        keys.OfContainer: {"material": {"others": "steel"}},
        keys.Measured: {"which": ["density"]},
    }
    assert all(tuple(entry) == keys.names_of(cls) for cls, entry in values.items())
    assert tuple(clump) == keys.names_of(keys.ClumpOfShape)
    standing = dict(values[keys.Standing])
    path = standing.pop("packing")
    common = {"share": 1.0, "clump": clump, "density": 2500.0}
    scene = {
        "shape": [values[keys.ShapeOfFile] | common, values[keys.ShapeOfFamily] | values[keys.AnyShape]],
        "sizes": values[keys.Shares],
        "orientations": values[keys.Oriented],
        "grains": values[keys.Listed],
        "container": {"kind": "box", "lengths": [9, 9, 9]} | values[keys.OfContainer],
        "obstacle": [{"family": "sphere"} | standing, {"packing": path}],
        "packing": values[keys.Packed],
        "material": [values[keys.NamedMaterial]],
        "settle": values[keys.Settled],
        "measure": values[keys.Measured],
    }
    assert vg.Scene.from_mapping(scene, folder=tmp_path).share_by == "volume"
    layer = {"shape": [{"family": "sphere"}], **values[keys.Layered]}
    layers = [{key: value for key, value in layer.items() if key != other} for other in ("count", "height")]
    rest = {"container": scene["container"], "material": scene["material"], "packing": {"method": "gravity"}}
    assert len(vg.Scene.from_mapping({"layer": layers, **rest}).layers) == 2


def test_every_command_and_option_is_listed():
    page, found = site_commands.page(), site_commands.parsers()
    assert set(found) == set(COMMANDS)
    for name, parser in found.items():
        text = section(page, f"## {name}") + section(page, "## Options of every command")
        for action in parser._actions:
            for option in action.option_strings:
                assert (f"`{option}`" in text) == (action.help != argparse.SUPPRESS), (name, option)
    assert "| `--border` | `keep`, `drop` | `keep` | grains that the image cuts |" in section(page, "## labels")
    assert "| `-o`, `--output` |  | required | folder for the files |" in section(page, "## export")
    assert "80%" in section(page, "## study")
    assert "%%" not in page


def test_every_public_name_has_one_page():
    names = [name for group in site_reference.public_names().values() for name in group]
    assert len(names) == len({site_reference.object_of(name) for name in names})
    wanted = {f"voxgran.{name}" for name in vg.__all__ if name != "__version__"}
    wanted -= {f"voxgran.{name}" for name in vg.__all__ if inspect.ismodule(getattr(vg, name))}
    wanted |= {f"voxgran.methods.{name}" for name in vg.methods.__all__}
    wanted |= {f"voxgran.shapes.{name}" for name in vg.shape_families()}
    assert wanted <= set(names)
    assert "voxgran.containers.Box" not in names
    index = site_reference.index()
    assert all(f"(names/{name}.rst)" in index and f"<names/{name}>" in index for name in names)


def test_pages_of_classes_list_members():
    text = site_reference.page_of("voxgran.Packing")
    assert text.startswith("voxgran.Packing\n===============\n")
    assert ".. autoclass:: voxgran.Packing\n   :members:" in text
    assert site_reference.page_of("voxgran.sizes.uniform").endswith(".. autofunction:: voxgran.sizes.uniform\n")


def test_summaries_are_markdown():
    def documented():
        """Return a :class:`~voxgran.Shape` of ``x``
        and y.

        More.
        """

    assert site_reference.summary_of(documented).split() == ["Return", "a", "`voxgran.Shape`", "of", "`x`", "and", "y."]


def test_pages_are_written_when_they_change_and_old_ones_go(tmp_path, monkeypatch):
    monkeypatch.setattr(site_reference, "public_names", lambda: {"Packing": ["voxgran.pack"]})
    (tmp_path / "names").mkdir()
    (tmp_path / "names" / "voxgran.old.rst").touch()
    site_reference.write_pages(tmp_path)
    written = {path.relative_to(tmp_path).as_posix(): path.stat().st_mtime_ns for path in tmp_path.rglob("*.*")}
    assert set(written) == {"index.md", "scene.md", "commands.md", "names/voxgran.pack.rst"}
    site_reference.write_pages(tmp_path)
    assert all((tmp_path / name).stat().st_mtime_ns == time for name, time in written.items())
