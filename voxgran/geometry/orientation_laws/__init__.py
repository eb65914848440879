"""Distributions of orientations."""
