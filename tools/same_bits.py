#!/usr/bin/env python3
"""Find calls whose result depends on the processor.

BLAS and LAPACK sum in an order of their own on each processor; NumPy computes elementary functions and sorts without
``kind="stable"`` by other instructions where there is AVX-512. Results are made by
`voxgran._base.arithmetic` instead. What stands in NOT_RESULTS and what is compiled are left out; a line that ends in a
comment ``# bits: REASON`` is an exception. Each finding is a line, and the status is then 1.
"""

import argparse
import ast
import sys
from collections.abc import Iterator
from pathlib import Path

#: rooms and files of pictures, statistics of studies, and times, on which no result depends
NOT_RESULTS = ("app", "cli", "report", "study", "testing", "thumbnail")
#: what NumPy hands to BLAS or LAPACK
PRODUCTS = (
    *(
        "convolve",
        "corrcoef",
        "correlate",
        "cov",
        "dot",
        "einsum",
        "inner",
        "linalg",
        "matmul",
        "matvec",
        "polyfit",
        "polynomial",
    ),
    *("roots", "tensordot", "vdot", "vecdot", "vecmat"),
)
#: what NumPy computes by the instructions of the processor
FUNCTIONS = (
    *("arccos", "arccosh", "arcsin", "arcsinh", "arctan", "arctan2", "arctanh", "cbrt", "cos", "cosh", "exp", "exp2"),
    *("expm1", "float_power", "log", "log10", "log1p", "log2", "logaddexp", "power", "sin", "sinh", "tan", "tanh"),
)
#: what of SciPy calls these
LIBRARIES = ("scipy.linalg", "scipy.sparse.linalg", "scipy.stats", "numpy.linalg")
#: functions of NumPy that return arrays
MAKE_ARRAYS = ("np.abs", "np.arange", "np.array", "np.asarray", "np.diff", "np.maximum", "np.minimum", "np.where")
#: decorators of what is compiled
COMPILED = ("kernel", "instruction")


def findings(tree: ast.AST, lines: list[str]) -> Iterator[tuple[int, str]]:
    """Yield the line and the name of each call that depends on the processor."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef) and any(
            word in ast.unparse(decorator) for decorator in node.decorator_list for word in COMPILED
        ):
            continue
        name = _name(node)
        if name and "# bits: " not in lines[node.lineno - 1]:
            yield node.lineno, name
        yield from findings(node, lines)


def _name(node: ast.AST) -> str:
    """Return what a node calls that depends on the processor; "" for anything else."""
    if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
        return "@"
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in LIBRARIES:
        return node.value
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow) and _is_array(node.left):
        exact = isinstance(node.right, ast.Constant) and node.right.value in (0.5, 1, 2)
        return "" if exact else "** of an array"
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        called = node.func.attr
        if called == "argsort" and "kind='stable'" not in map(ast.unparse, node.keywords):
            return "argsort without kind='stable'"
        if called in ("argpartition", "dot", "gaussian_filter"):
            return called
    if isinstance(node, ast.Attribute):
        whole = ast.unparse(node)
        if whole in ("np.linalg", "np.polynomial", "np.roots") or (
            whole.startswith("np.") and whole[3:] in (*PRODUCTS, *FUNCTIONS)
        ):
            return whole
    return ""


def _is_array(node: ast.AST) -> bool:
    """Return whether an expression is one of arrays: what is not clearly one is tried by tests."""
    if isinstance(node, ast.BinOp):
        return _is_array(node.left) or _is_array(node.right)
    return isinstance(node, ast.Call) and ast.unparse(node.func) in MAKE_ARRAYS


def main(folders: list[Path]) -> int:
    """Print each finding; return 1 if there is one."""
    found = 0
    for folder in folders:
        for path in sorted(folder.rglob("*.py")):
            if {*path.parts, path.stem} & set(NOT_RESULTS):
                continue
            text = path.read_text(encoding="utf-8")
            for line, name in findings(ast.parse(text), text.splitlines()):
                sys.stdout.write(
                    f"{path}:{line}: {name} depends on the processor: use voxgran._base.arithmetic, or say why not "
                    "in a comment '# bits: REASON'\n"
                )
                found += 1
    return min(found, 1)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="*", type=Path, default=[Path("voxgran")], help="default: voxgran")
    given = parser.parse_args().folder
    if wrong := [folder for folder in given if not folder.is_dir()]:
        parser.error(f"{wrong[0]} is no folder")
    sys.exit(main(given))
