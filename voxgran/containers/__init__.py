"""Containers of grains: box, cylinder, sphere, closed mesh; rectangle in two dimensions."""
