"""Links that break in the middle of a hold and come back: what the rig does, and how soon it can be used again."""

import random
from dataclasses import dataclass, field, replace

from virtual_rig import VirtualRig

from fault_trials.cables import WAYS, Cables
from labctl.doubles.chamber import Mode
from labctl.errors import LabError, Unsafe
from labctl.rig import Rig
from labctl.stop import OperatorStop

BACK_S = 3.0
CHANNEL = 4
CYCLES_A_RIG = 40
# Patience with a rig that does not open; `BACK_S` is what is asked.
_GIVE_UP_S = 30.0
_TRIES = 5
_TOLERANCE_PSI = 0.05

LINKS = {
    "regulator (alicat-ascii)": ("regulator", {}),
    "regulator (alicat-modbus)": ("regulator", {"regulator": "alicat-modbus"}),
    "valves rtu": ("valves", {}),
    "valves tcp": ("valves", {"valve_transport": "tcp"}),
    "markers": ("markers", {}),
}


@dataclass
class Tally:
    """What came of the cycles of one link. Times in seconds of the rig's clock.

    `vented_s` from the break until the regulator was vented, by the plant's truth, where that could be before the
    return; `ended_s` until the command in hand had ended with an error; `back_s` from the return until the rig was
    open and read right. `wrong` holds what must not be.
    """

    link: str
    cycles: int = 0
    endings: dict = field(default_factory=dict)
    safe_at_once: int = 0
    safe_by_guard: int = 0
    vented_s: list = field(default_factory=list)
    ended_s: list = field(default_factory=list)
    back_s: list = field(default_factory=list)
    wrong: list = field(default_factory=list)


def as_a_real_rig(text):
    """The doubles' rig.toml, with few frames; a guard tries again for a rig that is not simulated only."""
    return text.replace("frequency_hz = 240", "frequency_hz = 60").replace(
        "simulated = true", "simulated = false"
    )


class Breaks:
    """Breaks of one link on rigs of doubles in virtual time."""

    ways = WAYS
    longest_out_s = 15.0

    def __init__(self, link, seed):
        self._instrument, self._settings = LINKS[link]
        self._rng = random.Random(seed)
        self._seed = seed
        self.tally = Tally(link)

    def run(self, cycles):
        """So many more."""
        while self.tally.cycles < cycles:
            self._one_rig(min(CYCLES_A_RIG, cycles - self.tally.cycles))
        return self.tally

    def _one_rig(self, cycles):
        self._seed += 1
        virtual = VirtualRig(
            seed=self._seed,
            change=as_a_real_rig,
            **self._settings,
        )
        cables = Cables(virtual.doubles.wires, virtual.config, virtual.time)
        virtual.platform = replace(virtual.platform, wires=cables)
        try:
            for _ in range(cycles):
                self._one(virtual, cables)
            assert virtual.time.failures == [], virtual.time.failures
        finally:
            virtual.close()

    def _one(self, virtual, cables):
        tally, clock, way = self.tally, virtual.time, self._rng.choice(self.ways)
        tally.cycles += 1
        deeds = Deeds(virtual.plant, clock)
        pulled_s = self._hold_until_broken(virtual, cables, way, deeds)
        clock.sleep(self._rng.uniform(0.0, self.longest_out_s))
        cables.put_back(self._instrument)
        back_s = clock.now_s()
        # Nobody touches it for a moment: whatever a connection that stands again delivers, it delivers now.
        untouched_s = self._rng.choice((0.0, 0.0, 1.0))
        clock.sleep(untouched_s)
        if deeds.energising:
            self._wrong(f"{way}: after the break {deeds.energising}")
        deeds.end()
        opened_s = self._opened_again(virtual, way)
        if opened_s is not None:
            tally.back_s.append(opened_s - back_s - untouched_s)
            if opened_s - back_s - untouched_s > BACK_S:
                self._wrong(
                    f"{way}: usable {opened_s - back_s:.2f} s after it came back, broken at {pulled_s:.2f}"
                )
        for guard in virtual.guards:
            if not guard.ended(30):
                self._wrong(f"{way}: a guard still waits")
        virtual.guards.clear()

    def _hold_until_broken(self, virtual, cables, way, deeds):
        clock, tally = virtual.time, self.tally
        pulled_s = None

        def pull():
            nonlocal pulled_s
            clock.sleep(self._rng.uniform(0.0, 1.5))
            pulled_s = clock.now_s()
            deeds.begin()
            cables.pull(self._instrument, way)

        ended = "nothing"
        try:
            with self._held(virtual) as rig:
                clock.start_thread(pull, "the test's hand")
                for _ in range(20):
                    rig.wait(0.1)
                    rig.capture(0.3)
                self._wrong(f"{way}: the run went on for 8 s without its {self._instrument}")
        except LabError as error:
            unsafe = isinstance(error, Unsafe)
            ended = type(error.__cause__ or error).__name__ if unsafe else type(error).__name__
            ended += ", UNSAFE reported" if unsafe else ", SAFE read back"
        ended_s = clock.now_s()
        while pulled_s is None:
            clock.sleep(0.05)
        tally.ended_s.append(ended_s - pulled_s)
        if deeds.vented_s is not None:
            tally.vented_s.append(deeds.vented_s - pulled_s)
        tally.endings[ended] = tally.endings.get(ended, 0) + 1
        tally.safe_at_once += _is_safe(virtual.plant)
        return pulled_s

    def _held(self, virtual):
        """The rig, open, with the sheet inflated; tried again where a busy computer is refused."""
        psi = round(self._rng.uniform(0.6, 2.0), 2)
        tries_left = _TRIES
        while True:
            tries_left -= 1
            try:
                rig = self._opened(virtual)
                try:
                    rig.jam({CHANNEL})
                    rig.start_control()
                    rig.write_setpoint(psi)
                    rig.wait(psi / 1.5 + 0.5)
                except BaseException:
                    rig.close()
                    raise
                return rig
            except LabError:
                if not tries_left:
                    raise

    def _opened_again(self, virtual, way):
        """Open the rig as a person does, again and again; when it was open and read right."""
        clock = virtual.time
        end_s = clock.now_s() + _GIVE_UP_S
        self.tally.safe_by_guard += _is_safe(virtual.plant)
        while True:
            try:
                with self._opened(virtual) as rig:
                    opened_s = self._reads_right(virtual, rig, way)
                    if not _is_safe(virtual.plant, pressure=False):
                        self._wrong(f"{way}: opened again and not SAFE: {virtual.plant.state()}")
                return opened_s
            except LabError as error:
                if clock.now_s() > end_s:
                    self._wrong(f"{way}: does not open again: {error}")
                    return None
                clock.sleep(0.1)

    def _reads_right(self, virtual, rig, way):
        gauge_psi = rig.pressure().gauge_psi
        state = virtual.plant.state()
        on = rig._instruments.valves.read()
        rig.capture(0.1)
        opened_s = virtual.time.now_s()
        rig.make_safe()
        if abs(gauge_psi - state.pressure_psi) > _TOLERANCE_PSI or on != state.coils:
            self._wrong(f"{way}: reads {gauge_psi} psi and {sorted(on)}, the truth is {state}")
        return opened_s

    def _opened(self, virtual):
        return Rig(virtual.config, stop=OperatorStop(), notify=lambda _: None, platform=virtual.platform)

    def _wrong(self, what):
        self.tally.wrong.append(f"cycle {self.tally.cycles}, {what}")


class Deeds:
    """What is done to the plant; between `begin` and `end` nothing may be energised. `vented_s`: it was vented."""

    def __init__(self, plant, clock):
        self.energising = []
        self.vented_s = None
        self._plant, self._clock = plant, clock
        self._watches = False
        for name, energises in (
            ("write_setpoint", lambda setpoint_psi: setpoint_psi > 0),
            ("switch_mode", lambda mode: mode is not Mode.EXHAUST),
            ("write_coils", lambda coils: any(coils.values())),
        ):
            setattr(plant, name, self._watched(name, getattr(type(plant), name), energises))

    def begin(self):
        self._watches = True

    def end(self):
        self._watches = False

    def _watched(self, name, act, energises):
        def acted(what, *how):
            if self._watches and energises(what):
                self.energising.append(f"{name} {what}")
            act(self._plant, what, *how)
            state = self._plant.state()
            if self._watches and self.vented_s is None and state.exhausting and state.setpoint_psi == 0:
                self.vented_s = self._clock.now_s()

        return acted


def _is_safe(plant, pressure=True):
    state = plant.state()
    calm = not pressure or state.pressure_psi < 0.3
    return state.setpoint_psi == 0 and state.exhausting and not state.coils and calm
