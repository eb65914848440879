"""Shapes of grains: true geometry, size, form, and the files that contain them.

``voxgran.shapes.sphere(radius=2)`` and its siblings make shapes: one function for each registered family, whose
signatures are in the stub beside this file.
"""

from collections.abc import Callable
from typing import Any

from voxgran._base import Missing


def __getattr__(name: str) -> "Callable[..., Any]":
    """Return the function that makes shapes of a family."""
    if not name.startswith("_"):
        from voxgran.shapes.family import family_function, shape_families

        if name in shape_families():
            return family_function(name)
    raise AttributeError(Missing(__name__, name), name=name)


def __dir__() -> list[str]:
    """List the families."""
    from voxgran.shapes.family import shape_families

    return list(shape_families())
