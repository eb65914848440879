"""Shapes as points on their surface."""
