"""Benchmarks of packings."""
