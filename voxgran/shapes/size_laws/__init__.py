"""Distributions of grain sizes."""
