"""Bytes: serial ports and TCP, with a deadline on every call."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
