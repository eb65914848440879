"""Grains that fall one after the other and stick or roll to a place where they rest."""
