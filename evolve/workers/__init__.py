"""Who simulates: this process, processes beside it, or a cluster."""

# For programs of others; the modules that are not named are the package's own.
__all__ = ["cluster", "local", "pool"]
