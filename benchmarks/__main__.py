"""Measure run time against error: python -m benchmarks NAME ... -o FOLDER."""

import argparse
from importlib import import_module
from pathlib import Path

from benchmarks.model import benchmarks


def main() -> None:
    """Run the benchmarks that the command line names, and print the files that they write."""
    modules = benchmarks()
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure run time against error.")
    parser.add_argument("names", nargs="+", choices=modules, metavar="NAME", help=", ".join(modules))
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"), help="folder")
    options = parser.parse_args()
    for name in options.names:
        for path in import_module(modules[name]).run(options.output):
            print(path, flush=True)


if __name__ == "__main__":
    main()
