"""Door of the packing method expand: :mod:`voxgran.packing.jamming.expand`."""

from voxgran.packing.jamming.expand import registration as registration
