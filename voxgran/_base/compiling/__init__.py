"""How kernels are compiled, linked and kept."""
