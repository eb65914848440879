"""Arithmetic with the same bits on every processor: linear algebra, elementary functions, large products."""
