"""Packings into numbers: one question per file, all answers in one `xarray.DataTree`."""
