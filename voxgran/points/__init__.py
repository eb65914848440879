"""Point clouds, and points on the surfaces of shapes."""
