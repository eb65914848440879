"""voxgran: packed assemblies of grains of true shape, checked, measured and ready for a simulation.

The public names are imported on first use (PEP 562), so that ``import voxgran`` loads no other library. The stub beside
this file is their table.
"""

from typing import Any

from voxgran._base import lazy_names

__version__ = "0.1.0"

_find, __dir__, __all__ = lazy_names(__name__, __file__)
__all__ += ["__version__"]


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    return _find(name)
