"""What the methods share in which grains move by random steps."""
