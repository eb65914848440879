"""Numbers that describe the form of a shape, each with its formula and source in one place."""
