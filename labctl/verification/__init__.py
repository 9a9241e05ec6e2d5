"""A run's numbers again, from its raw files."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
