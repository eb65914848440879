"""One family of shapes per file; the file name is the name of the family."""
