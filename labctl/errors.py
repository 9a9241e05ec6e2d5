"""What can go wrong, and the exit code that each kind ends a command with.

Two families: `BadInput` (exit 2) is something that a person can correct before anything moves;
every other `LabError` (exit 1) happened while the laboratory was working.
"""

from labctl.printable import printable


class LabError(Exception):
    """A failure with a message for the user: what, which value, which limit, what to do next.

    A message may quote an instrument: what is not printable in it is written as an escape.
    """

    exit_code = 1

    def __init__(self, message: str = "") -> None:
        super().__init__(printable(message, also="\n\t"))


class BadInput(LabError):
    """Input that cannot be used: an argument, a file, a rig that is not there."""

    exit_code = 2


class RigUnavailable(BadInput):
    """An instrument could not be opened or identified; nothing was energised."""


class InstrumentError(LabError):
    """An instrument or its link failed."""


class LinkDown(InstrumentError):
    """The port or socket is absent, was closed, or broke."""


class LinkBusy(LinkDown):
    """The port is in use by another program."""


class LinkRefused(LinkDown):
    """The host refused the connection: nothing listens there, or it takes one client at a time and has one."""


class NoAnswer(InstrumentError):
    """No complete reply came before the deadline."""


class GarbledReply(InstrumentError):
    """Bytes came that are not the reply that the manual describes."""


class InstrumentRefused(InstrumentError):
    """The instrument answered, and the answer was an error."""


class ReadBackMismatch(InstrumentError):
    """What was read back is not what was written: the write does not count."""


class SetpointOutOfRange(InstrumentError):
    """A setpoint outside the driver's own bounds; no byte was sent."""


class Unproven(InstrumentError):
    """What a setpoint would mean to the device is not proven; no setpoint was sent."""


class Tripped(LabError):
    """The supervisor has vented the rig and latched; it stays so until reset."""


class Unsafe(LabError):
    """SAFE could not be read back from the instruments."""


class Stopped(LabError):
    """The operator stopped the run; the rig was taken to SAFE."""

    exit_code = 130
