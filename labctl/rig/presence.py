"""How a command that holds a rig is seen and reached from other terminals: its state, and what is asked of it.

The state is put together when somebody asks for it, on the thread that answers: publishing costs the control loop an
assignment, and waits for nobody.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Literal

from labctl.config.rig import RigConfig
from labctl.holder.records import VERSION, Holder, Request, RigState, SafeReading
from labctl.rig.platform import Platform
from labctl.rig.rig import Rig
from labctl.safety.reach import PERHAPS_IN_USE, Reach, open_and_make_safe
from labctl.safety.safe_state import SafeReport
from labctl.stop import StopRequest

_BUSY_S = 5.0
_FINISH_S = 30.0

Phase = Literal["closed", "opening", "open"]


class Presence:
    """Answers for one command that holds a rig.

    A request to vent sets the command's stop, and takes the rig to SAFE without waiting for the command: by the open
    rig, or by opening the ports where the command has none open. While it is opening them, the rig is taken to SAFE
    as soon as it is open, or by `finish` where that never comes.

    Args:
        holder: who holds the rig.
        config: the rig.
        stop: the command's request to stop.
        platform: time and wires.
        notify: receives one line of text for the command's own terminal; must not wait for anybody.
    """

    def __init__(
        self,
        holder: Holder,
        config: RigConfig,
        stop: StopRequest,
        platform: Platform,
        notify: Callable[[str], None],
    ) -> None:
        self._holder = holder
        self._reach = Reach.of(config)
        self._stop = stop
        self._platform = platform
        self._notify = notify
        self._start_s = platform.scheduler.now_s()
        self._lock = platform.scheduler.lock()
        # Until the command says otherwise it may be opening ports.
        self._phase: Phase = "opening"
        self._rig: Rig | None = None
        self._steps = ("", "")
        self._protocol: tuple[str, int] | None = None
        self._trial: tuple[int, int] | None = None
        self._asked_by: str | None = None
        self._read_back: SafeReport | None = None
        self._vent_ended = platform.scheduler.event()
        self._venting = False
        self._on_the_way = False

    @property
    def may_be_open(self) -> bool:
        """Whether the command has a port open, or may be opening one."""
        return self._phase != "closed"

    def show(self, step: str, detail: str = "") -> None:
        """What the command does now."""
        self._steps = (step, detail)

    def show_run(self, protocol: str, run: int) -> None:
        """Which run it is."""
        self._protocol = (protocol, run)

    def show_trial(self, number: int, planned: int) -> None:
        """Which trial it is, of how many."""
        self._trial = (number, planned)

    def show_read_back(self, report: SafeReport) -> None:
        """What the command itself has read on the way to SAFE: the answer to whoever asked meanwhile."""
        self._read_back = report

    @contextmanager
    def venting(self) -> Iterator[None]:
        """While inside, the command takes the rig to SAFE of its own accord, and has the time that this takes."""
        self._on_the_way = True
        try:
            yield
        finally:
            self._on_the_way = False

    def closed(self) -> None:
        """From now on the command has no port open."""
        self._rig = None
        self._phase = "closed"

    def opening(self) -> None:
        """From now on the command may have ports open.

        Raises:
            Stopped: the rig was vented from outside; nothing may be opened any more.
        """
        with self._lock:
            self._stop.check()
            self._phase = "opening"

    def opened(self, rig: Rig) -> None:
        """From now on `rig` is open; whoever has asked meanwhile gets it vented."""
        with self._lock:
            self._rig, self._phase = rig, "open"
            if self._asked_by is not None:
                self._vent_aside(self._asked_by)

    def request(self, word: Literal["vent", "abort"], request: Request) -> None:
        """Stop the command and vent; returns at once."""
        cause = f"labctl {word} from another terminal (process {request.pid}, {request.user})"
        with self._lock:
            self._stop.set(cause)
            self._asked_by = cause
            if not self._venting:
                self._read_back = None
            if self._phase != "opening":
                self._vent_aside(cause)
        self._notify(f"asked by {cause} to take the rig to SAFE")

    def finish(self) -> None:
        """Give whoever has asked their answer before the rig is let go; waits for what they have begun."""
        if self._venting:
            self._vent_ended.wait(_FINISH_S)
        if self._asked_by is not None and self._read_back is None:
            with self.venting():
                self._read_back = self._vent_by_ports()
        self.closed()

    def state(self) -> RigState:
        """The latest of everything."""
        rig, sight = self._rig, None
        if rig is not None:
            sight = rig.sight
        pressure = sight.pressure() if sight else None
        markers = sight.markers() if sight else None
        reading, age_s = pressure or (None, None)
        seen, of, marker_age_s = markers or (None, None, None)
        protocol, run = self._protocol or (None, None)
        trial, trials = self._trial or (None, None)
        step, detail = self._steps
        channels_on = rig.channels_on if rig else None
        return RigState(
            version=VERSION,
            holder=self._holder,
            phase=self._phase,
            elapsed_s=self._platform.scheduler.now_s() - self._start_s,
            step=step,
            detail=detail,
            protocol=protocol,
            run=run,
            trial=trial,
            trials=trials,
            pressure_psi=reading.gauge_psi if reading else None,
            setpoint_psi=reading.setpoint_psi if reading else None,
            flags=tuple(sorted(reading.status)) if reading else (),
            reading_age_s=age_s,
            channels_on=None if channels_on is None else tuple(sorted(channels_on)),
            markers_seen=seen,
            markers=of,
            marker_age_s=marker_age_s,
            safe=_as_reading(rig.safe_report if rig else None),
            asked_by=self._asked_by,
            read_back=_as_reading(self._read_back),
            venting=self._on_the_way,
        )

    def _vent_aside(self, cause: str) -> None:
        """Vent on a thread of its own; call with the lock held."""
        if self._venting:
            return
        self._venting = True
        self._vent_ended = self._platform.scheduler.event()
        self._platform.scheduler.start_thread(lambda: self._vent(cause), "vent for another terminal")

    def _vent(self, cause: str) -> None:
        rig = self._rig
        try:
            # An exception is no answer: `finish` tries again, and whoever waits takes over.
            with suppress(Exception):
                self._read_back = rig.vent_for(cause) if rig is not None else self._vent_by_ports()
        finally:
            self._venting = False
            self._vent_ended.set()

    def _vent_by_ports(self) -> SafeReport:
        return open_and_make_safe(
            self._reach,
            self._platform.scheduler,
            self._platform.wires,
            patience_s=_BUSY_S,
            patient_with=PERHAPS_IN_USE,
            notify=self._notify,
        )


def _as_reading(report: SafeReport | None) -> SafeReading | None:
    if report is None:
        return None
    channels_on = None if report.channels_on is None else tuple(sorted(report.channels_on))
    return SafeReading(
        report.pressure_psi,
        report.setpoint_psi,
        report.vented_by,
        channels_on,
        report.problems,
        report.only_zero_is_off,
    )
