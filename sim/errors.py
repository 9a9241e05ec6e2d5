"""The one error of the simulator."""


class SimError(ValueError):
    """Input that cannot be simulated; the message gives what, which value, which limit, what to do next."""
