"""What labctl logs by the standard logging, and how it reaches a file or a terminal without waiting for either."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
