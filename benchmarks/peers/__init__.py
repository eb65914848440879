"""Programs that benchmarks compare voxgran with; those with a command line run in another environment."""
