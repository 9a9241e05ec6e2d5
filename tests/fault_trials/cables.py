"""Wires of doubles in virtual time whose cables can be pulled and put back."""

from labctl.errors import LinkDown, NoAnswer

#: How a link goes: its adapter leaves the computer (or its server the network), or the cable behind it is pulled.
WAYS = ("adapter", "cable")


class Cables:
    """`labctl.links.wires.Wires` over those of doubles; each instrument hangs on one cable."""

    def __init__(self, wires, config, clock):
        self._wires, self._clock = wires, clock
        self._regulator_port = config.regulator.port
        self._valves_tcp_port = config.valves.tcp_port
        self._out = {}
        self._opened = []

    def pull(self, instrument, way):
        self._out[instrument] = way
        for port in self._opened:
            if port.instrument == instrument and way == "adapter":
                port.break_off()

    def put_back(self, instrument):
        """What a network kept for a connection that still stands, or was closed in order, now arrives."""
        del self._out[instrument]
        for port in self._opened:
            if port.instrument == instrument:
                port.deliver_kept()

    def is_out(self, instrument):
        return instrument in self._out

    def open_serial(self, port, baudrate, name):
        instrument = "regulator" if port == self._regulator_port else "valves"
        if self._out.get(instrument) == "adapter":
            raise LinkDown(f"{name} on {port}: there is no such port")
        return self._kept(PulledPort(self._wires.open_serial(port, baudrate, name), instrument, self))

    def open_tcp(self, host, port, clock, name, connect_timeout_s):
        instrument = "valves" if port == self._valves_tcp_port else "markers"
        if instrument in self._out:
            if self._out[instrument] == "cable":
                self._clock.sleep(connect_timeout_s)
            raise LinkDown(f"{name} on {host}:{port}: no connection within {connect_timeout_s:g} s")
        wire = self._wires.open_tcp(host, port, clock, name, connect_timeout_s)
        return self._kept(PulledStream(wire, instrument, self))

    def _kept(self, port):
        self._opened = [each for each in self._opened if each.is_of_use()] + [port]
        return port


class PulledPort:
    """A serial port. With the cable out bytes are lost; with the adapter out the port is gone for good."""

    def __init__(self, wire, instrument, cables):
        self.name, self.clock, self.instrument = wire.name, wire.clock, instrument
        self._wire, self._cables = wire, cables
        self._broken = self._closed = False

    def is_of_use(self):
        return not (self._broken or self._closed)

    def break_off(self):
        self._broken = True
        self._wire.close()

    def deliver_kept(self):
        pass

    def write(self, data, deadline):
        self._require_whole()
        if not self._cables.is_out(self.instrument):
            self._wire.write(data, deadline)

    def read_some(self, limit, deadline):
        self._require_whole()
        while self._cables.is_out(self.instrument):
            remaining_s = deadline.remaining_s()
            if remaining_s <= 0:
                return b""
            self.clock.sleep(min(0.02, remaining_s))
            self._require_whole()
        return self._wire.read_some(limit, deadline)

    def has_input(self):
        self._require_whole()
        return not self._cables.is_out(self.instrument) and self._wire.has_input()

    def close(self):
        self._closed = True
        self._wire.close()

    def _require_whole(self):
        if self._broken or self._closed:
            raise LinkDown(f"{self.name}: the port broke")


class PulledStream(PulledPort):
    """A TCP connection. With the cable out what is sent is kept and arrives later, unless it was broken off."""

    def __init__(self, wire, instrument, cables):
        super().__init__(wire, instrument, cables)
        self._kept = []

    def is_of_use(self):
        return not self._broken and (not self._closed or self._cables.is_out(self.instrument))

    def send(self, data, deadline):
        self._require_whole()
        if self._cables.is_out(self.instrument):
            self._kept.append(data)
        else:
            self._wire.send(data, deadline)

    def deliver_kept(self):
        kept, self._kept = self._kept, []
        if not self._broken:
            for data in kept:
                self._wire.send(data, None)
        if self._closed:
            self._wire.close()

    def read_exactly(self, n, deadline):
        data = self.peek(n, n, deadline)
        self.skip(n)
        return data

    def peek(self, n, most, deadline):
        while True:
            self._require_whole()
            remaining_s = deadline.remaining_s()
            if not self._cables.is_out(self.instrument):
                return self._wire.peek(n, most, deadline)
            if remaining_s <= 0:
                raise NoAnswer(f"{self.name}: nothing comes")
            self.clock.sleep(min(0.02, remaining_s))

    def skip(self, n):
        self._wire.skip(n)

    def abort(self):
        self._kept.clear()
        self.close()

    def close(self):
        self._closed = True
        # The other end cannot learn of it before.
        if self._broken or not self._cables.is_out(self.instrument):
            self._wire.close()
