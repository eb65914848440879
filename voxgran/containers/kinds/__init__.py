"""One kind of containers per file; the file name is the name of the kind."""
