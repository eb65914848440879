"""Benchmarks of images, voxels and distances."""
