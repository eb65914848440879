"""Solids in closed form."""
