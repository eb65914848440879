"""Door of the packing method advancing_front: :mod:`voxgran.packing.advancing_front.method`."""

from voxgran.packing.advancing_front.method import registration as registration
