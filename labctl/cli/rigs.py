"""Which rig a command works on: the one of --rig, or doubles that live as long as the command does."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from labctl.cli.outcome import Outcome
from labctl.cli.own_doubles import doubles_process
from labctl.config.rig import RigConfig
from labctl.stop import StopRequest

if TYPE_CHECKING:
    from labctl.config.design import Design
    from labctl.rig import Rig

_DOUBLES_FILE = "the doubles' own rig.toml"


@contextmanager
def chosen_rig(
    rig_path: Path | None, design_name: str, stop: StopRequest, speed: float = 1.0
) -> Iterator[RigConfig]:
    """The configuration to work with; doubles, of this speed, are running while inside when no file was named."""
    from labctl.config.load import load_rig

    outcome = Outcome.current()
    if rig_path is not None:
        config = load_rig(rig_path)
        outcome.simulated = config.simulated
        yield config
        return
    outcome.simulated = True
    with tempfile.TemporaryDirectory(prefix="labctl-doubles-") as folder:
        path = Path(folder) / "rig.toml"
        with doubles_process(path, design_name, stop, speed):
            # The file is gone when a message that names it is read.
            yield replace(load_rig(path), source=_DOUBLES_FILE)


@contextmanager
def reporting(rig: "Rig") -> Iterator["Rig"]:
    """The rig, and after it the state that was read back, for the last line that is printed."""
    try:
        with rig:
            yield rig
    finally:
        Outcome.current().report = rig.safe_report


def rig_to_be(rig_path: Path | None, design: "Design") -> RigConfig:
    """The configuration that a command would work with; of doubles, which do not run, all but the addresses."""
    from labctl.config.load import load_rig, rig_from_text
    from labctl.doubles.rig_file import rig_toml
    from labctl.doubles.settings import DoublesSettings

    if rig_path is not None:
        return load_rig(rig_path)
    text = rig_toml(DoublesSettings(design=design), "/dev/null", "/dev/zero", "127.0.0.1", 0)
    return replace(rig_from_text(text, "rig.toml"), source=_DOUBLES_FILE)
