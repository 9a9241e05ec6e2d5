"""The relay coils and what hangs on them: vacuum valves that take their time, timers that switch back."""

from collections.abc import Mapping

SWITCHING_DELAY_S = 0.05


class Relays:
    """Coils of channels 1..`channels`, all off at first; times are the plant's.

    A coil switches at once; its valve, and with it the fiber's vacuum, follows `delay_s` later.
    """

    def __init__(self, channels: int, delay_s: float = SWITCHING_DELAY_S) -> None:
        self.channels = channels
        self._delay_s = delay_s
        self._coils = dict.fromkeys(range(1, channels + 1), False)
        self._vacuum = dict(self._coils)
        self._following: dict[int, float] = {}
        self._timers: dict[int, tuple[float, bool]] = {}

    @property
    def on(self) -> frozenset[int]:
        """Channels whose coil is on."""
        return frozenset(channel for channel, is_on in self._coils.items() if is_on)

    @property
    def vacuum(self) -> frozenset[int]:
        """Channels whose valve has followed its coil and draws a vacuum."""
        return frozenset(channel for channel, is_on in self._vacuum.items() if is_on)

    def write(self, coils: Mapping[int, bool], now_s: float) -> None:
        """Switch the named channels; ends their timers."""
        for channel, is_on in coils.items():
            self._timers.pop(channel, None)
            self._switch(channel, is_on, now_s)

    def flash(self, channel: int, is_on: bool, seconds: float, now_s: float) -> None:
        """Switch a channel, and back when `seconds` have passed; a second call starts the time anew."""
        self._switch(channel, is_on, now_s)
        self._timers[channel] = (now_s + seconds, not is_on)

    def step(self, now_s: float) -> bool:
        """Let timers and valves follow the time; True where a valve has moved."""
        for channel, (due_s, is_on) in list(self._timers.items()):
            if now_s >= due_s:
                del self._timers[channel]
                self._switch(channel, is_on, due_s)
        moved = False
        for channel, due_s in list(self._following.items()):
            if now_s >= due_s:
                del self._following[channel]
                moved = moved or self._vacuum[channel] != self._coils[channel]
                self._vacuum[channel] = self._coils[channel]
        return moved

    def _switch(self, channel: int, is_on: bool, now_s: float) -> None:
        if self._coils[channel] != is_on:
            self._coils[channel] = is_on
            self._following[channel] = now_s + self._delay_s
