"""Door of the packing method gravity: :mod:`voxgran.packing.growth.method`."""

from voxgran.packing.growth.method import registration as registration
