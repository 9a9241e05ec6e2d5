"""A rig's instruments, opened, identified and closed together; nothing is energised here.

Opening looks at what is known to be zero: the gauge of a rig that is vented. A regulator in control steers its own
reading to 0, true or not; so the exhaust is opened for it or, where there is none, the regulator shut meanwhile.
"""

import logging
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass

from labctl.clock import Clock, Scheduler
from labctl.config.rig import RigConfig
from labctl.drivers.opening import open_gauge, open_markers
from labctl.errors import InstrumentError, LabError, RigUnavailable
from labctl.instruments.interfaces import PressureGauge
from labctl.instruments.readings import Identity, PressureReading
from labctl.links.wires import Wires
from labctl.rig.as_found import open_as_found
from labctl.rig.marker_feed import MarkerFeed
from labctl.safety.guard import Guard
from labctl.safety.second_gauge import SecondGauge
from labctl.safety.zero import GaugeSection, no_gas_in, wait_for_zero, zero_problem
from labctl.stop import StopRequest

_LOG = logging.getLogger("labctl.rig")


@dataclass(frozen=True)
class Identities:
    """Who answered when the rig was opened."""

    regulator: Identity
    valves: Identity
    markers: Identity
    gauge: Identity | None = None

    def by_instrument(self) -> dict[str, Identity]:
        """Each by the name of its section in rig.toml."""
        three = {"regulator": self.regulator, "valves": self.valves, "markers": self.markers}
        return three if self.gauge is None else {**three, "gauge": self.gauge}


class RigInstruments:
    """Regulator, valve bank, marker stream and any second gauge of one rig; each has identified itself.

    A rig that is found with pressure, a setpoint or valves on was left so by something else: it is taken to
    SAFE before anything else is done. Frames are stamped by `clock`, the rig's; all else is timed by the wall's.
    `venting` is entered meanwhile. `zero_psi` is what the gauge read with the way out open, the
    mean of half a second.

    Raises:
        Unsafe: it was found energised and SAFE could not be read back.
        RigUnavailable: one is absent, silent, or not what rig.toml states, or the gauge does not read 0 where the
            pressure must be 0; labctl energised nothing, and what was found energised was taken to SAFE.
        Stopped: the operator requested a stop while they were being opened.
    """

    def __init__(
        self,
        config: RigConfig,
        scheduler: Scheduler,
        wires: Wires,
        clock: Clock,
        stop: StopRequest,
        notify: Callable[[str], None],
        guard: Guard,
        venting: Callable[[], AbstractContextManager[None]],
    ) -> None:
        with ExitStack() as opened:
            found = open_as_found(config, scheduler, wires, opened, notify, guard, venting)
            self.regulator, self.valves = found.regulator, found.valves
            try:
                stop.check()
                # For both gauges: a regulator in control would fill the sheet by what its own zero lacks.
                with no_gas_in(self.regulator):
                    self.zero_psi = _read_zero(self.regulator, "regulator", config, clock, stop)
                    self.second_gauge, gauge_identity = self._open_gauge(
                        config, scheduler, wires, clock, stop
                    )
                    if self.second_gauge is not None:
                        opened.callback(self.second_gauge.close)
                markers = open_markers(config.markers, scheduler, clock, wires)
                opened.callback(markers.close)
                stop.check()
                self.identities = Identities(
                    self.regulator.identify(), self.valves.identify(), markers.identify(), gauge_identity
                )
                _require_as_configured(self.identities.regulator, config)
                for name, identity in self.identities.by_instrument().items():
                    _LOG.info("%s: %s", name, identity.describe())
                markers.start()
            except InstrumentError as error:
                raise RigUnavailable(f"{error}. {found.words} ({config.source})") from error
            self.feed = MarkerFeed(markers, scheduler)
            opened.callback(self.feed.close)
            self.feed.start()
            self._opened = opened.pop_all()

    def _open_gauge(
        self, config: RigConfig, scheduler: Scheduler, wires: Wires, clock: Clock, stop: StopRequest
    ) -> tuple[SecondGauge | None, Identity | None]:
        """The second gauge, at zero as the first one; call it while no gas comes in."""
        if config.gauge is None:
            return None, None
        gauge = open_gauge(config.gauge, config.limits, scheduler, wires)
        try:
            identity = gauge.identify()
            limits = config.limits.for_zero(_read_zero(gauge, "gauge", config, clock, stop))
        except BaseException:
            gauge.close()
            raise
        return SecondGauge(gauge, self.regulator.name, limits, clock, scheduler), identity

    def close(self, notify: Callable[[str], None]) -> None:
        """Give every link back; `notify` gets what fails on the way. May be called twice."""
        _LOG.info("closing every link")
        try:
            self._opened.close()
        except LabError as error:
            notify(f"closing: {error}")


def _read_zero(
    gauge: PressureGauge, section: GaugeSection, config: RigConfig, clock: Clock, stop: StopRequest
) -> float:
    """What a gauge reads with the way out open and no gas coming in, in psi.

    Raises:
        InstrumentError: it is not 0, from either side; with the causes.
        Stopped: the operator requested a stop.
    """

    def read() -> PressureReading:
        stop.check()
        return gauge.read()

    reading = wait_for_zero(read, config.limits, clock)
    assert reading is not None  # noqa: S101 - `read` raises where it cannot
    problem = zero_problem(reading.gauge_psi, config.limits, section=section)
    if problem is not None:
        raise InstrumentError(f"{gauge.name}: {problem}")
    return reading.gauge_psi


def _require_as_configured(regulator: Identity, config: RigConfig) -> None:
    if config.regulator.model == "PCD" and regulator.model.startswith("PC-"):
        raise InstrumentError(
            f"{config.regulator.name} calls itself {regulator.model}, a single-valve PC that cannot exhaust, and "
            "regulator.model is PCD; correct it and give the rig a dump valve (valves.dump_channel)"
        )
    if config.regulator.unit_proof() is None:
        raise InstrumentError(
            f"{config.regulator.name} does not tell its unit over Modbus, and nothing proves that it is "
            f"{config.regulator.pressure_unit}: a device in bar would take 3.9 for 57 psi. Look at its display or "
            "ask it over ASCII (??D*), then write how that was done into regulator.pressure_unit_proven"
        )
    if regulator.setpoint_source == "analog":
        raise InstrumentError(
            f"{config.regulator.name} takes its setpoint from its analog input and would ignore ours; set its "
            "setpoint source to serial on its front panel"
        )
