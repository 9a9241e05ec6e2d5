"""A run's numbers and recordings in files that other programs read."""
