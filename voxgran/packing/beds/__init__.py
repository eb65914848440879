"""Beds that grow from random seeds with contacts, and settle."""
