"""The command line: one file a command group; heavy imports only inside the command that needs them."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
