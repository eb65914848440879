"""voxgran: packed assemblies of grains of true shape, checked, measured and ready for a simulation.

The public names are imported on first use (PEP 562), so that ``import voxgran`` loads no other library. The stub beside
this file is their table.
"""

from typing import Any

from voxgran._base import lazy_names

__version__ = "0.1.0"

#: former names, accepted with a DeprecationWarning
_FORMER = {"read_image": "load_image", "write_comparison": "save_comparison", "write_report": "save_report"}

_find, __dir__, __all__ = lazy_names(__name__, __file__)
__all__ += ["__version__"]


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name in _FORMER:
        from voxgran._base.errors import warn_former

        warn_former(f"voxgran.{name} is now voxgran.{_FORMER[name]}; write that name")
        return _find(_FORMER[name])
    return _find(name)
