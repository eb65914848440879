"""What a grain is, continuous: its true geometry, its size, its form, and the files that it comes from."""
