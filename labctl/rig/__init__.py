"""One rig: its instruments opened and closed together, and the verbs of a protocol."""

from labctl.rig.rig import Rig
from labctl.rig.trace import PressureTrace

__all__ = ["PressureTrace", "Rig"]
