"""Benchmarks of grains, their sizes and their measures."""
