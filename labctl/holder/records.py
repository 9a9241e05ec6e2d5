"""What a holder of a rig tells about itself, and what is asked of it: one JSON object each, with a version."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, TypeVar

from labctl.plain_json import NotPlain, from_json

VERSION = 1

Ask = Literal["state", "watch", "vent", "abort"]

T = TypeVar("T")


@dataclass(frozen=True)
class Holder:
    """Who holds a rig. `kind` "guard" is the process that takes a rig to SAFE after its program's death.

    `source` is the rig's file as an absolute path, or what stands in its place for a command's own doubles.
    """

    kind: Literal["command", "guard"]
    pid: int
    user: str
    command: str
    folder: str
    since: str
    rig_name: str
    source: str
    simulated: bool

    def describe(self) -> str:
        """One line for people: process, command, since when, where."""
        return f"process {self.pid} ({self.command}), since {self.since}, in {self.folder}"


@dataclass(frozen=True)
class Entry:
    """What lies in the folder of holders: who, which addresses, and how to take the rig to SAFE without its program.

    `reach` is a `labctl.safety.reach.Reach` as plain JSON.
    """

    version: int
    holder: Holder
    addresses: tuple[str, ...]
    reach: Mapping[str, Any]


@dataclass(frozen=True)
class SafeReading:
    """A `SafeReport` as it crosses to another process."""

    pressure_psi: float | None
    setpoint_psi: float | None
    vented_by: str | None
    channels_on: tuple[int, ...] | None
    problems: tuple[str, ...]
    only_zero_is_off: bool = False

    @property
    def safe(self) -> bool:
        """SAFE was read back, all of it."""
        return not self.problems


@dataclass(frozen=True)
class RigState:
    """The latest of everything that is known of a held rig; None is what is not known.

    `phase` "closed": the holder has no port open; "opening": it may have some; "open": an open rig. `venting` while
    the holder takes the rig to SAFE of its own accord, which may take longer than an opening does. `reading_age_s`
    is the age of pressure, setpoint and flags, by the wall's clock. `safe` is what was last read back on the way to
    SAFE, None from when anything is energised. `asked_by` is whose request to vent or abort is being done, and
    `read_back` what it read. `ended` is true in the last state that a holder sends.
    """

    version: int
    holder: Holder
    phase: Literal["closed", "opening", "open"]
    elapsed_s: float
    step: str = ""
    detail: str = ""
    protocol: str | None = None
    run: int | None = None
    trial: int | None = None
    trials: int | None = None
    pressure_psi: float | None = None
    setpoint_psi: float | None = None
    flags: tuple[str, ...] = ()
    reading_age_s: float | None = None
    channels_on: tuple[int, ...] | None = None
    markers_seen: int | None = None
    markers: int | None = None
    marker_age_s: float | None = None
    safe: SafeReading | None = None
    asked_by: str | None = None
    read_back: SafeReading | None = None
    ended: bool = False
    venting: bool = False


@dataclass(frozen=True)
class Request:
    """What is asked, and by whom."""

    version: int
    ask: Ask
    pid: int
    user: str


def read_record(kind: type[T], data: object) -> T:
    """A record of another process, which may be a later labctl of the same version of the records.

    Raises:
        NotPlain: it is none, or of another version.
    """
    if not isinstance(data, dict) or data.get("version") != VERSION:
        raise NotPlain(f"{kind.__name__} of another version: {str(data)[:60]}")
    hashable: Any = kind
    known = {field.name for field in fields(hashable)}
    return from_json(kind, {name: value for name, value in data.items() if name in known})
