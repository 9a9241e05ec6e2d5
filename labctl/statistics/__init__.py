"""What trials give together: means, intervals, comparisons, tables."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
