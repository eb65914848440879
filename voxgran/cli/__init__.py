"""The command line."""

from voxgran.cli.main import main

__all__ = ["main"]
