"""Trade-offs of images, voxels and distances."""
