"""From a scene file to a checked, measured and saved packing."""
