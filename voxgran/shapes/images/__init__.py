"""Shapes and labels from images."""
