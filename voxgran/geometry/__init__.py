"""Geometry without grains: vectors, triangles, trees of boxes, grids of cells, rotations, convex solids."""
