"""Runs, trials, events and raw samples, committed before they are reported."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
