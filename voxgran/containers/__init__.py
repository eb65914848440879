"""What holds the grains: box, cylinder, closed mesh; rectangle in two dimensions."""
