"""Door of the packing method tetrahedral: :mod:`voxgran.packing.tessellation.method`."""

from voxgran.packing.tessellation.method import registration as registration
