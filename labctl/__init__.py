"""The laboratory: instruments, safety, measurement and the command line."""

__version__ = "0.1.0"
