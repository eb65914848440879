"""Packings into numbers: one question per file, all answers in one `xarray.DataTree`.

The package and the function that users call share the name `measure`; therefore the package can be called, and
``voxgran.measure(packing)`` works whichever of them the name has been bound to.
"""

import sys
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    """A module that measures when it is called."""

    def __call__(self, packing: Any, **options: Any) -> Any:
        """Delegate to :func:`voxgran.measure.model.measure`."""
        from voxgran.measure.model import measure

        return measure(packing, **options)


sys.modules[__name__].__class__ = _Callable
