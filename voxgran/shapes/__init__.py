"""Shapes of grains: true geometry, size, form, and the files that contain them."""
