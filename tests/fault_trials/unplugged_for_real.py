"""The same on this machine's pseudo-terminals, sockets and guard process, in real time: a few dozen cycles.

An adapter that is plugged in again is another terminal (another name under /dev); the rig.toml names a link to it, as
/dev/serial/by-id does.
"""

import random
import tempfile
from contextlib import ExitStack
from pathlib import Path

from bowl import DESIGN, Bowl

from fault_trials.unplugged import Breaks, as_a_real_rig
from labctl.clock import WallClock
from labctl.config.load import rig_from_text
from labctl.doubles.phasespace_server import PhaseSpaceServer
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from labctl.doubles.simulated_rig import SimulatedRig
from labctl.doubles.transports import listen, serve_pty, serve_tcp
from labctl.rig.platform import SYSTEM
from labctl.session.held import held
from labctl.stop import OperatorStop

_TICK_S = 0.005


class PluggedDoubles:
    """Doubles whose servers can be taken away and brought back; also what `Breaks` takes for its cables."""

    def __init__(self, folder, settings):
        self.time = WallClock()
        self._rig = SimulatedRig(settings, self.time, Bowl())
        self.plant = self._rig.plant
        self.plant.start(_TICK_S)
        self._settings, self._folder = settings, folder
        # A serial device keeps its line, whoever opens the port.
        self._lines = {"regulator": self._rig.regulator_line(), "valves": self._rig.valves_line()}
        self._servers = {}
        # Beyond what the system gives away by itself: nobody takes it while it is unplugged.
        self._tcp_ports = {name: _free_port() for name in ("valves", "markers")}
        self.names_seen = set()
        for instrument in ("regulator", "valves", "markers"):
            self.put_back(instrument)
        valves = (
            str(self._port("valves"))
            if settings.valve_transport == "rtu"
            else f"127.0.0.1:{self._tcp_ports['valves']}"
        )
        text = rig_toml(
            settings, str(self._port("regulator")), valves, "127.0.0.1", self._tcp_ports["markers"] - 8000
        )
        self.config = rig_from_text(as_a_real_rig(text), "rig.toml")
        self.platform = SYSTEM
        self.guards = []

    def pull(self, instrument, way):
        # The system takes the link away with the adapter: the terminal it named may be another's a moment later.
        self._port(instrument).unlink(missing_ok=True)
        self._servers.pop(instrument).close()

    def put_back(self, instrument):
        faults = self._rig.line_faults
        if instrument == "markers":
            server = PhaseSpaceServer(self._rig.markers, self.time, listen(port=self._tcp_ports["markers"]))
        elif instrument == "valves" and self._settings.valve_transport == "tcp":
            server = serve_tcp(
                "valves",
                self._rig.valves_line,
                faults["valves"],
                self.time,
                listen(port=self._tcp_ports["valves"]),
            )
        else:
            server = serve_pty(instrument, self._lines[instrument], faults[instrument], self.time)
            self.names_seen.add(server.address)
            self._port(instrument).unlink(missing_ok=True)
            self._port(instrument).symlink_to(server.address)
        self._servers[instrument] = server

    def close(self):
        for server in self._servers.values():
            server.close()
        self._rig.close()

    def _port(self, instrument):
        return self._folder / f"by-id-{instrument}"


class RealBreaks(Breaks):
    """Breaks of one link on this machine; the adapter's way alone."""

    ways = ("adapter",)
    longest_out_s = 4.0

    def _opened(self, virtual):
        """Held first, as commands and `labctl.api` do it: a guard that is venting has the ports until it is done."""
        with ExitStack() as holding:
            holding.enter_context(held(virtual.config, OperatorStop(), virtual.platform, lambda _: None))
            rig = super()._opened(virtual)
            let_go = holding.pop_all()
        close = rig.close

        def closed():
            try:
                return close()
            finally:
                let_go.close()

        rig.close = closed
        return rig

    def _one_rig(self, cycles):
        with tempfile.TemporaryDirectory(prefix="labctl-unplugged-") as folder:
            doubles = PluggedDoubles(Path(folder), DoublesSettings(DESIGN, seed=self._seed, **self._settings))
            try:
                for _ in range(cycles):
                    self._one(doubles, doubles)
            finally:
                doubles.close()


def _free_port():
    for port in random.SystemRandom().sample(range(20_000, 30_000), 50):
        try:
            listen(port=port).close()
        except OSError:
            continue
        return port
    raise OSError("no free port between 20000 and 30000")
