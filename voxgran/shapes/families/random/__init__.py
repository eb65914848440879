"""Random solids."""
