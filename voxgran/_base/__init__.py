"""What every room may use and what knows nothing about grains."""
