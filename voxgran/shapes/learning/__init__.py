"""Distributions of shapes that are learned from a sample of grains."""
