"""Pressures over a stretch of time."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PressureTrace:
    """Pressures read while something went on, in psi, with the rig's clock in seconds; at least one."""

    times_s: tuple[float, ...]
    pressures_psi: tuple[float, ...]

    @property
    def mean_psi(self) -> float:
        """The mean pressure."""
        return sum(self.pressures_psi) / len(self.pressures_psi)

    @property
    def extremes_psi(self) -> tuple[float, float]:
        """The lowest and the highest pressure."""
        return min(self.pressures_psi), max(self.pressures_psi)
