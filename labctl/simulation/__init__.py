"""The one joint between the laboratory's files and `sim`."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
