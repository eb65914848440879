"""Packings made of other packings and of images."""
