"""Grains without poses into grains with poses, checked against the true geometry."""
