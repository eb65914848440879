"""Warnings that point at the line of the user, and those about former names, which are accepted for one release."""

import sys
import warnings


def warn(text: str, category: type[Warning]) -> None:
    """Issue a warning of one sentence that points at the first caller outside of voxgran, and of properties kept."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in ("voxgran", "functools"):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, category, stacklevel=level)


def warn_former(text: str) -> None:
    """Issue a DeprecationWarning of one sentence, as :func:`warn`."""
    warn(text, DeprecationWarning)
