"""Configuration files in, frozen dataclasses out."""

# For programs of others; the modules that are not named are the package's own.
__all__ = ["design", "load", "rig"]
