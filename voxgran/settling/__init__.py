"""Settling of true shapes under gravity."""
