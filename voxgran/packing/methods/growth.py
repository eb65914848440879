"""Door of the packing method growth: :mod:`voxgran.packing.space_filling.growth`."""

from voxgran.packing.space_filling.growth import registration as registration
