"""Benchmarks of beds and specimens at rest."""
