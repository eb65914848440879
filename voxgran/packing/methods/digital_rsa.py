"""Door of the packing method digital_rsa: :mod:`voxgran.packing.digital.rsa_method`."""

from voxgran.packing.digital.rsa_method import registration as registration
