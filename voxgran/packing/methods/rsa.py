"""Door of the packing method rsa: :mod:`voxgran.packing.rsa.method`."""

from voxgran.packing.rsa.method import registration as registration
