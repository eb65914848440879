"""Door of the packing method multilayer: :mod:`voxgran.packing.jamming.multilayer`."""

from voxgran.packing.jamming.multilayer import registration as registration
