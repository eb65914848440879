"""Files of meshes and of spheres: bytes to arrays and back."""
