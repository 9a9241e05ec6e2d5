"""What of a PhaseSpace stream was passed over, counted, so that it is known and does not grow without limit."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

# A packet with a wrong checksum weighs as much as so many right ones; more than a quarter of them is no stray fault.
_WEIGHT = 3
_LIMIT = 48


class Tally:
    """Counts over one connection; `notes` are for people."""

    def __init__(self) -> None:
        self.packets = 0
        self.wrong_checksums = 0
        self.incomplete = 0
        self.repeated = 0
        self.backward = 0
        self.other_frames: Counter[str] = Counter()
        self.errors = 0
        self.last_error = ""
        self._weight = 0
        self._last_time: int | None = None

    @property
    def is_flooded(self) -> bool:
        """Whether too many packets of late had a wrong checksum for this to be the stream of a server."""
        return self._weight > _LIMIT

    def count_packets(self, number: int) -> None:
        """Packets that came and were right."""
        self.packets += number
        self._weight = max(0, self._weight - number)

    def count_wrong_checksum(self) -> None:
        """A packet that was skipped."""
        self.packets += 1
        self.wrong_checksums += 1
        self._weight += _WEIGHT

    def count_error(self, text: str) -> None:
        """An error in the server's words, while frames were coming."""
        self.errors += 1
        self.last_error = text

    def newer(self, times: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of these frames' times (k,) go on from the one before; the others are counted.

        A server whose clock was set back goes on from there, so only the first frame after it is not newer.
        """
        is_newer = np.ones(len(times), dtype=bool)
        if self._last_time is None:
            before, after = times[:-1], times[1:]
        else:
            before, after = np.concatenate([[self._last_time], times[:-1]]), times
        is_newer[len(times) - len(after) :] = after > before
        self._last_time = int(times[-1])
        self.repeated += int((after == before).sum())
        self.backward += int((after < before).sum())
        return is_newer

    def restart(self) -> None:
        """A new stream: its times have nothing to do with those before."""
        self._last_time = None

    def notes(self) -> tuple[str, ...]:
        """What was passed over, one text a kind; none where nothing was."""
        counted = (
            (self.wrong_checksums, f"of {self.packets} packets had a wrong checksum and were skipped"),
            (self.incomplete, "frames were left out because a packet before their end was skipped"),
            (self.repeated, "frames were left out because they repeat the time of the one before"),
            (self.backward, "frames were left out because their time goes back"),
            *((number, f"frames of {name!r} were left out") for name, number in self.other_frames.items()),
            (
                self.errors,
                f"errors were reported by the server while it sent frames, last {self.last_error!r}",
            ),
        )
        return tuple(f"{number} {text}" for number, text in counted if number)
