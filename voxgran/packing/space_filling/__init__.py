"""Spheres whose sizes follow from the gaps between others: growth, random and exact Apollonian packings."""
