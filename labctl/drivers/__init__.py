"""One plain class for each real device, reading like the device's manual."""

# Nothing here is for programs of others: they have labctl.api.
__all__: list[str] = []
