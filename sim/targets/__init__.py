"""Target shapes: what a sheet's heights are scored against."""

# For programs of others; the modules that are not named are the package's own.
__all__ = ["cloud", "shapes", "target"]
