"""What the evolution refuses."""


class EvolveError(ValueError):
    """A setting, a genome or a file that cannot be used: what, which value, which limit, what to do next."""


class WorkersLost(RuntimeError):
    """The workers that simulate are gone or do not answer; the last checkpoint holds the search."""


class SearchStopped(Exception):
    """Somebody asked for a stop; the last checkpoint holds the search."""
