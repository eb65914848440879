"""Packings, scenes, label images and statistics into files and out of them."""
