"""From a trial's raw recording to its numbers: the same function live, in `labctl verify` and in a report."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
