"""Between psi and the unit that a pressure instrument is set to."""

from labctl.config.rig import PressureUnit

# One pound-force (0.45359237 kg times 9.80665 m/s2) on one square inch (0.0254 m squared), by definition.
PASCAL_PER_PSI = 0.45359237 * 9.80665 / 0.0254**2

_PASCAL_PER_UNIT: dict[PressureUnit, float] = {
    "psi": PASCAL_PER_PSI,
    "kPa": 1e3,
    "bar": 1e5,
    "mbar": 1e2,
}


def to_psi(value: float, unit: PressureUnit) -> float:
    """A pressure in `unit`, in psi."""
    return value if unit == "psi" else value * _PASCAL_PER_UNIT[unit] / PASCAL_PER_PSI


def from_psi(pressure_psi: float, unit: PressureUnit) -> float:
    """A pressure in psi, in `unit`."""
    return pressure_psi if unit == "psi" else pressure_psi * PASCAL_PER_PSI / _PASCAL_PER_UNIT[unit]
