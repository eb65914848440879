"""One packing method per file; the file name is the name of the method."""

from voxgran._base import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
