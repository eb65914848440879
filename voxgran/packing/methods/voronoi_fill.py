"""Door of the packing method voronoi_fill: :mod:`voxgran.packing.tessellation.voronoi_method`."""

from voxgran.packing.tessellation.voronoi_method import registration as registration
