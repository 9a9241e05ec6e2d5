"""The bounds that every driver holds a setpoint to before a byte leaves."""

import math

from labctl.errors import SetpointOutOfRange


def check_setpoint(name: str, setpoint_psi: float, max_setpoint_psi: float) -> None:
    """Let a setpoint pass that is a number between 0 and the driver's maximum, in psi gauge.

    Raises:
        SetpointOutOfRange: any other.
    """
    if not math.isfinite(setpoint_psi) or setpoint_psi < 0:
        raise SetpointOutOfRange(f"{name}: setpoint {setpoint_psi} psi is not a pressure of 0 psi or more")
    if setpoint_psi > max_setpoint_psi:
        raise SetpointOutOfRange(
            f"{name}: setpoint {setpoint_psi:g} psi is above the rig's limit of {max_setpoint_psi:g} psi "
            "(limits.max_pressure)"
        )
