"""One trade-off per file; the file name is its name at the prompt."""
