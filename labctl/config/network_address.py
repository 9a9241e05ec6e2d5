"""The name of a serial port behind an Ethernet box: `socket://host:port` or `rfc2217://host:port`."""

from urllib.parse import urlsplit

PLAIN, WITH_SETTINGS = "socket", "rfc2217"
SCHEMES = (PLAIN, WITH_SETTINGS)


def is_network_port(port: str) -> bool:
    """Whether a port's name is that of one behind the network."""
    return "://" in port


def address_of(port: str) -> tuple[str, str, int]:
    """Scheme, host and TCP port of `socket://host:port` or `rfc2217://host:port`.

    Raises:
        ValueError: it is neither, or has no host or no port from 1 to 65535.
    """
    parts = urlsplit(port)
    if parts.scheme not in SCHEMES:
        raise ValueError(f"begins with neither {' nor '.join(f'{scheme}://' for scheme in SCHEMES)}")
    if not parts.hostname or not parts.port:
        raise ValueError(f'needs host and port, as in "{parts.scheme}://192.168.0.7:4001"')
    if parts.path.strip("/") or parts.query or parts.fragment or parts.username:
        raise ValueError("has more than host and port")
    return parts.scheme, parts.hostname, parts.port
