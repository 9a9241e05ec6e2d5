"""What the rig needs of an instrument, whatever its make, and what instruments report."""

# For programs of others; the modules that are not named are the package's own.
__all__ = ["interfaces", "readings"]
