"""Door of the packing method digital_fill: :mod:`voxgran.packing.digital.fill_method`."""

from voxgran.packing.digital.fill_method import registration as registration
