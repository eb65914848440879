"""Door of the packing method gravity: :mod:`voxgran.packing.beds.method`."""

from voxgran.packing.beds.method import registration as registration
