"""`labctl evolve` and its sub-commands."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
