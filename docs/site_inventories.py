"""Links of types to the pages of Python, NumPy and xarray, without a network.

Sphinx reads such links from the inventories of those sites. They are large and cannot be fetched here, so that this
table states the few names that the reference needs; each leads to the place that its project keeps for it.
"""

import zlib
from pathlib import Path

#: address of each project, and of its names: (role, name, page)
OUTSIDE = {
    "python": (
        "https://docs.python.org/3/",
        (
            ("std:label", "bltin-boolean-values", "library/stdtypes.html#$"),
            ("py:data", "None", "library/constants.html#$"),
            ("py:data", "True", "library/constants.html#$"),
            ("py:data", "False", "library/constants.html#$"),
            ("py:class", "list", "library/stdtypes.html#$"),
            ("py:class", "tuple", "library/stdtypes.html#$"),
            ("py:class", "str", "library/stdtypes.html#$"),
            ("py:class", "dict", "library/stdtypes.html#$"),
            ("py:class", "float", "library/functions.html#$"),
            ("py:class", "int", "library/functions.html#$"),
            ("py:function", "callable", "library/functions.html#$"),
            ("py:class", "pathlib.Path", "library/pathlib.html#$"),
            ("std:term", "iterable", "glossary.html#term-$"),
            ("std:term", "sequence", "glossary.html#term-$"),
            ("std:term", "mapping", "glossary.html#term-$"),
            ("std:term", "path-like object", "glossary.html#term-path-like-object"),
        ),
    ),
    "numpy": (
        "https://numpy.org/doc/stable/",
        (
            ("py:class", "numpy.ndarray", "reference/generated/numpy.ndarray.html#$"),
            ("std:term", "array_like", "glossary.html#term-$"),
        ),
    ),
    "xarray": (
        "https://docs.xarray.dev/en/stable/",
        (
            ("py:class", "xarray.Dataset", "generated/xarray.Dataset.html#$"),
            ("py:class", "xarray.DataTree", "generated/xarray.DataTree.html#$"),
        ),
    ),
}
#: words for types in docstrings, and what they lead to
WORDS = {
    "bool": ":ref:`bool <python:bltin-boolean-values>`",
    "callable": ":func:`python:callable`",
    "path-like": ":term:`path-like <python:path-like object>`",
    "array_like": ":term:`numpy:array_like`",
    "ndarray": ":class:`ndarray <numpy.ndarray>`",
    "Path": ":class:`Path <pathlib.Path>`",
}
WORDS |= {word: f":data:`python:{word}`" for word in ("None", "True", "False")}
WORDS |= {word: f":class:`python:{word}`" for word in ("list", "tuple", "str", "dict", "float", "int")}
WORDS |= {word: f":term:`python:{word}`" for word in ("iterable", "sequence", "mapping")}
WORDS |= {name: f":class:`{name}`" for name in ("xarray.Dataset", "xarray.DataTree")}


def write_inventories(folder):
    """Write an inventory for each project and return what Sphinx's `intersphinx_mapping` holds."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return {project: (address, str(_written(folder, project, names))) for project, (address, names) in OUTSIDE.items()}


def _written(folder, project, names):
    """Return the inventory of a project, in version 2 of Sphinx's format."""
    head = (
        f"# Sphinx inventory version 2\n# Project: {project}\n# Version: \n"
        "# The remainder of this file is compressed using zlib.\n"
    )
    lines = "".join(f"{name} {role} {-1 if role[:3] == 'std' else 1} {page} -\n" for role, name, page in names)
    path = folder / f"{project}.inv"
    path.write_bytes(head.encode() + zlib.compress(lines.encode()))
    return path
