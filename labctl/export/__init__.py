"""A run's numbers and recordings in files that other programs read."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
