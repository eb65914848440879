"""One voxelization backend per file; the file name is the name of the backend."""
