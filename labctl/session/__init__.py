"""A run of a protocol: its plan, its trials one after the other, pausing, stopping, continuing later."""

# For programs of others; the modules that are not named are the package's own.
__all__ = ["contract"]
