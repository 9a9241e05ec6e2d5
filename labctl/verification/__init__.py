"""A run's numbers again, from its raw files."""
