"""The plant's truth as JSON lines, flushed one by one, so that it outlives a killed process."""

import json
from pathlib import Path
from typing import Any

from labctl.clock import Clock
from labctl.doubles.plant import PlantState
from labctl.errors import BadInput


class Trace:
    """A file of one JSON object a line.

    Keys: time_s (the plant's), wall_s (of `wall`, the machine's monotonic clock), pressure_psi (true),
    setpoint_psi, exhausting, coils (channels that are on), jammed (fiber ids).

    Raises:
        BadInput: the file cannot be written.
    """

    def __init__(self, path: Path, wall: Clock) -> None:
        self._wall = wall
        try:
            self._file = path.open("w", encoding="utf-8")
        except OSError as error:
            raise BadInput(
                f"trace {path}: cannot be written ({error.strerror}); name another file"
            ) from error

    def write(self, state: PlantState) -> None:
        """Append one line; after `close` nothing is written."""
        if self._file.closed:
            return
        self._file.write(json.dumps(row_of(state, self._wall.now_s())) + "\n")
        self._file.flush()

    def close(self) -> None:
        """End the file; may be called twice."""
        self._file.close()


def row_of(state: PlantState, wall_s: float) -> dict[str, Any]:
    """A line of the trace."""
    return {
        "time_s": round(state.time_s, 6),
        "wall_s": wall_s,
        "pressure_psi": state.pressure_psi,
        "setpoint_psi": state.setpoint_psi,
        "exhausting": state.exhausting,
        "coils": sorted(state.coils),
        "jammed": sorted(state.jammed),
    }
