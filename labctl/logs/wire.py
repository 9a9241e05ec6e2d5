"""Every byte that a link sends and receives, by the standard logging as "labctl.wire", at level DEBUG.

A record's message reads `regulator A on /dev/ttyUSB0 > 41 0d | A.`: the link, `>` for sent or `<` for received, the
bytes in hexadecimal and, where they hold text, as text with a dot for each byte that is none. The bytes stand in the
record's `args` too: (link, direction, `WireBytes`). Nothing is formatted before a handler asks for it.
"""

import logging

LOGGER = logging.getLogger("labctl.wire")
SENT, RECEIVED = ">", "<"
_FORMAT = "%s %s %s"


class WireBytes(bytes):
    """Bytes that format themselves when a record is written."""

    def __str__(self) -> str:
        text = "".join(chr(byte) if 0x20 <= byte < 0x7F else "." for byte in self)
        readable = sum(char != "." for char in text)
        return f"{self.hex(' ')} | {text}" if readable * 2 >= len(self) else self.hex(" ")


def log_sent(link: str, data: bytes) -> None:
    """Log what a link sent."""
    if data and LOGGER.isEnabledFor(logging.DEBUG):
        LOGGER.debug(_FORMAT, link, SENT, WireBytes(data))


def log_received(link: str, data: bytes) -> None:
    """Log what a link received."""
    if data and LOGGER.isEnabledFor(logging.DEBUG):
        LOGGER.debug(_FORMAT, link, RECEIVED, WireBytes(data))
