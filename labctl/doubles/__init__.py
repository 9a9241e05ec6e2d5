"""Byte-level doubles of the instruments, and the plant behind them that really fills, jams and bends."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
