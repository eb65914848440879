"""The page of the command line, made of the parsers that read it."""

import argparse

from site_tables import code, table

from voxgran.cli.commands import COMMANDS
from voxgran.cli.parser import EXAMPLES, make_parser

HEAD = """# Command line

Each command of `voxgran` with its options. `voxgran COMMAND --help` prints the same; the options of `voxgran shape` and
`voxgran clump` that belong to one family or method are shown where it is named: `voxgran shape solid_union --help`.
Every command ends with the exit status 0, 2 after wrong input, or 1 after a failure.
"""
#: columns of the tables
COLUMNS = ("option", "values", "default", "meaning")
#: options that every command has, listed once
COMMON = ("--help", "--json", "--overwrite", "--verbose", "--quiet")


def parsers():
    """Return the parser of each command by its name."""
    top = make_parser([], COMMANDS)
    found = next(action for action in top._actions if isinstance(action, argparse._SubParsersAction))
    return dict(found.choices)


def _row(action):
    """Return the row of an argument or option: name, values, default, meaning."""
    names = ", ".join(map(code, action.option_strings)) or code(action.metavar or action.dest)
    values = ", ".join(map(code, action.choices or ()))
    if not values and action.nargs != 0:
        values = {int: "a whole number", float: "a number"}.get(action.type, "")
    default = "required" if action.required else code(action.default)
    if action.default in (None, False, argparse.SUPPRESS) and not action.required:
        default = ""
    return names, values, default, (action.help or "").replace("%%", "%")


def _shown(parser):
    """Return the arguments and options of a parser that its help shows."""
    return [action for action in parser._actions if action.help != argparse.SUPPRESS]


def command(name, parser):
    """Return the section of one command."""
    own = [action for action in _shown(parser) if not set(COMMON) & set(action.option_strings)]
    lines = [f"## {name}", "", f"{parser.description}", "", "```text"]
    lines += [line.strip() for line in EXAMPLES[name].splitlines()]
    lines += ["```", ""]
    if own:
        lines += [table(COLUMNS, map(_row, own)), ""]
    return "\n".join(lines)


def page():
    """Return the page of the command line, in Markdown."""
    found = parsers()
    common = [action for action in _shown(next(iter(found.values()))) if set(COMMON) & set(action.option_strings)]
    parts = [HEAD, "## Options of every command", "", table(COLUMNS, map(_row, common)), ""]
    return "\n".join([*parts, *(command(name, parser) for name, parser in found.items())])
