"""The page of the scene file, made of the tables by which scenes are checked."""

import dataclasses
import inspect
import re
from pathlib import Path

from site_tables import code, table

import voxgran
from voxgran._base.config import parameters_of
from voxgran.clumps.method import clump_registry
from voxgran.containers.model import container_registry
from voxgran.geometry.orientations import KINDS as TURNS
from voxgran.packing.beds.inlet import Inlet
from voxgran.packing.method import method_registry
from voxgran.scene import keys
from voxgran.scene.sections import General, Output
from voxgran.settling.material import Material
from voxgran.settling.parameters import Compression, Lid, Settling, Shaking
from voxgran.shapes.family import families
from voxgran.shapes.roughness.parameters import Roughness
from voxgran.shapes.sizes import KINDS as LAWS

#: what `voxgran init` writes
FIRST = Path(voxgran.__file__).parent / "cli/scene.toml"

#: sections with the classes of their keys, in the order of a scene file, and what is said of them
SECTIONS = {
    "[scene]": ((General,), "What holds for the whole scene. The section may be left out."),
    "[[shape]]": (
        (keys.AnyShape, keys.ShapeOfFile, keys.ShapeOfFamily),
        "Grains, with `file` or `family`. The parameters of the family are keys of the same section.",
    ),
    "[[obstacle]]": (
        (keys.Standing,),
        "What stands in the container and never moves: a shape, with the keys of a [[shape]] too, or a packing.",
    ),
    "clump = { ... } of a [[shape]]": (
        (keys.ClumpOfShape,),
        "A clump of spheres in place of the shape. The parameters of the method are keys of the same table.",
    ),
    "roughen = { ... } of a [[shape]]": ((Roughness,), "A rough surface; a `seed` may be given, too."),
    "[[layer]]": (
        (keys.Layered,),
        "Layers, the lowest first, in place of [[shape]] and `count`; each has its own [[layer.shape]] entries.",
    ),
    "[grains]": (
        (keys.Listed,),
        "A list of grains, each placed once, in place of `count` and [sizes]. Without the section grains are drawn.",
    ),
    "[packing]": ((keys.Packed,), "How the grains are packed. Parameters of the method are keys of the same section."),
    "inlet = { ... } of [packing]": (
        (Inlet,),
        "Disk or rectangle below which grains fall, of the methods gravity and deposition.",
    ),
    "[settle]": (
        (keys.Settled, Settling),
        "How grains come to rest after they are packed. Without the section, it is up to the method.",
    ),
    "shaking = { ... } of [settle]": ((Shaking,), "Shaking before the grains come to rest."),
    "lid = { ... } of [settle]": ((Lid,), "A plate that lies on the bed."),
    "[compress]": (
        (Compression,),
        "How grains are compressed, without gravity, after they are packed. Without the section they are not.",
    ),
    "[twin]": (
        (keys.Twinned,),
        "A twin of a sample, in place of [[shape]] and [packing]; also parameters of the method of its protocol.",
    ),
    "[material]": ((Material,), "The contact law in the input of engines. The section may be left out."),
    "[[material]]": (
        (keys.NamedMaterial,),
        "Materials by name, each with the keys of [material] too; [[shape]] and [container] name theirs.",
    ),
    "material of [container]": ((keys.OfContainer,), "The material of the walls, where there are several."),
    "[measure]": ((keys.Measured,), "What is measured. The section may be left out."),
    "[output]": ((Output,), "What is written. The section may be left out."),
}
HEAD = """# Scene files

A scene file says in TOML which grains are packed into what. `voxgran init scene.toml` writes one to start from,
`voxgran plan scene.toml` checks it, and `voxgran run scene.toml -o out` packs it. Lengths are in the unit of `[scene]`.
An unknown key is an error that gives the nearest name. Each `[[shape]]` is one kind of grain; a pair of numbers for
a number of its family is a range from which each shape draws a value of its own.

```toml
{scene}```
"""


def toml(value):
    """Return a default as it stands in a scene file."""
    if value is dataclasses.MISSING:
        return "required"
    if value is None:
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, list | tuple):
        return f"`[{', '.join(toml(item).strip('`') for item in value)}]`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def keys_of(*classes):
    """Return the table of the keys that parameter classes describe."""
    items = [item for cls in classes for item in parameters_of(cls)]
    rows = [(code(item.name), item.type_text, item.unit, toml(item.default), item.doc) for item in items]
    return table(("key", "type and range", "unit", "default", "meaning"), rows)


def containers():
    """Return the section of the containers."""
    rows = []
    for kind in map(container_registry().get, container_registry().names()):
        told = re.findall(
            r"^(\w+) : .*\n((?:    .*\n)+)", inspect.getdoc(kind.make or kind.container) + "\n", re.MULTILINE
        )
        meanings = {key: " ".join(text.split()) for key, text in told}
        rows += [(code(kind.name), code(key), "required" * need, meanings[key]) for key, need in kind.keys.items()]
    parts = ["## [container]", "", "What holds the grains: its `kind` and the keys of that kind.", ""]
    return "\n".join([*parts, table(("kind", "key", "default", "meaning"), rows)])


def sizes():
    """Return the section of the sizes."""
    parts = [
        "## [sizes]",
        "",
        "Equivalent diameters of the grains. Without the section each shape keeps its own size.",
        "",
    ]
    parts += [keys_of(keys.Shares), ""]
    for kind, law in LAWS.items():
        parts += [f"### Sizes of the kind {kind}", "", keys_of(law), ""]
    return "\n".join(parts)


def orientations():
    """Return the section of the orientations."""
    parts = ["## [orientations]", "", "Orientations of the grains. Without the section all are equally likely.", ""]
    parts += [keys_of(keys.Oriented), ""]
    for kind, law in TURNS.items():
        parts += [f"### Orientations of the kind {kind}", "", keys_of(law), ""]
    return "\n".join(parts)


def own_parameters():
    """Return the sections of the parameters of families, methods and clump methods."""
    parts = []
    for heading, registry in (
        ("Parameters of the packing methods", method_registry()),
        ("Parameters of the families of shapes", families()),
        ("Parameters of the clump methods", clump_registry()),
    ):
        parts += [f"## {heading}", ""]
        for name in registry.names():
            cls = registry.get(name).parameters
            parts += [f"### {name}", "", keys_of(cls) if parameters_of(cls) else "No parameters.", ""]
    return "\n".join(parts)


def page():
    """Return the page of the scene file, in Markdown."""
    parts = [HEAD.format(scene=FIRST.read_text(encoding="utf-8"))]
    for heading, (classes, text) in SECTIONS.items():
        parts += [f"## {heading}", "", text, "", keys_of(*classes), ""]
        if heading.startswith("roughen"):
            parts += [sizes(), orientations(), containers(), ""]
    return "\n".join([*parts, own_parameters()])
