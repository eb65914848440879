"""Door of the packing method control_point: :mod:`voxgran.packing.control_point.method`."""

from voxgran.packing.control_point.method import registration as registration
