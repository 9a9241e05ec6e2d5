"""From configuration to drivers: the one place that knows which class a `driver = ...` line means."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from labctl.clock import Clock, Scheduler
from labctl.config.rig import GaugeConfig, Limits, MarkersConfig, RegulatorConfig, ValvesConfig
from labctl.drivers.alicat_ascii import AlicatAscii
from labctl.drivers.alicat_modbus import AlicatModbus
from labctl.drivers.phasespace import PhaseSpace
from labctl.drivers.waveshare_relay import WaveshareRelay
from labctl.instruments.interfaces import MarkerSource, PressureGauge, PressureRegulator, ValveBank
from labctl.links.modbus_link import open_modbus_serial, open_modbus_tcp
from labctl.links.serial_link import open_serial_link
from labctl.links.wires import SYSTEM_WIRES, Wires

_PHASESPACE_BASE_PORT = 8000
_LOG = logging.getLogger("labctl.drivers")


def open_regulator(
    config: RegulatorConfig, limits: Limits, clock: Scheduler, wires: Wires = SYSTEM_WIRES
) -> PressureRegulator:
    """Open the regulator's port; nothing is sent.

    Raises:
        LinkDown: the port is absent or in use.
    """
    dual_valve = config.model == "PCD"
    _LOG.info("%s: opening %s (%s)", config.name, config.port, config.driver)
    if config.driver == "alicat-ascii":
        link = open_serial_link(config.port, config.baudrate, clock, config.name, wires=wires)
        with _closed_on_error(link):
            return AlicatAscii(
                link,
                unit_id=config.unit_id,
                pressure_unit=config.pressure_unit,
                max_setpoint_psi=limits.max_pressure_psi,
                dual_valve=dual_valve,
                name=config.name,
                timeout_s=config.timeout_s,
            )
    registers = open_modbus_serial(config.port, config.baudrate, clock, config.name, wires=wires)
    with _closed_on_error(registers):
        return AlicatModbus(
            registers,
            device_id=config.device_id,
            pressure_unit=config.pressure_unit,
            unit_proof=config.pressure_unit_proven or None,
            word_order=config.word_order,
            max_setpoint_psi=limits.max_pressure_psi,
            dual_valve=dual_valve,
            name=config.name,
            timeout_s=config.timeout_s,
        )


def open_gauge(
    config: GaugeConfig, limits: Limits, clock: Scheduler, wires: Wires = SYSTEM_WIRES
) -> PressureGauge:
    """Open the second gauge's port; nothing is sent.

    Raises:
        LinkDown: the port is absent or in use.
    """
    as_regulator = RegulatorConfig(
        name=config.name,
        driver=config.driver,
        model="PC",
        port=config.port,
        baudrate=config.baudrate,
        unit_id=config.unit_id,
        device_id=config.device_id,
        pressure_unit=config.pressure_unit,
        timeout_s=config.timeout_s,
        word_order=config.word_order,
    )
    return open_regulator(as_regulator, limits, clock, wires)


def open_valves(config: ValvesConfig, clock: Scheduler, wires: Wires = SYSTEM_WIRES) -> ValveBank:
    """Open the valve bank's port; nothing is sent.

    Raises:
        LinkDown: the port or host is absent or in use.
    """
    where = config.port if config.transport == "rtu" else f"{config.host}:{config.tcp_port}"
    _LOG.info("%s: opening %s (%s)", config.name, where, config.driver)
    if config.transport == "rtu":
        link = open_modbus_serial(config.port, config.baudrate, clock, config.name, wires=wires)
    else:
        link = open_modbus_tcp(config.host, config.tcp_port, clock, config.name, wires=wires)
    with _closed_on_error(link):
        return WaveshareRelay(
            link,
            device_id=config.device_id,
            channels=config.channels,
            name=config.name,
            timeout_s=config.timeout_s,
        )


def open_markers(
    config: MarkersConfig, clock: Clock, arrival_clock: Clock, wires: Wires = SYSTEM_WIRES
) -> MarkerSource:
    """Connect to the marker server; no stream is asked for yet.

    `clock` is the wall's, `arrival_clock` the laboratory's, which stamps the frames' arrival.

    Raises:
        LinkDown: nothing listens there.
    """
    port = _PHASESPACE_BASE_PORT + config.server_number
    _LOG.info("%s: opening %s:%d (%s)", config.name, config.host, port, config.driver)
    stream = wires.open_tcp(config.host, port, clock, config.name, config.timeout_s)
    with _closed_on_error(stream):
        return PhaseSpace(
            stream,
            clock=arrival_clock,
            frequency_hz=config.frequency_hz,
            length_unit_mm=config.length_unit_mm,
            name=config.name,
            timeout_s=config.timeout_s,
        )


class _Closes(Protocol):
    def close(self) -> None: ...


@contextmanager
def _closed_on_error(link: _Closes) -> Iterator[None]:
    """Give a link back when the driver that was to have it is not made."""
    try:
        yield
    except BaseException:
        link.close()
        raise
