"""What strain of the expanding layer can be simulated."""

import math

from sim.errors import SimError

MAX_STRAIN = 0.6


def check_strain(strain: float, lowest: float = 0.0) -> float:
    """The linear strain of the expanding layer, if it is one that the lattice can follow.

    Raises:
        SimError: it is not finite, below `lowest` or above 0.6.
    """
    if not (math.isfinite(strain) and lowest <= strain <= MAX_STRAIN):
        raise SimError(
            f"the expanding layer's strain {strain:g} is outside {lowest:g} to {MAX_STRAIN:g}: "
            "check the pressure and the strain at the rated pressure (about 0.18)"
        )
    return strain
