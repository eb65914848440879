"""Run time against error, one trade-off per file."""
