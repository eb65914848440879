"""``python -m voxgran``: the command line."""

import sys

from voxgran.cli import main

if __name__ == "__main__":
    sys.exit(main())
