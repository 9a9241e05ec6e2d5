"""What stands behind a double's device in a fuzz: a pressure that is another one at every look, coils, no physics."""

from types import SimpleNamespace

from labctl.doubles.chamber import Mode


class RestlessPlant:
    """Takes what a plant takes; `looks` are the states that were looked at since `begin`."""

    def __init__(self, rng, channels=32):
        self.settings = SimpleNamespace(channels=channels, single_valve=False)
        self.full_scale_psi = 15.0
        self.coils = frozenset()
        self.setpoint_psi = 0.0
        self.mode = Mode.CONTROL
        self.looks = []
        self._rng = rng

    def begin(self):
        """A call begins."""
        self.looks = []

    def state(self):
        measured_psi = self._rng.uniform(0.5, 4.2)
        exhausting, holding = self.mode is Mode.EXHAUST, self.mode in (Mode.HOLD_CLOSED, Mode.HOLD_CURRENT)
        look = SimpleNamespace(
            measured_psi=measured_psi,
            setpoint_psi=self.setpoint_psi,
            requested_psi=self.setpoint_psi,
            mode=self.mode,
            exhausting=exhausting,
            holding=holding,
            flags={"EXH"} if exhausting else {"HLD"} if holding else set(),
            coils=self.coils,
        )
        self.looks.append(look)
        return look

    def write_setpoint(self, setpoint_psi, *ramp):
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
