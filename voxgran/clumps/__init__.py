"""Shapes as clumps of spheres."""
