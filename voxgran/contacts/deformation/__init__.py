"""Grains that deform where they overlap."""
