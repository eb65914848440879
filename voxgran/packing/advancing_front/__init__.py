"""The advancing front: each sphere touches three others."""
