"""Run time against error: ``python -m benchmarks NAME -o FOLDER``."""
