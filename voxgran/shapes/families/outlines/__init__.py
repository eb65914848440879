"""Outlines in the plane."""
