"""What a person says to `labctl run` beside what is to be measured."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class SessionOptions:
    """The rig, the ledger, the doubles' speed, who measures, a note, and who reads the output."""

    rig_path: Path | None
    ledger_folder: Path
    speed: float | None
    operator: str | None
    note: str
    as_json: bool
