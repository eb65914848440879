"""Grains in the cells of meshes."""
