"""Geometry without grains: vectors, rotations, triangles, trees of boxes, pairs of spheres and grids of cells."""
