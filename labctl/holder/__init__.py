"""Who holds a rig: found by the rig's addresses, wherever its program was started, and reached at once."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
