"""The rig.toml that points at a set of doubles."""

from collections.abc import Iterable

from labctl.config.rig import MarkerPoint
from labctl.doubles.settings import DoublesSettings

REGULATOR_BAUDRATE = 19200
VALVES_BAUDRATE = 9600


def rig_toml(
    settings: DoublesSettings,
    regulator_port: str,
    valves_address: str,
    markers_host: str,
    server_number: int,
    gauge_port: str | None = None,
) -> str:
    """A complete rig.toml; `valves_address` is a terminal's path ("rtu") or "host:port" ("tcp").

    `gauge_port` is the second gauge's, None where there is none.
    """
    return "\n".join(
        [
            'name = "simulated rig"',
            "simulated = true",
            f"speed = {settings.speed!r}",
            "",
            *_regulator(settings, regulator_port),
            "",
            *_valves(settings, valves_address),
            "",
            *_markers(settings, markers_host, server_number),
            "",
            *_gauge(settings, gauge_port),
            "[limits]",
            'max_pressure = "4.0 psi"',
            "",
        ]
    )


def _regulator(settings: DoublesSettings, port: str) -> list[str]:
    return [
        "[regulator]",
        'name = "regulator A"',
        f'driver = "{settings.regulator}"',
        f'model = "{"PC" if settings.single_valve else "PCD"}"',
        f'port = "{port}"',
        f"baudrate = {REGULATOR_BAUDRATE}",
        'unit_id = "A"',
        "device_id = 1",
        'pressure_unit = "psi"',
        *_unit_proof(settings),
        'timeout = "0.5 s"',
    ]


def _unit_proof(settings: DoublesSettings) -> list[str]:
    """What makes sure of the unit, where the protocol does not: nothing, where the double is set to another."""
    in_another = any(fault.kind == "unit-bar" for fault in settings.faults.regulator)
    if settings.regulator == "alicat-ascii" or in_another:
        return []
    return ['pressure_unit_proven = "the double is made in psi"']


def _gauge(settings: DoublesSettings, port: str | None) -> list[str]:
    if port is None or settings.second_gauge is None:
        return []
    return [
        "[gauge]",
        'name = "gauge B"',
        f'driver = "{settings.second_gauge}"',
        f'port = "{port}"',
        f"baudrate = {REGULATOR_BAUDRATE}",
        'unit_id = "A"',
        "device_id = 1",
        'pressure_unit = "psi"',
        'timeout = "0.5 s"',
        "",
    ]


def _valves(settings: DoublesSettings, address: str) -> list[str]:
    if settings.valve_transport == "rtu":
        where = [f'port = "{address}"', f"baudrate = {VALVES_BAUDRATE}"]
    else:
        host, _, port = address.rpartition(":")
        where = [f'host = "{host}"', f"tcp_port = {port}"]
    dump = [] if settings.dump_channel is None else [f"dump_channel = {settings.dump_channel}"]
    return [
        "[valves]",
        'name = "valve bank"',
        'driver = "waveshare-relay"',
        f'transport = "{settings.valve_transport}"',
        *where,
        "device_id = 1",
        f"channels = {settings.relay_channels}",
        *dump,
        'timeout = "0.5 s"',
    ]


def _markers(settings: DoublesSettings, host: str, server_number: int) -> list[str]:
    return [
        "[markers]",
        'name = "marker stream"',
        'driver = "phasespace"',
        f'host = "{host}"',
        f"server_number = {server_number}",
        "frequency_hz = 240",
        'up = "+z"',
        'length_unit = "1 mm"',
        'timeout = "0.5 s"',
        "points = [",
        *_points(settings.markers.points),
        "]",
    ]


def _points(points: Iterable[MarkerPoint]) -> list[str]:
    return [f'  {{id = {point.id}, x = "{point.x_mm} mm", y = "{point.y_mm} mm"}},' for point in points]
