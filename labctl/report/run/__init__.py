"""The page of runs."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
