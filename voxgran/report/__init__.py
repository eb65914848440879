"""Pictures, plots and one self-contained page about a packing."""
