"""What stands behind a double's device in a fuzz: a pressure that is another one at every look, coils, no physics."""

from types import SimpleNamespace

import numpy as np

from labctl.doubles.chamber import Mode
from labctl.doubles.plant import PlantState

NO_POINTS = np.zeros((0, 3))


class RestlessPlant:
    """Takes what a plant takes; `last` is the state that was looked at last."""

    def __init__(self, rng, channels=32):
        self.settings = SimpleNamespace(channels=channels, single_valve=False)
        self.full_scale_psi = 15.0
        self.coils = frozenset()
        self.setpoint_psi = 0.0
        self.mode = Mode.CONTROL
        self.last = None
        self._rng = rng
        self.state()

    def state(self):
        measured_psi = self._rng.uniform(0.5, 4.2)
        self.last = PlantState(
            time_s=0.0,
            pressure_psi=measured_psi,
            measured_psi=measured_psi,
            setpoint_psi=self.setpoint_psi,
            mode=self.mode,
            coils=self.coils,
            jammed=frozenset(),
            points_mm=NO_POINTS,
        )
        return self.last

    def write_setpoint(self, setpoint_psi):
        self.setpoint_psi = setpoint_psi

    def switch_mode(self, mode):
        self.mode = mode

    def write_coils(self, coils):
        on = {channel for channel, is_on in coils.items() if is_on}
        off = coils.keys() - on
        self.coils = self.coils - off | on

    def tare(self):
        raise AssertionError("nobody asked for a tare")

    def flash(self, channel, is_on, seconds):
        raise AssertionError("nobody asked for a flash")
