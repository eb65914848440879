"""Decks, which are input of DEM and DDA engines, and how far a packing is from rest in one of them."""
