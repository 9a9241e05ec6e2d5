"""What can go wrong between marker frames and heights."""

from labctl.errors import InstrumentError


class NoFrames(InstrumentError):
    """No marker frame to average, or frames that came were lost again."""


class FrameRefused(InstrumentError):
    """The markers do not fix the sheet frame."""


class TooFewPoints(InstrumentError):
    """Too few points, or too flat a shape, to compare."""
