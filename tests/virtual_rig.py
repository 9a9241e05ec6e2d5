"""A rig of doubles in virtual time: real drivers and links, byte by byte, in the test's own process."""

from bowl import DESIGN, Bowl
from virtual_holders import VirtualHolders
from virtual_time import VirtualTime

from labctl.config.load import rig_from_text
from labctl.doubles.faults import parse_faults
from labctl.doubles.in_process import InProcessDoubles
from labctl.doubles.settings import DoublesSettings
from labctl.rig.platform import Platform
from labctl.safety.guard import BEAT, ENERGISED, SAFE, STAND_DOWN
from labctl.safety.guard_heart import watch
from labctl.safety.guard_process import take_to_safe
from labctl.safety.reach import Reach


class VirtualGuard:
    """The guard's heart in the test's own process; `killed` is how a guard that died looks."""

    def __init__(self, config, time, wires, holders):
        self._config, self._time, self._wires, self._holders = config, time, wires, holders
        self._arrived = time.event()
        self._bytes = b""
        self._gone = False
        self.killed = False
        self.hangs = 0
        self.sent = b""
        self.notes = []
        self.report = None
        self._thread = time.start_thread(self._run, "guard")

    def wait_armed(self):
        pass

    def ended(self, within_s):
        """Whether it has ended, given so long."""
        return self._thread.join(within_s)

    def alive(self):
        return self._thread.is_alive() and not self.killed

    def beat(self):
        self._send(BEAT)

    def energised(self):
        self._send(ENERGISED)

    def safe(self):
        self._send(SAFE)

    def stand_down(self):
        self._send(STAND_DOWN)

    def release(self):
        self._gone = True
        self._arrived.set()

    def _send(self, data):
        self._bytes += data
        self.sent += data
        self._arrived.set()

    def _receive(self, timeout_s):
        if not self._bytes and not self._gone:
            self._arrived.wait(timeout_s)
        self._arrived = self._time.event()
        data, self._bytes = self._bytes, b""
        return data if data or self._gone else None

    def _hang(self):
        self.hangs += 1

    def _run(self):
        if watch(self._receive, self._hang) and not self.killed:
            reach = Reach.of(self._config)
            self.report = take_to_safe(
                reach, self._time, self._wires, self._holders, self.notes.append, lambda: None
            )


class VirtualRig:
    """Doubles of a rig in virtual time, their `config`, and the `platform` on which the rig is opened.

    `faults` in the words of `labctl doubles serve --fault`; `change` may rewrite the rig.toml.
    """

    def __init__(self, *faults, design=DESIGN, shapes=None, change=lambda text: text, **settings):
        self.time = VirtualTime()
        self.doubles = InProcessDoubles(
            DoublesSettings(design, faults=parse_faults(faults), **settings), self.time, shapes or Bowl()
        )
        self.text = change(self.doubles.rig_toml())
        self.config = rig_from_text(self.text, "rig.toml")
        self.guards = []
        self.holders = VirtualHolders(self.time)
        self.platform = Platform(self.time, self.doubles.wires, self._start_guard, self.holders)

    @property
    def plant(self):
        return self.doubles.plant

    def close(self):
        self.doubles.close()

    def assert_safe(self):
        """SAFE by the plant's truth."""
        state = self.plant.state()
        assert state.setpoint_psi == 0
        assert state.exhausting or self.doubles.settings.single_valve
        assert state.pressure_psi < 0.3
        assert not state.coils

    def _start_guard(self, config):
        self.guards.append(VirtualGuard(config, self.time, self.doubles.wires, self.holders))
        return self.guards[-1]
