"""Meshes that are not one closed solid: what is wrong, and closed ones made of them."""
