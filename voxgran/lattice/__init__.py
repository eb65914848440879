"""Arrays on a regular lattice; no grains here."""
