"""Door of the packing method apollonian: :mod:`voxgran.packing.space_filling.apollonian`."""

from voxgran.packing.space_filling.apollonian import registration as registration
