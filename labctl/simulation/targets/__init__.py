"""Target shapes as people name them, and a simulated sheet's score against one."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
