"""The pages of the reference: every public name, the scene file, and the command line."""

import importlib
import inspect
import re

import site_commands
import site_scene
from site_links import write_if_new
from site_tables import table

#: names of modules whose names are public, as they are called, with the headings of their tables
NAMESPACES = {
    "voxgran.shapes": "Functions that make shapes, by family",
    "voxgran.families": "Parameters of the families of shapes",
    "voxgran.sizes": "Distributions of sizes",
    "voxgran.orientations": "Distributions of orientations",
    "voxgran.clumps": "Methods and results of clumps",
    "voxgran.containers": "Containers",
    "voxgran.methods": "Parameters of the packing methods",
    "voxgran.testing": "Tests for those who add methods",
}
#: headings of the tables of the names of voxgran, by the rooms or folders that the names live in
ROOMS = {
    "shapes": "Shapes",
    "containers": "Containers",
    "packing": "Packing",
    "settling": "Settling",
    "contacts": "Verification",
    "measures": "Measures",
    "clumps": "Clumps",
    "voxels": "Voxels of shapes",
    "lattice": "Voxel images",
    "points": "Point clouds",
    "deformation": "Deformed grains",
    "io": "Files",
    "decks": "Engines",
    "report": "Reports and pictures",
    "scene": "Scenes",
    "study": "Studies",
    "_base": "Errors",
}
HEAD = """# Reference

Every public name, with its signature, the types and units of its parameters, and the errors that it raises. In scripts
`import voxgran as vg` is usual: `vg.pack` is `voxgran.pack`.

| page | what it lists |
|---|---|
| [Scene files](scene.md) | sections and keys of a scene, with types, units and defaults |
| [Command line](commands.md) | the commands of the prompt and their options |

```{toctree}
:hidden:

scene
commands
```
"""


def object_of(name):
    """Return the object behind a public name such as ``voxgran.sizes.uniform``."""
    module, parts = importlib.import_module("voxgran"), name.split(".")[1:]
    if parts[0] == "testing":
        module, parts = importlib.import_module("voxgran.testing"), parts[1:]
    for part in parts:
        module = getattr(module, part)
    return module


def public_names():
    """Return the public names by heading; a name that is the same object as another one is listed once."""
    package = importlib.import_module("voxgran")
    groups = {heading: [] for heading in ROOMS.values()}
    for name in package.__all__:
        found = getattr(package, name)
        if not inspect.ismodule(found) and not name.startswith("__"):
            room, *_, folder = found.__module__.split(".")[1:-1] * 2
            groups[ROOMS.get(folder, ROOMS[room])].append(f"voxgran.{name}")
    seen = {object_of(name) for names in groups.values() for name in names}
    for namespace, heading in NAMESPACES.items():
        module = object_of(namespace)
        names = getattr(module, "__all__", dir(module))
        new = [f"{namespace}.{name}" for name in names if getattr(module, name) not in seen]
        seen |= {object_of(name) for name in new}
        groups.setdefault(heading, []).extend(new)
    return {heading: names for heading, names in groups.items() if names}


def summary_of(found):
    """Return the summary of a docstring, as Markdown."""
    text = (inspect.getdoc(found) or "").split("\n\n")[0].replace("``", "`")
    return re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text)


def page_of(name):
    """Return the page of a public name, in reStructuredText."""
    module = name.rpartition(".")[0]
    directive = "autoclass" if inspect.isclass(object_of(name)) else "autofunction"
    members = "   :members:\n   :inherited-members: Exception, tuple\n" if directive == "autoclass" else ""
    lines = [name, "=" * len(name), "", f".. currentmodule:: {module}", "", f".. {directive}:: {name}"]
    return "\n".join(lines) + f"\n{members}"


def index():
    """Return the first page of the reference."""
    parts = [HEAD]
    for heading, names in public_names().items():
        short = {name: name.removeprefix("voxgran.") for name in names}
        rows = [(f"[`{short[name]}`](names/{name}.rst)", summary_of(object_of(name))) for name in names]
        entries = "\n".join(f"{short[name]} <names/{name}>" for name in names)
        tree = f"```{{toctree}}\n:hidden:\n:caption: {heading}\n\n{entries}\n```"
        parts += [f"## {heading}", "", table(("name", "what it is"), rows), "", tree, ""]
    return "\n".join(parts)


def write_pages(folder):
    """Write all pages of the reference into a folder."""
    names = [name for group in public_names().values() for name in group]
    pages = {f"names/{name}.rst": page_of(name) for name in names}
    pages |= {"index.md": index(), "scene.md": site_scene.page(), "commands.md": site_commands.page()}
    for name, text in pages.items():
        write_if_new(folder / name, text)
    for old in (folder / "names").glob("*.rst"):
        if f"names/{old.name}" not in pages:
            old.unlink()
