"""Grains in the cells of meshes: spheres in tetrahedra, and shapes in the cells of a tessellation."""
