"""Door of the packing method jam: :mod:`voxgran.packing.jamming.jam`."""

from voxgran.packing.jamming.jam import registration as registration
