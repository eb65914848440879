"""Door of the packing method digital: :mod:`voxgran.packing.digital.walk_method`."""

from voxgran.packing.digital.walk_method import registration as registration
