"""Random sequential addition, to proven saturation."""
