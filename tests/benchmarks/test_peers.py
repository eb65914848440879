"""Programs that compare voxgran with others find what they import of it: they are run by slow tests only."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

from benchmarks.model import PEERS


@pytest.mark.parametrize("path", sorted(PEERS.rglob("*.py")), ids=lambda path: path.name)
def test_what_a_peer_imports_is_there(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("voxgran"):
            module = import_module(str(node.module))
            assert [one.name for one in node.names if not hasattr(module, one.name)] == []
