"""Measures of packings: one per file, with all results in one `xarray.DataTree`."""
