"""Contacts of grains of all kinds: overlaps, verification, equilibrium, and the points at which grains touch."""
