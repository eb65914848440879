"""What several families of shapes share, and what a generator notes about a shape."""
