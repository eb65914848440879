"""Many scenes: a base scene with axes and seeds, computed in processes or on Dask, and gathered in one dataset."""
