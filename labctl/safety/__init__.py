"""SAFE as a state that is read back, the supervisor that enforces the limits, the guard that outlives the program."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
