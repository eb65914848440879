"""What several families of shapes share."""
