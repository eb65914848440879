#!/usr/bin/env python3
"""Write the lowest versions that pyproject.toml declares as constraints for pip.

``lowest.py [EXTRA ...] > constraints.txt`` takes the dependencies and those of some extras. pip cannot resolve to the
lowest versions by itself. A floor of three numbers is meant exactly; of one with fewer, ``numba>=0.60``, the newest
correction is taken, ``numba==0.60.*``, since not every project has a release that ends with 0.
"""

import argparse
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def constraints(project: dict[str, Any], extras: list[str]) -> list[str]:
    """Return one line for each library: its name and its lowest version.

    Raises
    ------
    ValueError
        If an extra is unknown or a requirement is not of the form name>=version.
    """
    known = project["optional-dependencies"]
    wanted = list(project["dependencies"])
    for name in extras:
        if name not in known:
            raise ValueError(f"extra {name!r} is unknown: known are {', '.join(known)}")
        wanted += known[name]
    lines = set()
    for line in wanted:
        found = re.fullmatch(r"([\w.-]+)(?:\[[\w,]+\])?>=(\d+(?:\.\d+)*)(?:,<[\d.]+)?", line)
        if found is None:
            raise ValueError(f"requirement {line!r} has no floor: write it as name>=version")
        exact = found[2].count(".") >= 2
        lines.add(f"{found[1]}=={found[2]}" + ("" if exact else ".*"))
    return sorted(lines, key=str.casefold)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("extras", nargs="*", metavar="EXTRA")
    extras, text = parser.parse_args().extras, tomllib.loads(PROJECT.read_text())
    sys.stdout.write("\n".join(constraints(text["project"], extras)) + "\n")
