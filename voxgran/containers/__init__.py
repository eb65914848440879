"""Containers of grains: box, cylinder, sphere, closed mesh; rectangle, disk and polygon in two dimensions."""

from voxgran._base import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
