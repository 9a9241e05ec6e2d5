"""From marker frames to heights of the sheet."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
