"""Door of the packing method deposition: :mod:`voxgran.packing.deposition.method`."""

from voxgran.packing.deposition.method import registration as registration
