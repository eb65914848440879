"""Engines, one per file; the registry finds each by the name of its file."""
