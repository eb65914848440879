"""Whether grains of true shapes have a point in common with each other or with walls, without the depth."""
