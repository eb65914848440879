"""Grains that grow together to a solid fraction, or until they jam."""
