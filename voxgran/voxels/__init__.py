"""Shapes as voxels of a solid."""
