"""Contact points of grains that are near each other or near walls, for dynamics: one kind of pair per file."""
