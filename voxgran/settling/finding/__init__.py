"""Where grains are near each other and near walls: one kind of pair per file."""
