"""Evolution of fiber layouts: genomes, variation, constraints, AFPO, scoring, checkpoints, workers."""

# For programs of others; the modules that are not named are the package's own.
__all__ = [
    "choose",
    "constraints",
    "front",
    "genome",
    "problem",
    "run_folder",
    "search",
    "settings",
    "variation",
    "workers",
]
