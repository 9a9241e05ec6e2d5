"""The laboratory: instruments, safety, measurement and the command line."""

__version__ = "0.1.0"

# For programs of others: labctl.api. Every other room is labctl's own, save those that say otherwise.
__all__ = ["__version__", "api"]
