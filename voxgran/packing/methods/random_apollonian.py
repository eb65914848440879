"""Door of the packing method random_apollonian: :mod:`voxgran.packing.space_filling.random_apollonian`."""

from voxgran.packing.space_filling.random_apollonian import registration as registration
