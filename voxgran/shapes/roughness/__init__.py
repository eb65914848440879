"""Rough surfaces: random height fields, surfaces displaced by them, and what is measured on both."""
