"""The plan of the house (docs/contribute/design.md), held: who imports whom and when, what is documented.

The rules read the source as a syntax tree and return the breaches that they find. Each rule is
tried on samples that break it, then on every file of the package.
"""

import ast
import inspect
import json
import re
import subprocess
import sys
import time
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "voxgran"
FILES = sorted(PACKAGE.rglob("*.py"))
NAMES = [path.relative_to(PACKAGE).as_posix() for path in FILES]

ARROWS = {
    "_base": set(),
    "geometry": {"_base"},
    "lattice": {"_base", "geometry"},
    "shapes": {"_base", "geometry", "lattice"},
    "voxels": {"_base", "geometry", "lattice", "shapes"},
    "points": {"_base", "geometry", "lattice", "shapes"},
    "containers": {"_base", "geometry", "lattice", "shapes"},
    "clumps": {"_base", "geometry", "lattice", "shapes", "voxels", "points"},
}
ARROWS["contacts"] = ARROWS["clumps"] | {"containers", "clumps"}
ARROWS["settling"] = ARROWS["contacts"] | {"contacts"}
ARROWS["packing"] = ARROWS["settling"] | {"settling"}
ARROWS["measures"] = ARROWS["packing"] | {"packing"}
ARROWS["io"] = ARROWS["measures"] | {"measures"}
ARROWS["decks"] = ARROWS["io"] | {"io"}
ARROWS["report"] = ARROWS["decks"] | {"decks"}
ARROWS["scene"] = ARROWS["report"] | {"report"}
ARROWS["study"] = ARROWS["testing"] = ARROWS["app"] = ARROWS["scene"] | {"scene"}
#: imports between the sub-rooms of packing/, each with its reason; all of them may import the files at the top of it
LATERAL = {
    # how deep a bed will be is said before any method begins
    "": {"beds"},
    # both methods feed, vibrate and settle grains by the same rules
    "digital": {"walking"},
    "control_point": {"walking"},
    # spheres of a front may grow at the end
    "advancing_front": {"transform"},
    # how dense grains become, and so how many fill a specimen
    "deposition": {"beds"},
    "jamming": {"beds"},
}
#: classes of containers: other rooms ask for their boundary, so that a new container is one file
CONTAINERS = {"Box", "ClosedMesh", "Cylinder", "Disk", "Polygon", "Rectangle", "Sphere"}
#: arguments of kernels that may be None, though each type is compiled anew: one of callers that always give the same,
#: and true shapes, without which compilation for spheres takes a quarter of the time
OPTIONAL = {
    "geometry/gjk.py": {"closely"},
    "packing/rsa/available_cells.py": {"shapes"},
    "packing/rsa/candidates.py": {"shapes"},
}
#: the files outside of all rooms: they may import every room
OPEN = {"__init__", "__main__", "cli"}

HEAVY = {
    "jinja2",
    "manifold3d",
    "matplotlib",
    "meshio",
    "netCDF4",
    "numba",
    "open3d",
    "pandas",
    "plotly",
    "pyvista",
    "rich",
    "scipy",
    "vtk",
    "vtkmodules",
    "xarray",
}
RANDOM = {"seed", "RandomState", "default_rng"}
#: PyVista imports this file, after itself, by its entry point; voxgran never does
PLUGIN = "io/pyvista_accessor.py"
#: what subclasses numba, loaded by `lazy.load` when the first kernel is compiled
COMPILER = {f"_base/compiling/{name}.py" for name in ("kernel_files", "linking", "lowering")}
#: pickles of our own: compiled kernels in the cache of the user, and requests between the processes of a test
PICKLES = {"_base/compiling/kernel_files.py", "testing/kill.py", "testing/packing_methods.py"}
#: modules that run, or restore, what a file holds
RUNNING = {"cloudpickle", "code", "dill", "joblib", "jsonpickle", "marshal", "pickle", "runpy", "shelve", "yaml"}
UNPACKING = {"extract", "extractall", "unpack_archive"}
#: the nouns whose methods may call public functions of rooms above their own, by `_base.public`
NOUNS = {"packing/model.py", "shapes/model.py"}
LONGEST_FUNCTION = 60  # lines, without the docstring
LONGEST_FILE = 450
#: entries of a folder, files and folders together, beside its __init__.py
FULLEST = 25
#: most arguments of a function
MOST_ARGUMENTS = 10

Function = ast.FunctionDef | ast.AsyncFunctionDef
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def room_of(name):
    """Return the room that a file belongs to, by its path in the package."""
    return name.split("/")[0].removesuffix(".py")


def nodes_of(tree: ast.AST) -> list[ast.AST]:
    """Return all nodes of a tree that have parts (operators have none), which are listed once."""
    if not hasattr(tree, "nodes"):
        nodes = [tree]
        for node in nodes:
            for name in node._fields:
                part = getattr(node, name, None)
                parts = part if isinstance(part, list) else (part,)
                nodes += [one for one in parts if isinstance(one, ast.AST) and one._fields]
        tree.nodes = nodes
    return tree.nodes


def dotted(node: ast.AST) -> str:
    """Return a name with its attributes, as it is written; nothing for what else the attributes are taken of."""
    return f"{dotted(node.value)}.{node.attr}" if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def imported(tree: ast.AST, package: str) -> list[tuple[int, str]]:
    """Return line and name of what is imported, by statement or as the text of a lazy import, which are listed once."""
    known = tree.__dict__.setdefault("imported", {})
    if package not in known:
        known[package] = [*_imported(tree, package)]
    return known[package]


def _imported(tree: ast.AST, package: str) -> Iterator[tuple[int, str]]:
    """Yield what :func:`imported` returns."""
    documents = {id(node.value) for node in nodes_of(tree) if isinstance(node, ast.Expr)}
    for node in nodes_of(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: len(package.split(".")) - node.level + 1]
            base = ".".join([*(parents if node.level else []), *([node.module] if node.module else [])])
            yield from ((node.lineno, f"{base}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.Constant) and id(node) not in documents:
            words = node.value.split(".") if isinstance(node.value, str) else []
            if words[:1] == ["voxgran"] and words[1:2] and words[1] in {*ARROWS, *OPEN}:
                yield node.lineno, node.value


def wrong_arrows(tree, name):
    """Find imports of a room that this one may not know."""
    room = room_of(name)
    if room in OPEN:
        return []
    if room not in ARROWS:
        return [f"room {room!r} is not in the plan"]
    package = ".".join(["voxgran", *name.split("/")[:-1]])
    found = []
    for line, target in imported(tree, package):
        parts = target.split(".")
        if parts[0] != "voxgran" or target == "voxgran.__version__":
            continue
        other = parts[1] if len(parts) > 1 else "__init__"
        if other not in ARROWS:
            found.append(f"line {line}: {room} imports {target}: import from the room itself")
        elif other != room and other not in ARROWS[room]:
            found.append(f"line {line}: {room} may not import {other}")
    return found


def is_type_checking(node):
    """Return whether a statement is ``if TYPE_CHECKING:``."""
    return isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")


def run_at_import(nodes: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Yield the statements that run when the file is imported."""
    for node in nodes:
        if isinstance(node, FUNCTIONS):
            continue
        yield node
        for part in ("body", "orelse", "finalbody"):
            if part != "body" or not is_type_checking(node):
                yield from run_at_import(getattr(node, part, []))
        for handler in getattr(node, "handlers", []):
            yield from run_at_import(handler.body)


def heavy_imports(tree, name):
    """Find heavy libraries that are loaded when the file is imported."""
    found = []
    if name == PLUGIN or name in COMPILER:
        return found
    for node in run_at_import(tree.body):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [node.module or ""]
        found += [f"line {node.lineno}: {n}" for n in names if n.split(".")[0] in HEAVY]
    return found


def public(tree: ast.Module) -> Iterator[tuple[str, Function | ast.ClassDef]]:
    """Yield the qualified name and node of all public classes, functions and methods."""

    def walk(nodes, prefix):
        for node in nodes:
            if isinstance(node, (*FUNCTIONS, ast.ClassDef)) and not node.name.startswith("_"):
                yield prefix + node.name, node
                if isinstance(node, ast.ClassDef):
                    yield from walk(node.body, f"{prefix}{node.name}.")

    yield from walk(tree.body, "")


def is_private(name):
    """Return whether a file's own name begins with an underscore."""
    stem = name.split("/")[-1].removesuffix(".py")
    return stem.startswith("_") and stem != "__init__"


def documented_errors(docstring):
    """Return the class names in the Raises section of a docstring."""
    lines = inspect.cleandoc(docstring or "").splitlines()
    names = set()
    for number, line in enumerate(lines[:-1]):
        if line == "Raises" and set(lines[number + 1]) == {"-"}:
            for index, entry in enumerate(lines[number + 2 :], number + 2):
                if index + 1 < len(lines) and lines[index + 1] and set(lines[index + 1]) == {"-"}:
                    break
                if entry and not entry.startswith(" "):
                    names |= set(re.findall(r"\w+", entry))
    return names


CONSTRUCTORS = {"__init__", "__new__", "__post_init__"}


def callables(tree: ast.Module) -> Iterator[tuple[str, Function, str]]:
    """Yield name, node and docstring of public functions; a class documents its constructor."""
    for title, node in public(tree):
        document = ast.get_docstring(node) or ""
        if isinstance(node, FUNCTIONS):
            yield title, node, document
            continue
        for inner in node.body:
            if isinstance(inner, FUNCTIONS) and inner.name in CONSTRUCTORS:
                yield title, inner, document


def undocumented_errors(tree, name):
    """Find errors that a public function raises itself and does not name under Raises."""
    found = []
    for title, node, document in callables(tree) if not is_private(name) else ():
        known = documented_errors(document)
        for inner in ast.walk(node):
            if not isinstance(inner, ast.Raise) or inner.exc is None:
                continue
            called = isinstance(inner.exc, ast.Call)
            error = ast.unparse(inner.exc.func if called else inner.exc).split(".")[-1]
            where = f"{title}, line {inner.lineno}"
            if called and not error[0].isupper():
                found.append(f"{where}: raise a class by its name, not {error}()")
            elif error[0].isupper() and error not in known:
                found.append(f"{where}: {error} is missing under Raises")
    return found


def overloads(node):
    """Return whether a function only declares types, or belongs to a property with a getter."""
    marks = [ast.unparse(mark) for mark in getattr(node, "decorator_list", [])]
    return any(mark.split(".")[-1] in {"overload", "setter", "deleter"} for mark in marks)


def undocumented(tree, name):
    """Find public names without docstring or with an argument or result without type."""
    found = [] if ast.get_docstring(tree) else ["the file has no docstring"]
    for title, node in public(tree) if not is_private(name) else ():
        if not ast.get_docstring(node) and not overloads(node):
            found.append(f"{title} has no docstring")
        if isinstance(node, FUNCTIONS):
            given = node.args
            every = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
            every = [a for a in every if a is not None]
            if "." in title and "staticmethod" not in map(ast.unparse, node.decorator_list):
                every = every[1:]
            found += [f"{title}: {a.arg} has no type" for a in every if a.annotation is None]
            if node.returns is None:
                found.append(f"{title} has no return type")
    return found


def too_long(tree, name):
    """Find functions that do not fit on a screen; their docstrings are not counted."""
    found = []
    for node in nodes_of(tree):
        if isinstance(node, FUNCTIONS):
            document = node.body[0] if ast.get_docstring(node) else None
            lines = node.end_lineno - node.lineno + 1
            lines -= document.end_lineno - document.lineno + 1 if document else 0
            if lines > LONGEST_FUNCTION:
                found.append(f"{node.name} has {lines} lines, at most {LONGEST_FUNCTION} are allowed")
    return found


@cache
def exported():
    """Return the public names of the package, each with its module."""
    return {target for _, target in imported(ast.parse((PACKAGE / "__init__.pyi").read_text()), "voxgran")}


def too_many_arguments(tree, name):
    """Find functions with too many arguments; keyword-only ones of public functions and classes are not counted."""
    found = []
    module = ".".join(["voxgran", *name.removesuffix(".py").split("/")])
    # the types of some calls are written in a stub of their own
    places = (module, "voxgran.typed_calls")
    public = [node for node in tree.body if any(f"{at}.{getattr(node, 'name', '')}" in exported() for at in places)]
    public += [method for node in public if isinstance(node, ast.ClassDef) for method in node.body]
    for node in nodes_of(tree):
        if isinstance(node, FUNCTIONS):
            given = [*node.args.posonlyargs, *node.args.args]
            given += [] if node in public else node.args.kwonlyargs
            if len(given) > MOST_ARGUMENTS:
                found.append(f"{node.name} has {len(given)} arguments, at most {MOST_ARGUMENTS} are allowed")
    return found


def optional_arguments_of_kernels(tree, name):
    """Find kernels that compare anything but the listed arguments with None."""
    kernels = (
        node
        for node in nodes_of(tree)
        if isinstance(node, ast.FunctionDef) and any("kernel" in dotted(mark) for mark in node.decorator_list)
    )
    return [
        f"{kernel.name}: {ast.unparse(node)} in a kernel; numbers or empty arrays need no second compilation"
        for kernel in kernels
        for node in ast.walk(kernel)
        if isinstance(node, ast.Compare)
        and isinstance(node.ops[0], ast.Is | ast.IsNot)
        and ast.unparse(node.left) not in OPTIONAL.get(name, set())
    ]


def forbidden_calls(tree, name):
    """Find prints and exits outside of the command line, and random numbers not from seeds."""
    found = []
    for node in nodes_of(tree):
        text = ""
        if isinstance(node, ast.Call):
            text = dotted(node.func)
        elif isinstance(node, ast.ImportFrom) and node.module in {"numpy.random", "random"}:
            text = " ".join(f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            text = " ".join(a.name for a in node.names if a.name == "random")
        if not text:
            continue
        if text == "print" and room_of(name) != "cli":
            found.append(f"line {node.lineno}: print")
        if text in {"sys.exit", "exit", "quit", "os._exit"} and name not in {"__main__.py", "cli/ending.py"}:
            found.append(f"line {node.lineno}: {text}")
        drawn = "random" in text and any(
            re.search(rf"\brandom\.{maker}$", word) for word in text.split() for maker in RANDOM
        )
        # Open3D's sampler draws from a generator of its own, which one adapter seeds
        adapter = name == "points/backend_open3d.py" and text == "open3d.utility.random.seed"
        if (drawn or re.match(r"random\b", text)) and name != "_base/seeds.py" and not adapter:
            found.append(f"line {node.lineno}: {text}")
    return found


def dangers(tree, name):
    """Find what could execute a file, or write what an archive names."""
    found = []
    for node in nodes_of(tree):
        modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        modules += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.Call):
            called = dotted(node.func)
            last = called.split(".")[-1]
            first = node.args[:1] if last in {"load", "load_extra", "import_module"} else []
            modules += [one.value for one in first if isinstance(one, ast.Constant)]
            words = {word.arg: word.value for word in node.keywords}
            if called in {"eval", "exec", "compile", "os.system", "os.popen"} or last in UNPACKING:
                found.append(f"line {node.lineno}: {called}")
            if called in {"np.load", "numpy.load"} and ast.unparse(words.get("allow_pickle", node)) != "False":
                found.append(f"line {node.lineno}: {called} without allow_pickle=False")
            if "shell" in words and ast.unparse(words["shell"]) != "False":
                found.append(f"line {node.lineno}: {called} by a shell")
            if last == "Environment" and ast.unparse(words.get("autoescape", node)) != "True":
                found.append(f"line {node.lineno}: {called} without autoescape=True")
        roots = {str(module).split(".")[0] for module in modules} & RUNNING
        if roots and name not in PICKLES:
            found.append(f"line {node.lineno}: imports {', '.join(sorted(roots))}")
    return found


def wrong_neighbours(tree, name):
    """Find imports from one sub-room of packing/ to another, or to it from the files at its top."""
    parts = name.split("/")
    if parts[0] != "packing":
        return []
    room = parts[1] if len(parts) > 2 else ""
    found = []
    for line, target in imported(tree, ".".join(["voxgran", *parts[:-1]])):
        words = target.split(".")
        other = words[2] if words[:2] == ["voxgran", "packing"] and len(words) > 2 else room
        inside = other in ROOMS_OF_PACKING and other != room
        if inside and other not in LATERAL.get(room, set()):
            found.append(f"line {line}: packing/{room} may not import {other}")
    return found


def container_classes(tree, name):
    """Find decisions by the class or the kind of a container outside of containers/."""
    found = []
    for node in nodes_of(tree) if room_of(name) != "containers" else ():
        classes = []
        if isinstance(node, ast.Call) and dotted(node.func) in {"isinstance", "issubclass"}:
            classes = [part for argument in node.args[1:] for part in ast.walk(argument)]
        elif isinstance(node, ast.MatchClass):
            classes = [node.cls]
        elif isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            kinds = [dotted(side).split(".")[-2:] for side in sides if isinstance(side, ast.Attribute)]
            if ["container", "kind"] in kinds:
                found.append(f"line {node.lineno}: compares the kind of a container")
            if any(isinstance(side, ast.Call) and dotted(side.func) == "type" for side in sides):
                classes = [part for side in sides for part in ast.walk(side)]
        named = {dotted(part).split(".")[-1] for part in classes if isinstance(part, ast.Name | ast.Attribute)}
        found += [f"line {node.lineno}: asks for class {one}; ask for its boundary" for one in named & CONTAINERS]
    return found


def targets_of(tree: ast.AST, module: str, modules: Collection[str]) -> set[str]:
    """Return which of some modules one imports, or a name from it; late imports and those for types count too."""
    is_package = any(other.startswith(f"{module}.") for other in modules)
    targets = {target for _, target in imported(tree, module if is_package else module.rpartition(".")[0])}
    targets |= {target.rpartition(".")[0] for target in targets if target not in modules}
    return targets.intersection(modules) - {module, "voxgran"}


def circles(knows: dict[str, set[str]]) -> set[frozenset[str]]:
    """Find circles of modules, given which others each imports."""
    reached: dict[str, set[str]] = {}
    for module in knows:
        found, ahead = set(), [module]
        while ahead:
            new = knows[ahead.pop()] - found
            found |= new
            ahead += new
        reached[module] = found
    return {
        frozenset(other for other in reached[module] if module in reached[other])
        for module in reached
        if module in reached[module]
    }


def full_folders(names: list[str]) -> list[str]:
    """Find folders with more entries, files and folders together, than they may have."""
    entries: dict[str, set[str]] = {}
    for name in names:
        parts = name.split("/")
        for depth in range(len(parts)):
            entries.setdefault("/".join(parts[:depth]), set()).add(parts[depth])
    return [
        f"{folder or 'voxgran'}/ has {len(inside)} entries"
        for folder, inside in entries.items()
        if len(inside - {"__init__.py"}) > FULLEST
    ]


def upward_calls(tree, name):
    """Find what reaches the rooms above by the public names, elsewhere than in a method of a noun."""
    found = []
    if room_of(name) in OPEN or name == "_base/__init__.py":
        return found
    methods = {
        id(inner)
        for node in tree.body
        if name in NOUNS and isinstance(node, ast.ClassDef)
        for method in node.body
        if isinstance(method, FUNCTIONS)
        for inner in ast.walk(method)
    }
    for node in nodes_of(tree):
        if isinstance(node, ast.Call) and id(node) not in methods:
            text = dotted(node.func).split(".")[-1]
            named = [arg.value for arg in node.args if isinstance(arg, ast.Constant)]
            if text == "public" or (text in {"load", "import_module", "__import__"} and "voxgran" in named):
                found.append(f"line {node.lineno}: {ast.unparse(node)}: only methods of {sorted(NOUNS)} may")
    return found


ROOMS_OF_PACKING = {name.split("/")[1] for name in NAMES if name.startswith("packing/") and name.count("/") > 1}
RULES = [
    upward_calls,
    wrong_arrows,
    heavy_imports,
    undocumented_errors,
    undocumented,
    too_long,
    too_many_arguments,
    optional_arguments_of_kernels,
    forbidden_calls,
    dangers,
    wrong_neighbours,
    container_classes,
]
BREACHES = [
    (upward_calls, "def f():\n    return public('measure')"),
    (upward_calls, "load('voxgran').measure"),
    (upward_calls, "importlib.import_module('voxgran')"),
    (wrong_arrows, "from voxgran.packing.model import Packing"),
    (wrong_arrows, "def f():\n    from voxgran import packing"),
    (wrong_arrows, "def f():\n    import voxgran.cli"),
    (wrong_arrows, "if TYPE_CHECKING:\n    from voxgran.io import spheres"),
    (wrong_arrows, "from voxgran import load_shape"),
    (wrong_arrows, "from ..packing import model"),
    (wrong_arrows, "import_module('voxgran.packing.methods')"),
    (heavy_imports, "import scipy.ndimage"),
    (heavy_imports, "try:\n    from numba import njit\nexcept ImportError:\n    pass"),
    (heavy_imports, "class A:\n    import xarray"),
    (undocumented_errors, "def f():\n    raise InputError('x')"),
    (undocumented_errors, "def f():\n    '''A.\n\n    Raises\n    ------\n    KeyError\n    '''\n    raise Input"),
    (undocumented_errors, "class A:\n    def f(self):\n        raise errors.InputError('x') from None"),
    (undocumented_errors, "def f():\n    raise _unknown('x')"),
    (undocumented_errors, "class A:\n    def __post_init__(self):\n        raise InputError"),
    (undocumented, "'''A.'''\ndef f() -> None: pass"),
    (undocumented, "'''A.'''\nclass A: pass"),
    (undocumented, "'''A.'''\ndef f(a) -> None:\n    '''F.'''"),
    (undocumented, "'''A.'''\ndef f(*, a: int):\n    '''F.'''"),
    (undocumented, "'''A.'''\nclass A:\n    '''A.'''\n    def f(self, a) -> None:\n        '''F.'''"),
    (undocumented, "x = 1"),
    (too_long, "def f():\n" + "    x = 1\n" * LONGEST_FUNCTION),
    (optional_arguments_of_kernels, "@bare_kernel\ndef f(a):\n    return 0 if a is None else a"),
    (optional_arguments_of_kernels, "@kernel\ndef f(a):\n    if a.mesh is not None:\n        return 1"),
    (forbidden_calls, "print(1)"),
    (forbidden_calls, "sys.exit(1)"),
    (forbidden_calls, "np.random.default_rng(1)"),
    (forbidden_calls, "from numpy.random import RandomState"),
    (forbidden_calls, "import random"),
    (dangers, "eval('1')"),
    (dangers, "exec(text)"),
    (dangers, "os.system(text)"),
    (dangers, "np.load(path)"),
    (dangers, "np.load(path, allow_pickle=True)"),
    (dangers, "subprocess.run(text, shell=True)"),
    (dangers, "import pickle"),
    (dangers, "from yaml import load"),
    (dangers, "load('dill').loads(text)"),
    (dangers, "archive.extractall(folder)"),
    (dangers, "jinja2.Environment(loader=loader)"),
    (container_classes, "isinstance(container, Box | Rectangle)"),
    (container_classes, "def f(c):\n    return isinstance(c, (Cylinder, containers.Sphere))"),
    (container_classes, "issubclass(kind, ClosedMesh)"),
    (container_classes, "type(c) is Box"),
    (container_classes, "type(c) in (Box, Sphere)"),
    (container_classes, "packing.container.kind == 'box'"),
    (container_classes, "match c:\n    case Sphere():\n        pass"),
]
NEIGHBOURS = [
    ("packing/rsa/sample.py", "from voxgran.packing.digital.bit_columns import Words"),
    ("packing/rsa/sample.py", "def f():\n    from voxgran.packing.digital import bit_columns"),
    ("packing/rsa/sample.py", "if TYPE_CHECKING:\n    import voxgran.packing.walking.feeding"),
    ("packing/rsa/sample.py", "from ..digital import bit_columns"),
    ("packing/walking/sample.py", "from voxgran.packing.digital.attempts import f"),
    ("packing/digital/sample.py", "from voxgran.packing.control_point.attempts import f"),
    ("packing/sample.py", "from voxgran.packing.digital.container_lattice import f"),
]
CIRCLES = [
    {"voxgran.a": "from voxgran.b import x", "voxgran.b": "import voxgran.a"},
    {"voxgran.shapes.a": "from voxgran.shapes import b", "voxgran.shapes.b": "def f():\n    from .a import x"},
    {
        "voxgran.shapes.a": "if TYPE_CHECKING:\n    from voxgran.shapes.b import x",
        "voxgran.shapes.b": "f('voxgran.shapes.c')",
        "voxgran.shapes.c": "from voxgran.shapes.a import x",
    },
]
HARMLESS = '''"""A file as it should be."""

from typing import TYPE_CHECKING

import numpy as np

from voxgran import __version__
from voxgran._base.errors import InputError
from voxgran.lattice.grid import Grid

if TYPE_CHECKING:
    import scipy


class A:
    """A noun."""

    def f(self, random: np.random.Generator) -> None:
        """Do it.

        Raises
        ------
        InputError, KeyError
            Always.

        Notes
        -----
        None.
        """
        try:
            raise InputError("x")
        except InputError as error:
            raise KeyError from error


def g() -> None:
    """Say voxgran.packing in vain."""
    import scipy.ndimage

    np.load(path, allow_pickle=False)
    re.compile(text)
    load("scipy")
    jinja2.Environment(autoescape=True)
'''


@pytest.mark.parametrize(("rule", "source"), BREACHES, ids=lambda v: getattr(v, "__name__", None))
def test_a_rule_finds_what_breaks_it(rule, source):
    assert rule(ast.parse(source), "shapes/sample.py") != []


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_lets_a_clean_file_pass(rule):
    assert rule(ast.parse(HARMLESS), "shapes/sample.py") == []


@pytest.mark.parametrize(("name", "source"), NEIGHBOURS)
def test_imports_between_sub_rooms_are_found(name, source):
    assert wrong_neighbours(ast.parse(source), name) != []


@pytest.mark.parametrize("arguments", ["{}", "{}, /", "a, *, {}"])
def test_functions_of_many_arguments_are_found(arguments):
    tree = ast.parse(f"def equilibrium({arguments.format(', '.join('bcdefghijkl'))}): pass")
    assert too_many_arguments(tree, "contacts/manifolds/sample.py") != []
    # those of a public function may be keywords
    assert (too_many_arguments(tree, "settling/equilibrium.py") == []) == ("*" in arguments)


def test_listed_imports_between_sub_rooms_pass():
    source = "from voxgran.packing.walking.feeding import f\nfrom voxgran.packing.model import Packing"
    assert wrong_neighbours(ast.parse(source), "packing/digital/sample.py") == []
    assert container_classes(ast.parse("isinstance(c, Box)"), "containers/sample.py") == []


@pytest.mark.parametrize("sources", CIRCLES)
def test_a_circle_of_files_is_found(sources):
    knows = {name: targets_of(ast.parse(source), name, sources) for name, source in sources.items()}
    assert circles(knows) == {frozenset(sources)}


def test_files_in_a_row_are_no_circle():
    row = {"voxgran.a": "from voxgran.b import x", "voxgran.b": "from voxgran.c import x", "voxgran.c": "x = 1"}
    assert circles({name: targets_of(ast.parse(source), name, row) for name, source in row.items()}) == set()


def test_full_folders_are_found():
    assert full_folders([f"io/file{k}.py" for k in range(FULLEST + 1)]) == [f"io/ has {FULLEST + 1} entries"]
    assert full_folders([f"packing/room{k}/file.py" for k in range(FULLEST + 1)]) != []
    assert full_folders([f"packing/rsa/file{k}.py" for k in range(FULLEST)]) == []


def test_no_folder_is_too_full():
    assert full_folders(NAMES) == []


def test_every_file_keeps_the_rules_and_there_is_no_circle_of_files():
    words = {name: ["voxgran", *name.removesuffix(".py").split("/")] for name in NAMES}
    modules = {name: ".".join(parts).removesuffix(".__init__") for name, parts in words.items()}
    breaches, knows, all_modules = [], {}, set(modules.values())
    for name, module in modules.items():
        text = (PACKAGE / name).read_text()
        # each file is parsed once, and its tree, of many thousand objects, is not kept
        tree = ast.parse(text)
        breaches += [f"voxgran/{name}: {rule.__name__}: {breach}" for rule in RULES for breach in rule(tree, name)]
        if text.count("\n") > LONGEST_FILE:
            breaches.append(f"voxgran/{name}: {text.count(chr(10))} lines, at most {LONGEST_FILE}")
        knows[module] = targets_of(tree, module, all_modules)
    assert not breaches, "\n".join(breaches)
    assert circles(knows) == set()


def test_arrows_point_backwards_only():
    order = list(ARROWS)
    for room, known in ARROWS.items():
        assert all(order.index(other) < order.index(room) for other in known)


def modules_after(statement):
    """Return what a fresh Python has loaded after a statement, and the seconds that this took."""
    code = f"import sys\n{statement}\nimport json\nprint(json.dumps(sorted(sys.modules)))"
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return set(json.loads(done.stdout)), time.perf_counter() - start


def test_importing_the_package_loads_nothing_else():
    bare, package = [], []
    for _ in range(3):
        bare.append(modules_after("import importlib, types, typing"))
        package.append(modules_after("import voxgran"))
    new = package[0][0] - bare[0][0]
    extra = 1e3 * (min(t for _, t in package) - min(t for _, t in bare))
    print(f"import voxgran: {extra:.1f} ms above a bare interpreter")  # noqa: T201
    assert {name for name in new if name.split(".")[0] != "voxgran"} == set()
    assert len(new) <= 3, "the rooms are imported on first use, not with the package"


def test_public_names_resolve():
    import voxgran

    assert voxgran.__all__
    assert [name for name in voxgran.__all__ if not hasattr(voxgran, name)] == []
    assert set(voxgran.__all__) <= set(dir(voxgran))
    with pytest.raises(AttributeError, match="no_such_name"):
        voxgran.no_such_name  # noqa: B018  (the access is what is tested)
