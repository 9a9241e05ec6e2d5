"""From targets and a sheet to the settings of a search, from a run of it to a design file."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
