"""What a rig is found by: the places of the two instruments that can energise it.

A marker stream is not among them: two rigs may look through one set of cameras, and no stream puts pressure on a
sheet.
"""

import ipaddress
import os
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

from labctl.config.rig import RegulatorConfig, ValvesConfig

_LOCAL = {"localhost": "127.0.0.1", "localhost.localdomain": "127.0.0.1", "ip6-localhost": "::1"}


def addresses_of(regulator: RegulatorConfig, valves: ValvesConfig) -> tuple[str, ...]:
    """The addresses of a rig, sorted: two configurations that share one are of the same rig.

    A serial port counts under the name that it was given and under that of the device behind it: an adapter that
    came back as another device is still found by its name under /dev/serial.
    """
    found = _port(regulator.port)
    if valves.transport == "rtu":
        found |= _port(valves.port)
    else:
        # One gateway may lead to the boards of several rigs.
        found.add(f"{_tcp(valves.host, valves.tcp_port)}#{valves.device_id}")
    return tuple(sorted(found))


def _port(port: str) -> set[str]:
    if "://" in port:
        url = urlsplit(port)
        return {_tcp(url.hostname or "", url.port or 0)}
    return {f"port {os.path.realpath(port)}", f"port {Path(port).absolute()}"}


def _tcp(host: str, port: int) -> str:
    name = host.strip("[]").rstrip(".").lower()
    name = _LOCAL.get(name, name)
    # A name of the network is compared as it was written: to ask what it means could take long.
    with suppress(ValueError):
        name = str(ipaddress.ip_address(name))
    return f"tcp {name}:{port}"
