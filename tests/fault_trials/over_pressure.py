"""Over-pressure at random moments of a rig of doubles in virtual time: how soon after the first reading it is vented.

One rig stands for many injections: the fault is switched on in the middle of something, the supervisor vents, the
fault is switched off, a person releases the latch, and the next begins.
"""

import random
import re
import struct
from dataclasses import dataclass, field, replace

from virtual_rig import VirtualRig

from labctl.doubles.chamber import Mode
from labctl.doubles.faults import Fault, Faults
from labctl.doubles.plant import STEP_S
from labctl.errors import LabError
from labctl.rig import Rig
from labctl.stop import OperatorStop

TICKS_S = 2 * 0.05
# Virtual time ends after an hour.
INJECTIONS_A_RIG = 150
LONGEST_S = 12.0
CHANNEL, DUMP_CHANNEL = 4, 16
KINDS = ("alicat-ascii", "alicat-modbus", "single valve")
STATES = (
    "opening",
    "at rest, vented",
    "following setpoint 0",
    "valves being written",
    "ramp",
    "settling",
    "hold",
    "capture",
    "on the way to SAFE",
    "between trials",
)
_GAUGE = re.compile(rb"A ([+-]\d{3}\.\d\d) ")


@dataclass
class Tally:
    """What came of the injections in one state: times from the first reading at the limit until the vent was open.

    `blind_s` counts from the true pressure, not from the reading; `earlier` were vented before any reading reached
    the limit, for another reason.
    """

    state: str
    injections: int = 0
    earlier: int = 0
    after_reading_s: list = field(default_factory=list)
    blind_s: list = field(default_factory=list)
    highest_psi: float = 0.0
    late: list = field(default_factory=list)

    @property
    def wrong(self):
        return self.late


class Watched:
    """A rig's wires and plant, with what matters written down: the first reading at the limit, and when it vented."""

    def __init__(self, kind, seed):
        single = kind == "single valve"
        self.virtual = VirtualRig(
            regulator="alicat-ascii" if single else kind,
            single_valve=single,
            dump_channel=DUMP_CHANNEL if single else None,
            seed=seed,
            # Few frames: what is tried here is pressure.
            change=lambda text: text.replace("frequency_hz = 240", "frequency_hz = 20"),
        )
        self.time, self.plant = self.virtual.time, self.virtual.plant
        self.limit_psi = self.virtual.config.limits.trip_pressure_psi
        self.platform = replace(self.virtual.platform, wires=self)
        self._single = single
        self._watch_plant()
        self.begin()

    def begin(self):
        """Forget what was seen."""
        self.read_s = self.true_s = None
        self.vented_s = self.time.now_s() if self._is_vented() else None
        self.highest_psi = 0.0

    def inject(self, rate_psi_per_s, to_psi, with_stuck_exhaust):
        """The inlet sticks open: the pressure is `to_psi` at once where that is given, and climbs."""
        chamber = self.plant._chamber
        self.plant.state()
        chamber.settings = replace(chamber.settings, overpressure_psi_per_s=rate_psi_per_s)
        faults = [Fault("overpressure")] + [Fault("stuck-exhaust")] * with_stuck_exhaust
        self.virtual.doubles.inject(Faults(regulator=tuple(faults)))
        if to_psi is not None:
            chamber.pressure_psi = to_psi

    def end_fault(self):
        self.plant.state()
        self.virtual.doubles.inject(Faults())

    def open_serial(self, port, baudrate, name):
        opened = self.virtual.doubles.wires.open_serial(port, baudrate, name)
        is_regulator = port == self.virtual.config.regulator.port
        return _TimedWire(opened, baudrate, self.time, self._hear if is_regulator else lambda _: None)

    def open_tcp(self, *where):
        return self.virtual.doubles.wires.open_tcp(*where)

    def _hear(self, gauge_psi):
        if gauge_psi >= self.limit_psi and self.read_s is None:
            self.read_s = self.time.now_s()

    def _is_vented(self):
        chamber = self.plant._chamber
        if chamber.setpoint_psi != 0:
            return False
        return DUMP_CHANNEL not in self.plant._relays.on if self._single else chamber.mode is Mode.EXHAUST

    def _watch_plant(self):
        for name in ("write_setpoint", "switch_mode", "write_coils"):
            setattr(self.plant, name, self._followed(getattr(self.plant, name)))
        chamber = self.plant._chamber
        step, origin_s = chamber.step, self.time.now_s()

        def watched_step(*arguments, **options):
            step(*arguments, **options)
            if chamber.pressure_psi >= self.limit_psi and self.true_s is None:
                self.true_s = origin_s + self.plant._steps * STEP_S
            self.highest_psi = max(self.highest_psi, chamber.pressure_psi)

        chamber.step = watched_step

    def _followed(self, act):
        def acted(*arguments):
            act(*arguments)
            self.vented_s = (self.vented_s or self.time.now_s()) if self._is_vented() else None

        return acted


class _TimedWire:
    """A serial wire on which bytes take their time; its pressures are heard as the host gets them."""

    def __init__(self, wire, baudrate, clock, hear):
        self.name = wire.name
        self._wire, self._clock, self._hear = wire, clock, hear
        self._byte_s = 10 / baudrate
        self._came = b""
        self.has_input, self.close = wire.has_input, wire.close

    def write(self, data, deadline):
        self._clock.sleep(len(data) * self._byte_s)
        self._wire.write(data, deadline)

    def read_some(self, limit, deadline):
        data = self._wire.read_some(limit, deadline)
        if data:
            self._clock.sleep(len(data) * self._byte_s)
            self._listen(data)
        return data

    def _listen(self, data):
        self._came = (self._came + data)[-200:]
        for found in _GAUGE.finditer(self._came):
            self._hear(float(found[1]))
            self._came = b""
        at = self._came.find(b"\x01\x04\x0c")
        if at >= 0 and len(self._came) >= at + 17:
            self._hear(struct.unpack(">f", self._came[at + 7 : at + 11])[0])
            self._came = b""


class Trials:
    """Injections on one rig after another; `tallies` by state."""

    def __init__(self, seed):
        self._rng = random.Random(seed)
        self._seed = seed
        self.tallies = {state: Tally(state) for state in STATES}
        self.injections = 0
        self._length_s = dict.fromkeys(STATES, 0.3)
        self._injection = None

    def run(self, injections):
        """So many more."""
        end = self.injections + injections
        while self.injections < end:
            self._one_rig(min(INJECTIONS_A_RIG, end - self.injections))
        return self

    def _one_rig(self, injections):
        kind = self._rng.choice(KINDS)
        self._seed += 1
        watched = Watched(kind, self._seed)
        try:
            rig = None
            for _ in range(injections):
                state = self._rng.choice(STATES)
                if rig is None or state == "opening":
                    if rig is not None:
                        rig.close()
                    rig = self._opened(watched, inject=state == "opening")
                if state != "opening":
                    self._one(watched, rig, state)
                rig = self._ready_again(watched, rig)
                self.injections += 1
            if rig is not None:
                rig.close()
            assert watched.time.failures == [], watched.time.failures
        finally:
            watched.virtual.close()

    def _opened(self, watched, inject):
        if inject:
            self._injected_soon(watched, "opening")
        started_s = watched.time.now_s()
        rig = None
        try:
            rig = Rig(
                watched.virtual.config, stop=OperatorStop(), notify=lambda _: None, platform=watched.platform
            )
            if inject:
                self._length_s["opening"] = watched.time.now_s() - started_s
                self._until_tripped(watched, rig)
        except LabError:
            pass
        if inject:
            self._judge(watched, rig, "opening")
        return rig

    def _one(self, watched, rig, state):
        psi = round(self._rng.uniform(0.5, 3.9), 2)
        started_s = None

        def begin():
            nonlocal started_s
            started_s = watched.time.now_s()
            self._injected_soon(watched, state)

        tripped = False
        try:
            self._do(rig, state, psi, begin)
            self._length_s[state] = max(0.02, watched.time.now_s() - started_s)
            self._until_tripped(watched, rig)
        except LabError:
            tripped = True
        # What is read on the way to SAFE may be gone by the next look.
        if not tripped and watched.read_s is not None and state != "on the way to SAFE":
            self.tallies[state].late.append(f"no trip; {self._describe(watched, rig)}")
        self._judge(watched, rig, state)

    def _do(self, rig, state, psi, begin):
        """Bring the rig to the state, say `begin`, and do what is done in it."""
        rig.make_safe()
        if state in ("at rest, vented", "between trials"):
            if state == "between trials":
                self._inflate(rig, psi)
                rig.make_safe()
            begin()
            rig.wait(1.0)
            return
        if state == "valves being written":
            rig.start_control()
            rig.write_setpoint(psi)
            rig.wait(0.5)
            begin()
            rig.jam({CHANNEL})
            rig.jam(())
            rig.jam({CHANNEL})
            return
        rig.jam({CHANNEL})
        rig.start_control()
        if state == "following setpoint 0":
            begin()
            rig.wait(1.0)
            return
        if state == "ramp":
            begin()
            rig.ramp_to(psi, lambda _: None)
            return
        rig.write_setpoint(psi)
        if state == "settling":
            begin()
            rig.wait(psi)
            return
        rig.wait(psi / 1.5 + 0.3)
        begin()
        if state == "hold":
            rig.wait(1.0)
        elif state == "capture":
            rig.capture(1.0)
        else:
            rig.make_safe()

    def _inflate(self, rig, psi):
        rig.jam({CHANNEL})
        rig.start_control()
        rig.write_setpoint(psi)
        rig.wait(psi / 1.5 + 0.3)

    def _injected_soon(self, watched, state):
        """The fault comes at a random moment of this state, as long as it took the last time."""
        rng = self._rng
        delay_s = rng.uniform(0.0, self._length_s[state])
        short = state in ("opening", "valves being written", "on the way to SAFE")
        jumps = short or rng.random() < 0.4
        to_psi = rng.uniform(watched.limit_psi, 8.0) if jumps else None
        rate_psi_per_s = 10 ** rng.uniform(0.0, 1.3)
        vented = state in ("at rest, vented", "between trials", "on the way to SAFE", "opening")

        def run():
            watched.time.sleep(delay_s)
            watched.begin()
            watched.inject(rate_psi_per_s, to_psi, vented)

        self._injection = watched.time.start_thread(run, "the test's fault")

    def _until_tripped(self, watched, rig):
        end_s = watched.time.now_s() + LONGEST_S
        while watched.time.now_s() < end_s:
            rig.wait(0.1)

    def _judge(self, watched, rig, state):
        """Let the vent come to its own, then write down when it came."""
        # A rig that another rule refused or closed sooner does not keep the fault from beginning.
        assert self._injection.join(LONGEST_S)
        tally = self.tallies[state]
        tally.injections += 1
        end_s = watched.time.now_s() + 1.0
        while watched.vented_s is None and watched.time.now_s() < end_s:
            watched.time.sleep(0.005)
        watched.end_fault()
        tally.highest_psi = max(tally.highest_psi, watched.highest_psi)
        if watched.vented_s is None:
            tally.late.append(f"never vented; {self._describe(watched, rig)}")
        elif watched.read_s is None:
            tally.earlier += 1
        else:
            after_s = max(0.0, watched.vented_s - watched.read_s)
            tally.after_reading_s.append(after_s)
            if watched.true_s is not None:
                tally.blind_s.append(max(0.0, watched.vented_s - watched.true_s))
            if after_s > TICKS_S:
                tally.late.append(f"{after_s:.3f} s; {self._describe(watched, rig)}")

    def _describe(self, watched, rig):
        reason = rig._supervisor.trip_reason if rig is not None else "no rig"
        return f"seed {self._seed}, reason {reason}, read {watched.read_s}, vented {watched.vented_s}"

    def _ready_again(self, watched, rig):
        """The latch released, or the rig opened anew where it cannot be."""
        if rig is None:
            watched.time.sleep(3.0)
            return None
        try:
            rig.reset()
        except LabError:
            watched.time.sleep(3.0)
            rig.reset()
        return rig


def over_pressure(seed, injections):
    """So many injections; a tally for each state."""
    return list(Trials(seed).run(injections).tallies.values())
