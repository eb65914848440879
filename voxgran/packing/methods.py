"""Parameter classes of the packing methods: ``vg.methods.Digital(voxel_size=0.1)``."""

from voxgran._base import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
