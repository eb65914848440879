"""Control-point packing: grains are points on their surfaces."""
