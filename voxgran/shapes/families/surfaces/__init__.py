"""Open surfaces."""
