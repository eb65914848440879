"""Digital packing: grains and container are voxels."""
