"""Twins: packings of any number of grains that equal a sample, and how nearly they do."""
